// SPDX-License-Identifier: Apache-2.0
// Rotations as six numbers, of which there are two forms:
//   6d            the first two columns of the rotation matrix (services/episode/pose.h): labels, files, messages
//   euler_sincos  sine and cosine of roll, pitch, yaw ("rxyz"), as the paper's heads say them
// The form is a property of a head; what leaves the policy is 6D.
#pragma once

#include <torch/types.h>

#include <string>

namespace etude::policy {

/// (..., 6) in `form` -> (..., 3, 3), a proper rotation whatever the numbers are (Gram-Schmidt; atan2).
torch::Tensor RotationMatrix(const torch::Tensor& values, const std::string& form);

/// (..., 6) in 6D -> (..., 6) in `form`: labels for a head.
torch::Tensor ToForm(const torch::Tensor& rotation_6d, const std::string& form);

/// (..., 6) in `form` -> (..., 6) in 6D, columns of length 1 at right angles.
torch::Tensor To6D(const torch::Tensor& values, const std::string& form);

/// Angle between two rotations, degrees: (..., 6) in `form` and (..., 6) in 6D -> (...), broadcast: one hand may be
/// said anew for each sentence, one target for all of them.
torch::Tensor AngleDegrees(const torch::Tensor& said, const std::string& form, const torch::Tensor& label_6d);

/// The last dimension's columns [first, first + 6) replaced by `rotation`.
torch::Tensor WithRotation(const torch::Tensor& values, int first, const torch::Tensor& rotation);

}  // namespace etude::policy
