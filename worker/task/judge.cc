// SPDX-License-Identifier: Apache-2.0
#include "worker/task/judge.h"

#include <algorithm>
#include <cmath>

#include "services/core/enum_name.h"
#include "services/episode/action.h"

namespace etude::task {
namespace {

constexpr std::size_t kMostViolations = 100;  // that are listed

// Bodies are few: a search through their names is the cheapest.
bool IsOf(const std::vector<std::string>& bodies, std::string_view body) {
  return std::ranges::find(bodies, body) != bodies.end();
}

bool GraspedBy(const std::vector<std::vector<std::string>>& groups, const ObjectState& object) {
  return std::ranges::all_of(groups, [&](const auto& group) {
    return std::ranges::any_of(object.contacts, [&](std::string_view body) { return IsOf(group, body); });
  });
}

}  // namespace

std::string_view ToString(Violation::Kind kind) {
  return EnumName(kind,
                  {{Violation::Kind::kContact, "contact"},
                   {Violation::Kind::kSelfContact, "self_contact"},
                   {Violation::Kind::kJointSpeed, "joint_speed"},
                   {Violation::Kind::kTorque, "torque"}},
                  "unknown");
}

Result<Judge> Judge::Make(const JudgeCase& judged, const sim::World& world, const SceneGeometry& shapes,
                          collide::Checker* checker) {
  Cast cast{.target = judged.target, .reference = judged.reference};
  Judge judge;
  for (const auto& object : world.scene().objects()) {
    cast.objects.push_back(object.name);
    const Pose X_WO = world.ObjectPose(object.name);
    judge.now_[object.name] = {
        .X_WO = X_WO, .X_WO_start = X_WO, .centre = shapes.Centre(object.name), .half_extent = object.half_extent};
    if (object.name != judged.target) judge.moved_[object.name] = 0;
  }
  ETUDE_ASSIGN_OR_RETURN(judge.strict_, MakePredicate(judged.criteria.success, cast));
  ETUDE_ASSIGN_OR_RETURN(judge.latched_, MakePredicate(judged.criteria.latched, cast));
  judge.case_ = judged;
  judge.checker_ = checker;
  judge.torque_steps_.assign(world.scene().arm().joints.size(), 0);
  return judge;
}

void Judge::Observe(const sim::World& world) {
  ObserveObjects(world);
  const bool strict = strict_->Observe(now_);
  if (latched_->Observe(now_) && latched_step_ < 0) latched_step_ = step_;
  held_ = strict && success_latched() ? held_ + 1 : 0;
  if (held_ >= kDwell && done_step_ < 0) done_step_ = step_;
  ObserveContacts(world);
  ObserveArm(world);
  ++step_;
}

void Judge::Displaced(const sim::World& world, const std::string& object) {
  now_.at(object).X_WO_start = world.ObjectPose(object);
}

void Judge::ObserveObjects(const sim::World& world) {
  for (auto& [name, object] : now_) {
    const Pose X_WO = world.ObjectPose(name);
    object.speed = (X_WO.p - object.X_WO.p).norm() * kControlRate;
    object.X_WO = X_WO;
    object.contacts.clear();
    const auto moved = moved_.find(name);
    if (moved != moved_.end()) moved->second = std::max(moved->second, (X_WO.p - object.X_WO_start.p).norm());
  }
  for (const auto& [a, b] : world.Contacts()) {
    if (const auto it = now_.find(std::string(a)); it != now_.end()) it->second.contacts.push_back(b);
    if (const auto it = now_.find(std::string(b)); it != now_.end()) it->second.contacts.push_back(a);
  }
  // two bodies that touch in several points touch once
  for (auto& [name, object] : now_) {
    std::ranges::sort(object.contacts);
    const auto again = std::ranges::unique(object.contacts);
    object.contacts.erase(again.begin(), again.end());
  }
  const sim::ArmInfo& arm = world.scene().arm();
  for (auto& [name, object] : now_) {
    object.touched =
        std::ranges::any_of(object.contacts, [&](std::string_view body) { return IsOf(arm.bodies, body); });
    object.grasped = object.touched && GraspedBy(arm.finger_groups, object);
  }
  touched_ = touched_ || StateOf(now_, case_.target).touched;
}

void Judge::ObserveContacts(const sim::World& world) {
  const auto& arm = world.scene().arm().bodies;
  for (const auto& avoided : case_.avoid)
    for (const std::string_view body : StateOf(now_, avoided).contacts)
      if (body == case_.target || IsOf(arm, body))
        Note(Violation::Kind::kContact, std::string(body) + "-" + avoided, step_, 0);
}

void Judge::ObserveArm(const sim::World& world) {
  for (const auto& overlap : checker_->SelfOverlaps(world.ArmPoses(), kSelfContactDepth))
    Note(Violation::Kind::kSelfContact, overlap.body_a + "-" + overlap.body_b, step_, overlap.depth);
  const sim::ArmInfo& arm = world.scene().arm();
  const Eigen::VectorXd v = world.v();
  const Eigen::VectorXd& torque = world.demanded_torque();
  for (Eigen::Index i = 0; i < v.size(); ++i) {
    const std::string& joint = arm.joints[static_cast<std::size_t>(i)];
    const double speed = std::abs(v[i]) / arm.joint_speed[i];
    if (speed > kSpeedShare) Note(Violation::Kind::kJointSpeed, joint, step_, speed);
    const double demanded = std::abs(torque[i]) / arm.torque_limit[i];
    int& steps = torque_steps_[static_cast<std::size_t>(i)];
    steps = demanded > 1 ? steps + 1 : 0;
    if (steps > kTorqueSteps) Note(Violation::Kind::kTorque, joint, step_ - kTorqueSteps, demanded);
  }
}

// One entry for a run of steps. `first_step` is where a run began that is noted for the first time.
void Judge::Note(Violation::Kind kind, const std::string& what, int first_step, double worst) {
  for (auto& known : violations_) {
    if (known.kind != kind || known.what != what || known.step + known.steps != step_) continue;
    ++known.steps;
    known.worst = std::max(known.worst, worst);
    return;
  }
  if (violations_.size() >= kMostViolations) return;
  violations_.push_back({kind, what, first_step, step_ - first_step + 1, worst});
}

std::vector<std::string> Judge::disturbed() const {
  std::vector<std::string> names;
  for (const auto& [name, distance] : moved_)
    if (distance > kDisturbedDistance) names.push_back(name);
  return names;
}

OrderedJson Judge::Report() const {
  OrderedJson violations = OrderedJson::array();
  for (const auto& violation : violations_)
    violations.push_back({{"kind", ToString(violation.kind)},
                          {"what", violation.what},
                          {"step", violation.step},
                          {"steps", violation.steps},
                          {"worst", violation.worst}});
  return {{"success_latched", success_latched()},
          {"done_step", done_step_},
          {"latched_step", latched_step_},
          {"violations", std::move(violations)},
          {"disturbed_objects", disturbed()}};
}

}  // namespace etude::task
