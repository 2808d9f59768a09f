// SPDX-License-Identifier: Apache-2.0
#include "worker/task/motion_check.h"

#include <fmt/format.h>

#include <algorithm>

#include "worker/plan/planner.h"
#include "worker/task/primitives/tuning.h"

namespace etude::task {
namespace {

using Eigen::Vector3d;
using Vector6 = Eigen::Matrix<double, 6, 1>;

constexpr double kWay = 0.10;       // m
constexpr double kTurn = 0.6;       // rad
constexpr int kRest = 50;           // control steps after a motion until it counts as at rest
constexpr double kParkedAside = 3;  // m, where no arm meets the objects
constexpr plan::Limits kSpeeds{.linear = 0.70, .angular = 2.4, .linear_accel = 3.5, .angular_accel = 12.0};

struct Way {
  std::string name;
  Pose goal;
};

std::vector<Way> Ways(const Pose& home) {
  std::vector<Way> ways;
  for (int axis = 0; axis < 3; ++axis)
    for (const int sign : {1, -1})
      ways.push_back({fmt::format("10 cm along {}{}", sign > 0 ? '+' : '-', "xyz"[axis]),
                      {home.p + sign * kWay * Vector3d::Unit(axis), home.q}});
  for (const int sign : {1, -1})
    ways.push_back({fmt::format("{:+.1f} rad about the hand's axis", sign * kTurn),
                    {home.p, home.q * Eigen::Quaterniond(Eigen::AngleAxisd(sign * kTurn, Vector3d::UnitX()))}});
  return ways;
}

class Mover {
 public:
  explicit Mover(const std::shared_ptr<const sim::Scene>& scene)
      : scene_(scene), world_(scene), checker_(scene), planner_(scene) {}

  MotionCheck Run() {
    ParkObjects(*scene_, world_);
    const Pose home = world_.X_WE();
    for (const Way& way : Ways(home)) ThereAndBack(way, home);
    check_.healthy = world_.healthy();
    return std::move(check_);
  }

 private:
  void ThereAndBack(const Way& way, const Pose& home) {
    const Eigen::VectorXd q_home = scene_->arm().q_home;
    sim::Kinematics kinematics(scene_);
    const auto q_there = kinematics.Solve(way.goal, q_home);
    const plan::Outcome there = Plan(q_home, way.goal);
    const plan::Outcome back = q_there ? Plan(*q_there, home) : plan::Outcome{};
    if (!there.planned() || !back.planned()) {
      check_.skipped.push_back(fmt::format("{} ({})", way.name, there.planned() ? back.reason : there.reason));
      return;
    }
    ++check_.motions;
    Play(way.name, there.motion);
    Play(way.name + ", back", back.motion);
  }

  plan::Outcome Plan(const Eigen::VectorXd& q, const Pose& goal) {
    plan::Request request{.q_start = q, .X_WE_goal = goal, .limits = kSpeeds, .straight_only = true};
    request.limits.joint = kStages.planned_speed * scene_->arm().planned_speed.minCoeff();
    return planner_.Plan(request, checker_, 1);
  }

  void Play(const std::string& name, const plan::Motion& motion) {
    const Pose& goal = motion.X_WE.back();
    for (int t = 0; t < motion.steps() + kRest; ++t) {
      const bool moves = t < motion.steps();
      const Pose& X_WE = moves ? motion.X_WE[t] : goal;
      world_.Step({X_WE, 0}, moves ? motion.V_WE[t] : Vector6(Vector6::Zero()));
      check_.effort.Observe(world_, "");
      const double lag = (world_.X_WE().p - X_WE.p).norm();
      if (lag > check_.lag) check_.worst = name;
      check_.lag = std::max(check_.lag, lag);
      check_.lag_angle = std::max(check_.lag_angle, AngleBetween(world_.X_WE().q, X_WE.q));
    }
    check_.rest = std::max(check_.rest, (world_.X_WE().p - goal.p).norm());
    check_.rest_angle = std::max(check_.rest_angle, AngleBetween(world_.X_WE().q, goal.q));
  }

  std::shared_ptr<const sim::Scene> scene_;
  sim::World world_;
  collide::Checker checker_;
  plan::Planner planner_;
  MotionCheck check_;
};

}  // namespace

void ParkObjects(const sim::Scene& scene, sim::World& world) {
  double aside = kParkedAside;
  for (const auto& object : scene.objects())
    world.SetObject(object.name, {{aside += 0.5, kParkedAside, object.rest_height}, Eigen::Quaterniond::Identity()});
  world.Forward();
}

MotionCheck CheckMotion(const std::shared_ptr<const sim::Scene>& scene) { return Mover(scene).Run(); }

}  // namespace etude::task
