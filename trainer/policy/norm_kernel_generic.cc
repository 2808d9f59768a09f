// SPDX-License-Identifier: Apache-2.0
// The kernel for any CPU, and the choice between the two.
#define ETUDE_NORM_NAMESPACE generic
#include "trainer/policy/norm_kernel.inc"

namespace etude::policy {

const NormKernel& NormKernelFor(NormType type) {
#if defined(ETUDE_NORM_AVX512)
  static const bool has_avx512 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                                 __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq");
  if (has_avx512) return avx512::Kernel(type);
#endif
  return generic::Kernel(type);
}

}  // namespace etude::policy
