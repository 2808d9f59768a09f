// SPDX-License-Identifier: Apache-2.0
// What quantities read and write: a module's output, statistics to scale by, labels with their masks.
#pragma once

#include <torch/types.h>

#include <map>
#include <string>

namespace etude::policy {

/// What divides pixels before they are a feature, a residual or a loss: half of the paper's picture.
inline constexpr double kPixelScale = 112;

/// Statistics of the training split, saved with the checkpoint. All float32.
struct Normalization {
  torch::Tensor joint_mean, joint_std;        ///< (J)
  torch::Tensor position_mean, position_std;  ///< (3) m, of objects and hand
  torch::Tensor displacement_std;             ///< (3) m
  torch::Tensor offset_std;                   ///< (12, 3) m, of each waypoint relative to the hand

  /// Zero means and unit deviations: for weights that bring their own, and for tests.
  static Normalization Unit(int joints);
};

/// What one module said. S' is S, or 1 where nothing it reads depends on the sentence, and for
/// trajectories while training (they are labelled for s = 0 only).
struct ModuleOutput {
  torch::Tensor register_token;    ///< (B, S', d)
  torch::Tensor attention;         ///< (B, S', K) head-mean over its keys; image tokens first when it reads them
  torch::Tensor head_attention;    ///< (B, S', heads, K) the same of each head
  torch::Tensor soft_argmax;       ///< (B, S', 2) px in the camera's picture, when it reads the image
  torch::Tensor head_soft_argmax;  ///< (B, S', heads, 2) px, the same of each head
  torch::Tensor gripper_logits;    ///< (B, S', 12), when it decodes a trajectory
  torch::Tensor waypoint_scale;    ///< (12) m, what an error of waypoint k is measured in; with a trajectory
  /// By the quantity's name, in SI units: "class" logits, "pixel" (2), "position" (3), "pose" (9), "displacement" (3),
  /// "trajectory" (12, 10) absolute with the gripper as a probability. Rotations are as the head says them
  /// (Head::rotation): Rotation6D of rotation.h makes 6D of them.
  std::map<std::string, torch::Tensor> decoded;
};
using Outputs = std::map<std::string, ModuleOutput>;

/// (B, S', 3) m: of a position, or the first three numbers of a pose. @pre one of them is decoded
torch::Tensor PositionOf(const ModuleOutput& output);

/// A label with its mask, (B, S | 1, ...) and (B, S | 1).
struct Target {
  torch::Tensor value, valid;

  /// What is not valid may be anything, NaN too: it is 0 here, before it meets a gradient.
  torch::Tensor Clean() const;
};

/// A loss per sample with its mask.
struct Masked {
  torch::Tensor loss, valid;
  torch::Tensor Mean() const;
};

/// One number that tells how good a module is.
struct Metric {
  enum class Role {
    kExtra,     ///< for people only
    kError,     ///< the module's error, in `values`' unit: lower is better
    kAccuracy,  ///< the module's error is 1 - its mean
  };
  std::string name;             ///< "cm"
  torch::Tensor values, valid;  ///< in SI units, 0 or 1, or px
  double scale = 1;             ///< what is printed is scale * mean
  Role role = Role::kExtra;
};

}  // namespace etude::policy
