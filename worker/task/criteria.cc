// SPDX-License-Identifier: Apache-2.0
#include "worker/task/criteria.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "services/core/check.h"

namespace etude::task {

SuccessCriterion::SuccessCriterion(std::string task, const Pose& X_WO_start)
    : task_(std::move(task)), X_WO_start_(X_WO_start) {
  ETUDE_CHECK(task_ == "pick" || task_ == "push" || task_ == "put_down", "task={}", task_);
}

void SuccessCriterion::Observe(const Pose& X_WO) {
  if (task_ == "put_down") {
    const double height = X_WO.p.z();
    progress_ = std::max(progress_, height);
    if (lifted_) {
      turned_ = turned_ || TurnError(X_WO, X_WO_start_) < kTurnTolerance;
      laid_ = laid_ || height < kLaidHeight;
    }
    lifted_ = lifted_ || height > kLiftedHeight;
    return;
  }
  const Eigen::Vector3d moved = X_WO.p - X_WO_start_.p;
  const double distance = task_ == "pick" ? moved.z() : moved.y();
  progress_ = std::max(progress_, distance);
  moved_ = moved_ || distance > (task_ == "pick" ? kPickRise : kPushDistance);
}

bool SuccessCriterion::success() const { return task_ == "put_down" ? lifted_ && turned_ && laid_ : moved_; }

double TurnError(const Pose& X_WO, const Pose& X_WO_start) {
  const Eigen::Vector3d euler = ToEuler(X_WO.q * X_WO_start.q.conjugate());
  return (euler - Eigen::Vector3d(-std::numbers::pi / 2, 0, 0)).norm();
}

bool LiesDown(const Pose& X_WO) {
  const Eigen::Vector3d up = X_WO.q * Eigen::Vector3d::UnitZ();
  return std::abs(up.z()) < std::sin(0.35) && X_WO.p.z() < kLaidHeight;
}

DisturbanceWatch::DisturbanceWatch(std::vector<std::pair<std::string, Pose>> others) {
  for (const auto& [name, X_WO] : others) entries_[name].start = X_WO.p;
}

void DisturbanceWatch::Observe(const std::string& name, const Pose& X_WO) {
  const auto it = entries_.find(name);
  if (it == entries_.end()) return;
  it->second.most = std::max(it->second.most, (X_WO.p - it->second.start).norm());
}

std::vector<std::string> DisturbanceWatch::disturbed() const {
  std::vector<std::string> names;
  for (const auto& [name, entry] : entries_)
    if (entry.most > kDisturbedDistance) names.push_back(name);
  return names;
}

}  // namespace etude::task
