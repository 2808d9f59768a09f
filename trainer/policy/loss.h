// SPDX-License-Identifier: Apache-2.0
// Losses of one module, in units that balance: a pixel, a centimetre and a nat weigh about the
// same.
#pragma once

#include <torch/torch.h>

#include <string>
#include <vector>

#include "trainer/policy/image_encoder.h"
#include "trainer/policy/policy.h"

namespace etude::policy {

/// A loss per sample with the samples that count.
struct Masked {
  torch::Tensor loss;   ///< (B, S')
  torch::Tensor valid;  ///< (B, S') bool
  /// Mean over what counts; 0 when nothing does.
  torch::Tensor Mean() const;
};

/// (B, S, P) Gaussian of 0.6 patches around each pixel, over the tokens of the picture, summing
/// to 1.
/// @param pixel  (B, S, 2) px in the camera's picture
torch::Tensor PatchTarget(const torch::Tensor& pixel, const torch::Tensor& crop_origin, const TokenGrid& grid);

/// How far the attention of one module is from its supervised keys.
///   log: cross-entropy to PatchTarget for a lone image@LABEL; else -log of the mass on the key set
///   mse: (mass - 1)^2, an image@LABEL counting the one patch under the pixel
/// Samples whose pixel is unlabelled or outside the crop do not count.
/// @param keys  names of the map's columns, Policy::KeysOf
Masked AttentionLoss(const ModuleConfig& module, const std::string& form, const std::vector<std::string>& keys,
                     const ModuleOutput& output, const Labels& labels, const torch::Tensor& crop_origin,
                     const TokenGrid& grid);

/// Loss of what a module decoded against its label, without its weight. Scalar; undefined without a
/// label.
torch::Tensor DecodeLoss(const ModuleConfig& module, const ModuleOutput& output, const Labels& labels,
                         const torch::Tensor& crop_origin, const TokenGrid& grid);

}  // namespace etude::policy
