// SPDX-License-Identifier: Apache-2.0
#include "worker/task/feasibility_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

#include "services/spec/object_names.h"
#include "worker/task/scene_sampling.h"

namespace etude::task {
namespace {

constexpr double kHeldGripper = 0.5;  // opening that stands for "around an object" in checks
// What the hand holds is never quite where it was planned to be.
constexpr double kMargin = 0.008;         // m kept free at the goals,
constexpr double kObstacleMargin = 0.03;  // m from obstacle and distractors, where a touch is a failure
constexpr double kPlannerMargin = 0.002;  // m that the planner keeps, see plan::Request
constexpr double kDexterity = 0.06;       // m, see Dexterity
constexpr double kAside = 0.015;          // m
constexpr int kStraightSamples = 12;      // places along a way that has to be straight
constexpr double kInfinite = std::numeric_limits<double>::infinity();
constexpr int kWaySamples = 6;  // places along a way that the arm should be able to follow

// The arm at `goal`, or why it cannot be there.
struct Place {
  std::optional<Eigen::VectorXd> q;
  Rejection why;
};

enum class Need { kFree, kReach };  // the arm must be free of collisions there, or only come there

// What keeps the arm from standing at q, if anything does. The table stays where it is: it needs no more than the
// planner's margin.
std::optional<Rejection> Blocked(const Eigen::VectorXd& q, double margin, FeasibilityCheck& check) {
  collide::Checker& checker = *check.checker;
  if (const auto collision = checker.Check(q, std::min(margin, kPlannerMargin)))
    return Rejection{"touches", fmt::format("{} touches {}", collision->body_a, collision->body_b)};
  if (margin <= kPlannerMargin || !checker.Collides(q, kObstacleMargin)) return std::nullopt;
  for (const auto& near : checker.Distances(q, kObstacleMargin)) {
    const bool forbidden = near.body_b == kObstacleObject || IsDistractor(near.body_b);
    const double least = forbidden ? kObstacleMargin : margin;
    if (near.body_b != "world" && near.body_b != check.near_wanted && near.distance < least)
      return Rejection{"too_near", fmt::format("{} comes too near to {}", near.body_a, near.body_b)};
  }
  return std::nullopt;
}

Place TryPlace(const Pose& X_WE, double margin, Need need, const Eigen::VectorXd& q_from, FeasibilityCheck& check) {
  Place place;
  place.q = check.kinematics->Solve(X_WE, q_from);
  if (!place.q) {
    place.why = {"out_of_reach",
                 fmt::format("out of reach at ({:.3f}, {:.3f}, {:.3f})", X_WE.p.x(), X_WE.p.y(), X_WE.p.z())};
    return place;
  }
  if (Dexterity(*check.kinematics, *place.q) < kDexterity || SingularityBetween(*check.kinematics, q_from, *place.q)) {
    place.why = {"too_stretched",
                 fmt::format("too stretched at ({:.3f}, {:.3f}, {:.3f})", X_WE.p.x(), X_WE.p.y(), X_WE.p.z())};
    place.q.reset();
    return place;
  }
  if (need == Need::kReach) return place;
  if (auto blocked = Blocked(*place.q, margin, check)) {
    place.why = std::move(*blocked);
    place.q.reset();
  }
  return place;
}

// Most that a joint may turn from one of `samples` places along a straight way to the next, rad: at kSlowest of the
// asked speed, a little over what the planner slows down to at most.
double MostTurn(const Stage& stage, const Pose& from, const Pose& goal, int samples) {
  constexpr double kSlowest = 0.25;
  const double linear = (goal.p - from.p).norm() / stage.limits.linear;
  const double angular = AngleBetween(goal.q, from.q) / stage.limits.angular;
  return std::max(linear, angular) / samples / kSlowest * stage.limits.joint;
}

// Along the straight way, when the stage must take it.
Place TryGoal(const Stage& stage, const Pose& from, const Pose& goal, FeasibilityCheck& check) {
  Place place{.q = check.q};
  const int samples = stage.straight_only ? kStraightSamples : stage.holds ? kWaySamples : 1;
  const double most_turn = stage.straight_only ? MostTurn(stage, from, goal, samples) : kInfinite;
  for (int i = 1; i <= samples && place.q; ++i) {
    const double s = static_cast<double>(i) / samples;
    const Need need = stage.straight_only || i == samples ? Need::kFree : Need::kReach;
    const Eigen::VectorXd q = *place.q;
    place = TryPlace(Interpolate(from, goal, s), kMargin, need, q, check);
    // the first step also takes up what the approach has left
    if (place.q && i > 1 && (*place.q - q).cwiseAbs().maxCoeff() > most_turn)
      place = {std::nullopt, {"whirls", "a joint would have to whirl round"}};
  }
  // pushes off the path move what is held a little aside
  for (const auto& [dx, dy] : {std::pair{-kAside, 0.0}, {kAside, 0.0}, {0.0, -kAside}, {0.0, kAside}}) {
    if (!place.q || !stage.holds) break;
    const Place there = TryPlace({goal.p + Eigen::Vector3d(dx, dy, 0), goal.q}, 0, Need::kFree, *place.q, check);
    if (!there.q) place = there;
  }
  return place;
}

Rejection At(const Stage& stage, const Rejection& why) {
  return {stage.name + ": " + why.reason, stage.name + ": " + why.detail};
}

}  // namespace

void SetForStage(const Stage& stage, const std::string& target, const std::optional<Pose>& X_EO,
                 collide::Checker& checker) {
  checker.SetGripper(stage.holds ? kHeldGripper : stage.closed ? 1.0 : 0.0);
  checker.Allow(stage.touches_target ? std::set<std::string>{target} : std::set<std::string>{});
  checker.Attach(target, stage.holds ? X_EO : std::nullopt);
}

std::optional<Rejection> CheckFeasible(const std::vector<Stage>& stages, StageContext now, FeasibilityCheck check) {
  for (const Stage& stage : stages) {
    check.near_wanted = stage.nears_reference ? now.reference : std::string();
    if (!stage.moves()) {
      if (stage.effect == Stage::Effect::kGrasps) now.X_EO = now.X_WE.inverse() * now.X_WO;
      if (stage.effect == Stage::Effect::kReleases) {
        now.X_EO.reset();
        SetForStage(stage, now.target, std::nullopt, *check.checker);
        if (const auto blocked = Blocked(check.q, kMargin, check)) return At(stage, *blocked);
      }
      continue;
    }
    SetForStage(stage, now.target, now.X_EO, *check.checker);
    Pose goal = stage.goal(now);
    Place place = TryGoal(stage, now.X_WE, goal, check);
    if (!place.q && stage.nearer) {
      goal = stage.nearer(now);
      place = TryGoal(stage, now.X_WE, goal, check);
    }
    if (!place.q) return At(stage, place.why);
    check.q = *place.q;
    now.X_WE = goal;
    if (stage.holds && now.X_EO) now.X_WO = goal * *now.X_EO;
    check.checker->SetObject(now.target, now.X_WO);
  }
  check.checker->Attach(now.target, std::nullopt);
  return std::nullopt;
}

}  // namespace etude::task
