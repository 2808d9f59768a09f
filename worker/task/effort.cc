// SPDX-License-Identifier: Apache-2.0
#include "worker/task/effort.h"

#include <algorithm>
#include <cmath>
#include <set>

namespace etude::task {

void Effort::Observe(const sim::World& world, const std::string& wanted) {
  const sim::ArmInfo& arm = world.scene().arm();
  if (joints_.empty())
    for (std::size_t i = 0; i < arm.joints.size(); ++i)
      joints_.push_back({.name = arm.joints[i], .limit = arm.torque_limit[static_cast<Eigen::Index>(i)]});
  ++steps_;
  const Eigen::VectorXd& demanded = world.demanded_torque();
  for (std::size_t i = 0; i < joints_.size(); ++i) {
    const double demand = std::abs(demanded[static_cast<Eigen::Index>(i)]);
    joints_[i].demand = std::max(joints_[i].demand, demand);
    if (demand > joints_[i].limit) ++joints_[i].steps;
  }
  std::set<std::pair<std::string, std::string>> now;  // a pair has a contact or four
  const auto is_arm = [&](std::string_view body) { return std::ranges::find(arm.bodies, body) != arm.bodies.end(); };
  for (auto [a, b] : world.Contacts()) {
    if (!is_arm(a)) std::swap(a, b);
    if (is_arm(a) && !is_arm(b) && b != wanted) now.emplace(a, b);
  }
  for (const auto& pair : now) ++touches_[pair];
}

void Effort::Add(const std::vector<Violation>& violations) {
  for (const Violation& violation : violations)
    if (violation.kind == Violation::Kind::kSelfContact) touches_[{violation.what, ""}] += violation.steps;
}

void Effort::Add(const Effort& other) {
  steps_ += other.steps_;
  if (joints_.empty()) joints_.resize(other.joints_.size());
  for (std::size_t i = 0; i < other.joints_.size(); ++i) {
    const Joint& more = other.joints_[i];
    joints_[i] = {.name = more.name,
                  .limit = more.limit,
                  .demand = std::max(joints_[i].demand, more.demand),
                  .steps = joints_[i].steps + more.steps};
  }
  for (const auto& [pair, steps] : other.touches_) touches_[pair] += steps;
}

std::vector<Effort::Joint> Effort::Saturated() const {
  std::vector<Joint> saturated;
  std::ranges::copy_if(joints_, std::back_inserter(saturated), [](const Joint& joint) { return joint.steps > 0; });
  std::ranges::stable_sort(saturated, std::greater(), &Joint::steps);
  return saturated;
}

std::vector<Effort::Touch> Effort::Touches() const {
  std::vector<Touch> touches;
  for (const auto& [pair, steps] : touches_) touches.push_back({pair.first, pair.second, steps});
  std::ranges::stable_sort(touches, std::greater(), &Touch::steps);
  return touches;
}

}  // namespace etude::task
