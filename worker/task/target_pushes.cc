// SPDX-License-Identifier: Apache-2.0
#include "worker/task/target_pushes.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "worker/task/smooth_step.h"

namespace etude::task {
namespace {

constexpr int kDraws = 30;       // of a way, at each step
constexpr int kPlacesOfWay = 4;  // that are checked against the robot

}  // namespace

TargetPushes::TargetPushes(const TargetPushSpec& spec, std::uint64_t seed, EpisodeRunner* runner,
                           collide::Checker* checker)
    : spec_(spec), runner_(runner), checker_(checker), rng_(seed) {
  const auto window = static_cast<std::uint64_t>(spec.latest - spec.earliest + 1);
  for (int i = 0; i < spec.count; ++i) due_.push_back(spec.earliest + static_cast<int>(rng_.Below(window)));
  std::sort(due_.begin(), due_.end());
}

void TargetPushes::BeforeStep() {
  if (runner_->judge().touched()) {
    if (std::exchange(under_way_, false)) pushes_.back().end = runner_->world().ObjectPose(runner_->plan().target).p;
    next_ = due_.size();
  }
  if (under_way_) return GoOn();
  const int step = runner_->steps();
  if (next_ == due_.size() || step < due_[next_] || step > spec_.latest) return;
  if (Begin()) GoOn();
}

bool TargetPushes::Begin() {
  const std::string& target = runner_->plan().target;
  const Pose X_WO = runner_->world().ObjectPose(target);
  const auto by = DrawWay(X_WO);
  if (!by) return false;
  ++next_;
  pushes_.push_back({.step = runner_->steps(), .from = X_WO, .by = *by, .end = X_WO.p});
  return under_way_ = true;
}

void TargetPushes::GoOn() {
  Push& push = pushes_.back();
  push.end = runner_->world().ObjectPose(runner_->plan().target).p;
  if (push.steps == kTargetPushSteps) {
    under_way_ = false;
    return;
  }
  const double s = static_cast<double>(++push.steps) / kTargetPushSteps;
  const double rate = SmoothStepRate(s) * kControlRate / kTargetPushSteps;  // 1/s
  runner_->PushObject(runner_->plan().target, {push.from.p + SmoothStep(s) * push.by, push.from.q}, rate * push.by);
}

std::optional<Eigen::Vector3d> TargetPushes::DrawWay(const Pose& X_WO) {
  for (int draw = 0; draw < kDraws; ++draw) {
    const double angle = rng_.Uniform(0, 2 * std::numbers::pi);
    const double length = rng_.Uniform(spec_.least, spec_.most);
    const Eigen::Vector3d by(length * std::cos(angle), length * std::sin(angle), 0);
    if (MayStandAt(X_WO.p + by) && ClearOfRobot(X_WO, by)) return by;
  }
  return std::nullopt;
}

bool TargetPushes::MayStandAt(const Eigen::Vector3d& p) const {
  const sim::World& world = runner_->world();
  const EpisodePlan& plan = runner_->plan();
  const auto& boxes = plan.task.spec->start.roomy() ? RoomyBoxes() : LocationBoxes();
  const bool in_reach = std::ranges::any_of(boxes, [&](const LocationBox& box) {
    return p.x() >= box.x_min && p.x() <= box.x_max && p.y() >= box.y_min && p.y() <= box.y_max;
  });
  if (!in_reach) return false;
  const auto& objects = world.scene().objects();
  return std::ranges::all_of(objects, [&](const sim::ObjectInfo& object) {
    return object.name == plan.target ||
           StandApart(runner_->shapes().object(plan.target), p, object, world.ObjectPose(object.name).p);
  });
}

bool TargetPushes::ClearOfRobot(const Pose& X_WO, const Eigen::Vector3d& by) {
  const std::string& target = runner_->plan().target;
  const Eigen::VectorXd q = runner_->world().q();
  checker_->Allow({});
  const collide::WithGripper measured(*checker_, runner_->world().gripper());
  bool clear = true;
  for (int place = 0; place < kPlacesOfWay && clear; ++place) {
    const double share = static_cast<double>(place) / (kPlacesOfWay - 1);
    checker_->SetObject(target, {X_WO.p + share * by, X_WO.q});
    const auto near = checker_->Distances(q, kTargetPushClearance);
    clear = std::ranges::none_of(near, [&](const collide::Proximity& pair) { return pair.body_b == target; });
  }
  checker_->SetObject(target, X_WO);
  return clear;
}

OrderedJson TargetPushes::Report() const {
  OrderedJson list = OrderedJson::array();
  for (const Push& push : pushes_)
    list.push_back({{"step", push.step},
                    {"steps", push.steps},
                    {"from", {push.from.p.x(), push.from.p.y()}},
                    {"to", {push.end.x(), push.end.y()}}});
  return list;
}

int TargetPushes::missed() const { return spec_.count - static_cast<int>(pushes_.size()); }

}  // namespace etude::task
