// SPDX-License-Identifier: Apache-2.0
#include "worker/task/rehearsal.h"

#include <fmt/format.h>

namespace etude::task {
namespace {

constexpr double kHeldGripper = 0.5;  // opening that stands for "around an object" in checks

// The arm at `goal`, or why it cannot be there.
struct Place {
  std::optional<Eigen::VectorXd> q;
  std::string why;
};

Place TryGoal(const Pose& goal, Rehearsal& rehearsal) {
  Place place;
  place.q = rehearsal.kinematics->Solve(goal, rehearsal.q);
  if (!place.q) {
    place.why = fmt::format("out of reach at ({:.3f}, {:.3f}, {:.3f})", goal.p.x(), goal.p.y(), goal.p.z());
    return place;
  }
  if (const auto collision = rehearsal.checker->Check(*place.q)) {
    place.why = fmt::format("{} touches {}", collision->body_a, collision->body_b);
    place.q.reset();
  }
  return place;
}

}  // namespace

void SetForStage(const Stage& stage, const std::string& target, const std::optional<Pose>& X_EO,
                 collide::Checker& checker) {
  checker.SetGripper(stage.holds ? kHeldGripper : stage.closed ? 1.0 : 0.0);
  checker.Allow(stage.touches_target ? std::set<std::string>{target} : std::set<std::string>{});
  checker.Attach(target, stage.holds ? X_EO : std::nullopt);
}

std::optional<std::string> Rehearse(const std::vector<Stage>& stages, Situation now, Rehearsal rehearsal) {
  for (const Stage& stage : stages) {
    if (!stage.moves()) {
      if (stage.name == "grasp") now.X_EO = now.X_WE.inverse() * now.X_WO;
      if (stage.name == "release") now.X_EO.reset();
      continue;
    }
    SetForStage(stage, now.target, now.X_EO, *rehearsal.checker);
    Pose goal = stage.goal(now);
    Place place = TryGoal(goal, rehearsal);
    if (!place.q && stage.nearer) {
      goal = stage.nearer(now);
      place = TryGoal(goal, rehearsal);
    }
    if (!place.q) return stage.name + ": " + place.why;
    rehearsal.q = *place.q;
    now.X_WE = goal;
    if (stage.holds && now.X_EO) now.X_WO = goal * *now.X_EO;
    rehearsal.checker->SetObject(now.target, now.X_WO);
  }
  rehearsal.checker->Attach(now.target, std::nullopt);
  return std::nullopt;
}

}  // namespace etude::task
