// SPDX-License-Identifier: Apache-2.0
// What one gets from the libraries alone, to compare with: OMPL's RRT-Connect with FCL, OMPL's own simplification, then
// time along the result.
#pragma once

#include <memory>

#include "worker/plan/planner.h"

namespace etude::plan {

/// RRT-Connect as OMPL sets it up by itself (range, neighbours, the joint limits as its space), states checked by the
/// same checker at the same resolution, `simplifyMax`, then the same time parameterisation as ours. The deadline is
/// looked at by the planner between its iterations: no thread.
///
/// Its draws come from OMPL's process-wide seed, so a run is repeatable only as a whole. One thread.
class PlainRrt {
 public:
  PlainRrt(std::shared_ptr<const sim::Scene> scene, std::uint64_t seed);
  PlainRrt(PlainRrt&&) noexcept;
  ~PlainRrt();

  /// Goal, limits and margin of `request`; the rest of it plays no part. kSampled or why not.
  Outcome Plan(const Request& request, collide::Checker& checker, double deadline_s);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::plan
