// SPDX-License-Identifier: Apache-2.0
// What errors cost, as a policy's file says it. No torch here.
#pragma once

#include <string>
#include <vector>

namespace etude::policy {

/// weight * smooth L1: quadratic below `beta`, linear above.
struct SmoothL1Config {
  double weight = 1;
  double beta = 1;  ///< in the unit that the loss is said to be in

  void Visit(auto& v) {
    v("weight", weight, "-", "factor of the loss");
    v("beta", beta, "-", "error from which on it grows linearly, in the unit that the loss is said to be in");
  }
};

/// weight * cross-entropy.
struct CrossEntropyConfig {
  double weight = 1;

  void Visit(auto& v) { v("weight", weight, "-", "factor of the cross-entropy"); }
};

struct AttentionLossConfig {
  /// log (bounded gradients) | mse (the original's code: (sum over the keys - 1)^2, which one key alone can meet) |
  /// mse_each (the paper's equation 2, of each key, with the share that all can have at once: mean of (K a_k - 1)^2)
  std::string kind = "log";
  double patch_sigma = 0.6;  ///< image tokens; log alone on an image is the cross-entropy to a Gaussian patch

  void Visit(auto& v) {
    v("kind", kind, "",
      "log (bounded gradients) | mse (the original's (sum - 1)^2) | mse_each (mean of (K a_k - 1)^2 over the K keys)");
    v("patch_sigma", patch_sigma, "-", "image tokens: width of the Gaussian patch around a pixel");
  }
};

/// Of a pose: position + rotation; of a trajectory: waypoint + rotation + gripper.
struct LossesConfig {
  AttentionLossConfig attention;
  CrossEntropyConfig class_{1};
  SmoothL1Config pixel{10, 0.01};          ///< of pixels / kPixelScale
  SmoothL1Config position{20, 0.003};      ///< m
  SmoothL1Config displacement{20, 0.003};  ///< m
  SmoothL1Config rotation{1, 0.1};         ///< of the six numbers that the head says
  SmoothL1Config waypoint{2, 0.05};        ///< of metres / Normalization::offset_std of each waypoint
  CrossEntropyConfig gripper{0.5};

  void Visit(auto& v) {
    v("attention", attention, "", "where modules look");
    v("class", class_, "", "of class logits");
    v("pixel", pixel, "", "of pixels / 112");
    v("position", position, "", "of metres");
    v("displacement", displacement, "", "of metres");
    v("rotation", rotation, "", "of the six numbers that a head says");
    v("waypoint", waypoint, "", "of metres over each waypoint's spread in the data");
    v("gripper", gripper, "", "of a waypoint's gripper");
  }

  /// Appends every problem to `errors`.
  void Check(std::vector<std::string>& errors) const;
};

}  // namespace etude::policy
