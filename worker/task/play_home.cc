// SPDX-License-Identifier: Apache-2.0
// What an arm holds is put down, then it comes back.
#include <algorithm>
#include <cmath>

#include "worker/plan/planner.h"
#include "worker/task/play_session.h"
#include "worker/task/primitives/tuning.h"

namespace etude::task {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;

constexpr double kHomeWithin = 0.03;    // m and
constexpr double kHomeTurn = 0.10;      // rad from where the scene began
constexpr double kHandSpeed = 0.15;     // m/s
constexpr double kBackOff = 0.10;       // m along the hand, out of what it was round
constexpr int kOpenSteps = 40;          // control steps that the fingers get to open
constexpr double kGapBelow = 0.002;     // m between a held object and the table when it is let go
constexpr std::uint64_t kHomeSeed = 1;  // of the planner

}  // namespace

bool PlaySession::Follow(const std::vector<Waypoint>& targets, const std::vector<Vector6d>& V, const Hook& hook) {
  for (std::size_t i = 0; i < targets.size(); ++i) {
    if (hook && !hook()) return false;
    GoOnSliding();
    environment_->world.Step(targets[i], V[i]);
    closed_ = targets[i].gripper > 0.5;
  }
  return true;
}

bool PlaySession::Straight(const Eigen::Vector3d& by, bool closed, const Hook& hook) {
  const int steps = std::max(1, static_cast<int>(std::ceil(by.norm() / kHandSpeed * kControlRate)));
  const Pose from = world().X_WE();
  std::vector<Waypoint> targets;
  Vector6d V = Vector6d::Zero();
  V.head<3>() = by / steps * kControlRate;
  for (int step = 1; step <= steps; ++step)
    targets.push_back({{from.p + by * step / steps, from.q}, closed ? 1.0 : 0.0});
  return Follow(targets, std::vector<Vector6d>(targets.size(), V), hook);
}

bool PlaySession::IsHome() const {
  const Pose home = environment_->planner.kinematics().X_WE(home_);
  const Pose now = world().X_WE();
  return !closed_ && (now.p - home.p).norm() < kHomeWithin && AngleBetween(now.q, home.q) < kHomeTurn;
}

bool PlaySession::StandsOnAnother(const std::string& object) const {
  const double z = world().ObjectPose(object).p.z();
  return std::ranges::any_of(world().ContactsOf(object), [&](const std::string& body) {
    const auto& objects = environment_->scene->objects();
    return std::ranges::find(objects, body, &sim::ObjectInfo::name) != objects.end() &&
           world().ObjectPose(body).p.z() < z;
  });
}

// What is held is put down where it is, or onto what stands there, the fingers open and back off, then the arm is
// planned to where the scene began. Where no way is found the arm stays: policies may start from anywhere, if not as
// well.
bool PlaySession::GoHome(const Hook& hook) {
  if (closed_) {
    double below = 0;
    std::string held;
    for (const auto& object : environment_->scene->objects()) {
      if (!world().Grasped(object.name)) continue;
      const Pose X_WO = world().ObjectPose(object.name);
      below = X_WO.p.z() - environment_->shapes.HeightOnTable(object.name, X_WO.q) - kGapBelow;
      held = object.name;
    }
    bool stands = false;
    const Hook until_it_stands = [&] {
      stands = StandsOnAnother(held);
      return !stands && (!hook || hook());
    };
    if (below > 0 && !Straight({0, 0, -below}, true, until_it_stands) && !stands) return false;
    const Waypoint open{world().X_WE(), 0};
    if (!Follow(std::vector<Waypoint>(kOpenSteps, open), std::vector<Vector6d>(kOpenSteps, Vector6d::Zero()), hook))
      return false;
    // x of E points back along the hand
    if (!Straight(kBackOff * (world().X_WE().q * Eigen::Vector3d::UnitX()), false, hook)) return false;
  }
  collide::Checker& checker = environment_->checker;
  checker.ClearObjects();
  for (const auto& object : environment_->scene->objects())
    if (!hidden(object.name)) checker.SetObject(object.name, world().ObjectPose(object.name));
  checker.SetGripper(0);
  plan::Planner planner(environment_->scene);
  plan::Request request;
  request.q_start = world().q();
  request.q_goal = home_;
  request.X_WE_goal = environment_->planner.kinematics().X_WE(home_);
  request.limits.joint = kStages.planned_speed * environment_->scene->arm().planned_speed.minCoeff();
  const plan::Outcome outcome = planner.Plan(request, checker, kHomeSeed);
  if (!outcome.planned()) return true;
  std::vector<Waypoint> targets;
  for (const Pose& X_WE : outcome.motion.X_WE) targets.push_back({X_WE, 0});
  return Follow(targets, outcome.motion.V_WE, hook);
}

}  // namespace etude::task
