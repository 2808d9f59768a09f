// SPDX-License-Identifier: Apache-2.0
// RRT-Connect by OMPL, without its clock, threads and process-wide random seed. Hides OMPL.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "services/core/rng.h"

namespace etude::plan::internal {

struct SamplingProblem {
  Eigen::VectorXd q_start, q_goal;
  Eigen::VectorXd lower, upper;  ///< box that states are drawn from; holds start and goal
  std::function<bool(const Eigen::VectorXd&)> is_free;
  std::function<bool(const Eigen::VectorXd&, const Eigen::VectorXd&)> is_segment_free;
  int max_samples = 0;  ///< budget: states drawn
};

struct SamplingResult {
  std::vector<Eigen::VectorXd> path;  ///< start to goal; empty when the budget did not suffice
  int samples = 0;                    ///< states drawn
};

/// Source: Kuffner & LaValle 2000, "RRT-Connect". A pure function of the problem and `rng`.
SamplingResult SamplePath(const SamplingProblem& problem, Rng& rng);

}  // namespace etude::plan::internal
