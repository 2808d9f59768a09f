// SPDX-License-Identifier: Apache-2.0
// Runs planners over seeded scenes and says how good their motions are.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "services/core/config.h"
#include "worker/plan/bench/scenes.h"

namespace etude::plan {

/// "etude": ours, straight first; "rrtconnect": OMPL's with FCL, simplified (PlainRrt); "field": the potential field.
const std::vector<std::string>& KnownPlanners();

struct BenchOptions {
  std::vector<std::string> robots{"ur5"};
  std::vector<std::string> planners = KnownPlanners();
  std::vector<std::string> difficulties{"open", "cluttered", "narrow"};
  int scenes = 50;
  std::uint64_t seed = 1;
  double deadline_s = 1;
};

/// One planner on the scenes of one difficulty with one robot. Medians and p95 are over the scenes that it solved.
struct BenchRow {
  std::string robot, difficulty, planner;
  int scenes = 0;
  int solved = 0;      ///< planned within the deadline, and free when looked at four times as closely
  int in_contact = 0;  ///< planned, but not free when looked at
  double plan_ms = 0, simplify_ms = 0, parameterise_ms = 0, total_ms = 0;  ///< medians
  double plan_p95_ms = 0, simplify_p95_ms = 0, parameterise_p95_ms = 0, total_p95_ms = 0;
  double joint_rad = 0, tool_m = 0, duration_s = 0;  ///< medians: path of the joints (Euclidean), of the tool, its time
  double clearance_mm = 0;                           ///< median of the least distance to anything
  std::vector<std::pair<std::string, int>> kinds;    ///< how often each outcome came, by name
  OrderedJson Json() const;
};

/// Measures everything that `options` asks for, interleaved scene by scene so that all planners see the same machine.
/// @param progress  called after each scene with what is done and all there is
/// @error kInvalidArgument: unknown robot, planner or difficulty
Result<std::vector<BenchRow>> RunBench(const BenchOptions& options,
                                       const std::function<void(int done, int all)>& progress);

/// A table for people.
std::string BenchTable(const std::vector<BenchRow>& rows);

}  // namespace etude::plan
