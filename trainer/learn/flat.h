// SPDX-License-Identifier: Apache-2.0
// Arithmetic over the optimiser's flat float32 buffers: our own kernels (adamw_kernel.h) on the CPU, torch's operations
// elsewhere (device.h says which). Buffers of one call are dense, of one size, on one device.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "trainer/learn/adamw_kernel.h"
#include "trainer/policy/torch.h"

namespace etude::learn {

/// Part of a buffer that belongs together: one parameter.
struct FlatRange {
  std::size_t offset = 0, count = 0;
};

/// into += from
void AddFlat(const torch::Tensor& from, torch::Tensor& into);
/// Of each range, in order.
std::vector<double> SquaresOf(const torch::Tensor& flat, const std::vector<FlatRange>& ranges);
/// average = decay * average + (1 - decay) * value
void AverageFlat(double decay, const torch::Tensor& value, torch::Tensor& average);
/// Contents change places; what shares their storage sees it.
void SwapFlat(torch::Tensor& a, torch::Tensor& b);

struct AdamwBuffers {
  const torch::Tensor& gradient;
  torch::Tensor &first, &second, &parameters;
};
/// @param steps  one a range; none: it is left alone, bit for bit. @pre ranges ascend, the first at 0
void UpdateFlat(const std::vector<FlatRange>& ranges, const std::vector<std::optional<AdamwStep>>& steps,
                const AdamwBuffers& buffers);

}  // namespace etude::learn
