// SPDX-License-Identifier: Apache-2.0
// Normalisation constants, measured on the training split and saved with every checkpoint.
#pragma once

#include <vector>

#include "trainer/data/dataset.h"

namespace etude::data {

/// Standard deviations have floors (a joint that hardly moves in the data would otherwise turn any
/// deviation at test time into an input of hundreds of sigma).
struct Statistics {
  std::vector<float> joint_mean, joint_std;        ///< (J) arm joints then gripper; rad or m
  std::vector<float> position_mean, position_std;  ///< (3) m, of objects and hand
  std::vector<float> displacement_std;             ///< (3) m, root mean square of target - hand
  /// (12, 3) m, root mean square of waypoint k - hand: a centimetre for the first, ten for the last.
  std::vector<float> offset_std;
};

/// @error kNotFound when the training split has no frame; kCorrupt when joint counts differ.
Result<Statistics> ComputeStatistics(const Snapshot& snapshot);

}  // namespace etude::data
