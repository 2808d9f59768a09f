// SPDX-License-Identifier: Apache-2.0
// Makes a polyline in joint space shorter.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "services/core/rng.h"

namespace etude::plan::internal {

double Length(const std::vector<Eigen::VectorXd>& path);  ///< rad

/// Replaces parts between two drawn places on the path by the segment between them, where free.
/// Ends are kept; the path never gets longer. @param tries  places drawn
std::vector<Eigen::VectorXd> Shortcut(
    std::vector<Eigen::VectorXd> path, int tries, Rng& rng,
    const std::function<bool(const Eigen::VectorXd&, const Eigen::VectorXd&)>& is_segment_free);

}  // namespace etude::plan::internal
