// SPDX-License-Identifier: Apache-2.0
#include "worker/plan/bench/scenes.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "services/core/rng.h"

namespace etude::plan {
namespace {

constexpr int kDraws = 2000;
constexpr int kLineChecks = 24;        // states along the straight line
constexpr double kMargin = 0.005;      // m free around start and goal
constexpr double kApart = 0.10;        // m between objects
constexpr double kLeastWay = 0.15;     // m of the tool from start to goal
constexpr double kStartOffset = 0.08;  // m per axis

Eigen::Vector3d DrawPoint(const Eigen::Vector3d& low, const Eigen::Vector3d& high, Rng& rng) {
  const double x = rng.Uniform(low.x(), high.x());
  const double y = rng.Uniform(low.y(), high.y());
  return {x, y, rng.Uniform(low.z(), high.z())};
}

bool FarEnough(const PlanningScene& planning, const Eigen::Vector3d& p) {
  for (const auto& [name, X_WO] : planning.objects)
    if (Eigen::Vector3d(X_WO.p - p).head<2>().norm() < kApart) return false;
  return true;
}

void StandAbout(const std::vector<sim::ObjectInfo>& objects, std::size_t count, Rng& rng, PlanningScene& planning) {
  for (const sim::ObjectInfo& object : objects) {
    if (planning.objects.size() >= count) return;
    if (std::ranges::count(planning.objects, object.name, &std::pair<std::string, Pose>::first) > 0) continue;
    for (int i = 0; i < 50; ++i) {
      Pose X_WO;
      X_WO.p = DrawPoint({-0.40, 0.16, object.rest_height + 0.001}, {0.40, 0.42, object.rest_height + 0.001}, rng);
      X_WO.q = FromEuler({0, 0, rng.Uniform(-0.5, 0.5)});
      if (!FarEnough(planning, X_WO.p)) continue;
      planning.objects.emplace_back(object.name, X_WO);
      break;
    }
  }
}

// Two objects on both sides of the goal, with a gap for the hand, which the tool's y axis spans.
void StandBeside(const std::vector<sim::ObjectInfo>& objects, const Eigen::Vector3d& goal, Rng& rng,
                 PlanningScene& planning) {
  for (std::size_t i = 0; i < 2 && i < objects.size(); ++i) {
    const double side = i == 0 ? 1 : -1;
    const double half_gap = rng.Uniform(0.105, 0.125) + objects[i].half_extent.x();
    Pose X_WO;
    X_WO.p = {goal.x() + side * half_gap, goal.y() + rng.Uniform(0.0, 0.03), objects[i].rest_height + 0.001};
    planning.objects.emplace_back(objects[i].name, X_WO);
  }
}

// Whether something is in the way of the tool's straight line.
bool StraightIsBlocked(const PlanningScene& planning, const Pose& X_WE_start, sim::Kinematics& kinematics,
                       collide::Checker& checker) {
  Eigen::VectorXd q = planning.q_start;
  for (int i = 1; i < kLineChecks; ++i) {
    const double part = static_cast<double>(i) / kLineChecks;
    const auto next = kinematics.Solve(Interpolate(X_WE_start, planning.X_WE_goal, part), q);
    if (!next || checker.Collides(*next)) return true;
    q = *next;
  }
  return false;
}

PlanningScene DrawCandidate(const sim::Scene& scene, Difficulty difficulty, const Pose& X_WE_home, Rng& rng) {
  PlanningScene planning;
  std::vector<sim::ObjectInfo> objects = scene.objects();
  rng.Shuffle(objects);
  planning.X_WE_goal = X_WE_home;
  const double low = X_WE_home.p.z();
  const double lowest = difficulty == Difficulty::kOpen ? 0.10 : std::min(low, 0.07);
  planning.X_WE_goal.p =
      DrawPoint({-0.36, 0.16, lowest}, {0.36, 0.36, difficulty == Difficulty::kOpen ? 0.22 : lowest + 0.03}, rng);
  if (difficulty == Difficulty::kNarrow) StandBeside(objects, planning.X_WE_goal.p, rng, planning);
  StandAbout(objects, difficulty == Difficulty::kOpen ? 2 : objects.size(), rng, planning);
  return planning;
}

}  // namespace

std::string_view ToString(Difficulty difficulty) {
  if (difficulty == Difficulty::kOpen) return "open";
  return difficulty == Difficulty::kCluttered ? "cluttered" : "narrow";
}

Result<Difficulty> ParseDifficulty(const std::string& name) {
  for (const Difficulty difficulty : kDifficulties)
    if (name == ToString(difficulty)) return difficulty;
  return Fail(Code::kInvalidArgument, fmt::format("difficulty '{}': open, cluttered or narrow", name));
}

void Place(const sim::Scene& scene, const PlanningScene& planning, collide::Checker& checker) {
  double x = 5;
  for (const sim::ObjectInfo& object : scene.objects()) {
    Pose X_WO;
    X_WO.p = {x += 1, 5, object.rest_height};
    for (const auto& [name, X_WO_there] : planning.objects)
      if (name == object.name) X_WO = X_WO_there;
    checker.SetObject(object.name, X_WO);
  }
}

std::optional<PlanningScene> DrawPlanningScene(const sim::Scene& scene, Difficulty difficulty, std::uint64_t seed,
                                               int index, sim::Kinematics& kinematics, collide::Checker& checker) {
  Rng rng(MixSeed({seed, static_cast<std::uint64_t>(difficulty), static_cast<std::uint64_t>(index)}, "plan bench"));
  const Pose X_WE_home = kinematics.X_WE(scene.arm().q_home);
  for (int draw = 0; draw < kDraws; ++draw) {
    PlanningScene planning = DrawCandidate(scene, difficulty, X_WE_home, rng);
    Pose X_WE_start = X_WE_home;
    X_WE_start.p += DrawPoint(Eigen::Vector3d(-kStartOffset, -0.02, 0), Eigen::Vector3d::Constant(kStartOffset), rng);
    if ((planning.X_WE_goal.p - X_WE_start.p).norm() < kLeastWay) continue;
    const auto q_start = kinematics.Solve(X_WE_start, scene.arm().q_home);
    if (!q_start) continue;
    Place(scene, planning, checker);
    if (checker.Collides(*q_start, kMargin)) continue;
    const auto q_goal = kinematics.Solve(planning.X_WE_goal, *q_start);
    if (!q_goal || checker.Collides(*q_goal, kMargin)) continue;
    planning.q_start = *q_start;
    const bool blocked = difficulty == Difficulty::kNarrow || (difficulty == Difficulty::kCluttered && index % 2 == 1);
    if (blocked && !StraightIsBlocked(planning, X_WE_start, kinematics, checker)) continue;
    return planning;
  }
  return std::nullopt;
}

}  // namespace etude::plan
