// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "worker/plan/planner.h"

namespace etude::plan {

/// Every bit of a motion, to compare two of them.
inline std::vector<double> Bits(const Motion& motion) {
  std::vector<double> bits;
  for (int k = 0; k < motion.steps(); ++k) {
    bits.insert(bits.end(), motion.X_WE[k].p.begin(), motion.X_WE[k].p.end());
    const Eigen::Vector4d q = motion.X_WE[k].q.coeffs();
    bits.insert(bits.end(), q.begin(), q.end());
    bits.insert(bits.end(), motion.V_WE[k].begin(), motion.V_WE[k].end());
  }
  return bits;
}

}  // namespace etude::plan
