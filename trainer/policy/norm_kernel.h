// SPDX-License-Identifier: Apache-2.0
// The inner loops of FusedNormRelu over channels-last rows, compiled three times: for any CPU, for AVX2 and for
// AVX-512. Nothing but pointers and numbers, because a header's inline functions must not be compiled for what not
// every CPU has.
#pragma once

#include <cstdint>

namespace etude::policy {

/// Rows of `channels` values, a multiple of 16, all of one type: float32 or bfloat16.
struct NormRows {
  const void* x = nullptr;
  const void* residual = nullptr;  ///< may be null
  const void* y = nullptr;         ///< what Apply gave; backward only
  const void* grad = nullptr;      ///< of y; backward only
  std::int64_t rows = 0;
  std::int64_t channels = 0;
};

struct NormKernel {
  /// sum[c] = sum of x, squares[c] = sum of (x - shift[c])^2 over the rows.
  void (*sums)(const NormRows&, const float* shift, float* sum, float* squares);
  /// y = relu(x * scale[c] + offset[c] + residual).
  void (*apply)(const NormRows&, const float* scale, const float* offset, void* y);
  /// With g = grad where y > 0: sum[c] = sum of g, product[c] = sum of g * (x * scale[c] +
  /// offset[c]).
  void (*grad_sums)(const NormRows&, const float* scale, const float* offset, float* sum, float* product);
  /// dx = g * of_g[c] + x * of_x[c] + constant[c]; g itself goes to `residual_grad` unless null.
  void (*grad_apply)(const NormRows&, const float* of_g, const float* of_x, const float* constant, void* dx,
                     void* residual_grad);
};

enum class NormType { kFloat32, kBfloat16 };

/// The fastest kernel for this CPU.
const NormKernel& NormKernelFor(NormType type);

namespace generic {
const NormKernel& Kernel(NormType type);
}
namespace avx2 {
const NormKernel& Kernel(NormType type);
}
namespace avx512 {
const NormKernel& Kernel(NormType type);
}

}  // namespace etude::policy
