// SPDX-License-Identifier: Apache-2.0
// What several quantities share.
#pragma once

#include <torch/types.h>

#include <span>

#include "services/core/config.h"
#include "trainer/data/labels.h"
#include "trainer/policy/quantities/losses.h"
#include "trainer/policy/quantities/output.h"
#include "trainer/policy/quantities/quantity.h"

namespace etude::policy {

/// Unweighted, elementwise.
torch::Tensor SmoothL1(const torch::Tensor& value, const torch::Tensor& label, const SmoothL1Config& loss);

/// Euclidean distance over the first `columns` of the last dimension.
torch::Tensor Distance(const torch::Tensor& a, const torch::Tensor& b, int columns);

/// (B, S) whether each pixel lies in what the policy sees.
torch::Tensor InView(const torch::Tensor& pixel, const PictureView& view);

/// Fourier features of metres: sin and cos of 2 pi x / wavelength for five wavelengths from 64 cm down to 4 cm, for
/// decisions about millimetres: (..., 3) -> (..., kFourierWidth).
torch::Tensor FourierFeatures(const torch::Tensor& metres);
inline constexpr int kFourierWidth = 30;

/// Numbers of the first sample's first sentence, rounded to 1e-5; null where not finite.
OrderedJson Rounded(const torch::Tensor& tensor);

/// Position (3) and rotation in 6D (6) of a state.
void PutPose(const data::EntityState& state, std::span<float> values);

}  // namespace etude::policy
