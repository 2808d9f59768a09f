// SPDX-License-Identifier: Apache-2.0
// relu(normalise(x) + residual) in two passes over memory forwards and two backwards, where torch
// makes three to five each and converts instance normalisation to NCHW on the way.
#pragma once

#include "trainer/policy/torch.h"

namespace etude::policy {

inline constexpr auto kChannelsLast = torch::MemoryFormat::ChannelsLast;  ///< of pictures and features

struct FusedNorm {
  bool per_image = false;  ///< instance normalisation; else batch
  bool training = true;    ///< statistics of x; else the running ones
  double epsilon = 1e-5;
  double momentum = 0.1;
};

/// Where our own kernels compute (device.h): channels-last, float32 or bfloat16, channels a multiple of 16.
bool CanFuseNormRelu(const torch::Tensor& x);

/// Differentiable in x, weight, bias and residual.
/// @param weight, bias  (C) float32 or undefined (1 and 0)
/// @param running_mean, running_var  (C) float32 or undefined; updated when training
/// @param residual  as x, or undefined
torch::Tensor FusedNormRelu(const FusedNorm& norm, const torch::Tensor& x, const torch::Tensor& weight,
                            const torch::Tensor& bias, torch::Tensor running_mean, torch::Tensor running_var,
                            const torch::Tensor& residual);

}  // namespace etude::policy
