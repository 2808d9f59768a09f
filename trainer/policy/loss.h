// SPDX-License-Identifier: Apache-2.0
// The two losses of a module: where it looks, and what it says. Labels as in trainer/data/labels.h; shapes as in
// policy.h. What a quantity's error costs is the quantity's (quantities/), with the constants of the policy's file.
#pragma once

#include <string>
#include <vector>

#include "trainer/policy/config.h"
#include "trainer/policy/image_encoder.h"
#include "trainer/policy/policy.h"
#include "trainer/policy/torch.h"

namespace etude::policy {

/// Supervised attention, per sample. Image tokens supervised alone with form "log": cross-entropy to a Gaussian patch
/// around the entity's pixel (of a set: the mean of its members' patches). Else the mass on the key set (the entity's
/// patches, the named keys) is driven to 1: by (mass - 1)^2 ("mse", the original's) or -log(mass) ("log"). "mse_each"
/// (Eq. 2) drives each of K keys to 1 / K, by the mean of (K a_k - 1)^2; of one key it is "mse".
/// @param keys  names of the attention's columns; "image" stands for all image tokens and is first
Masked AttentionLoss(const ModuleConfig& module, const AttentionLossConfig& form, const std::vector<std::string>& keys,
                     const ModuleOutput& output, const Labels& labels, const torch::Tensor& crop_origin,
                     const TokenGrid& grid);

/// Loss of what is decoded, unweighted by the module; undefined when its label is absent.
torch::Tensor DecodeLoss(const PolicyConfig& policy, const ModuleConfig& module, const ModuleOutput& output,
                         const Labels& labels, const torch::Tensor& crop_origin, const TokenGrid& grid);

/// (B, S, P) probability of each patch around a pixel: a Gaussian of `sigma` patches, normalised over the crop.
torch::Tensor PatchTarget(const torch::Tensor& pixel, const torch::Tensor& crop_origin, const TokenGrid& grid,
                          double sigma);

/// The label with its mask (all valid when there is none); undefined tensors when it is absent.
Target FindTarget(const Labels& labels, const std::string& name);

}  // namespace etude::policy
