// SPDX-License-Identifier: Apache-2.0
// Whether a campaign follows what a trainer lacks, and how far (services/spec/sampling_weights.h has how).
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace etude {

/// Off by default: every episode is drawn as the spec alone says. The bounds hold whatever a trainer publishes.
struct AdaptiveSamplingSpec {
  double share = 0;           ///< of the episodes at most; all others, and those not for training, stay as they are
  double largest_ratio = 3;   ///< between the weights of two meetings of task, object and place: none is drawn more
                              ///< often than so many times its usual share, nor more rarely than by so much
  std::uint64_t every = 100;  ///< episodes between two changes of the weights, and before the first

  bool on() const { return share > 0; }
  bool operator==(const AdaptiveSamplingSpec&) const = default;
  void Visit(auto& v) {
    v("share", share, "-", "at most this share of the episodes is drawn by what the trainer lacks; 0: none");
    v("largest_ratio", largest_ratio, "-",
      "most times its usual share that a task, object and place together are drawn");
    v("every", every, "-", "episodes between two changes of the weights, and before the first");
  }
  /// Appends every problem to `errors`.
  void Check(std::vector<std::string>& errors) const;
};

}  // namespace etude
