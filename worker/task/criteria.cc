// SPDX-License-Identifier: Apache-2.0
#include "worker/task/criteria.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "services/core/check.h"
#include "services/episode/action.h"
#include "services/episode/task_name.h"

namespace etude::task {

SuccessCriterion::SuccessCriterion(std::string task, const Pose& X_WO_start)
    : task_(std::move(task)), X_WO_start_(X_WO_start), p_before_(X_WO_start.p) {
  const auto& known = BaseTasks();
  ETUDE_CHECK(std::find(known.begin(), known.end(), task_) != known.end(), "task={}", task_);
}

void SuccessCriterion::Observe(const Observed& now) {
  if (task_ == "put_down" || task_ == "rotate") return ObserveTurn(now.X_WO);
  const Eigen::Vector3d moved = now.X_WO.p - X_WO_start_.p;
  const double distance = task_ == "push" ? moved.y() : moved.z();
  progress_ = std::max(progress_, distance);
  moved_ = moved_ || distance > (task_ == "push" ? kPushDistance : kPickRise);
  if (task_ != "push" && task_ != "pick") ObserveRelation(now);
}

void SuccessCriterion::ObserveTurn(const Pose& X_WO) {
  const double height = X_WO.p.z();
  progress_ = std::max(progress_, height);
  const bool over = TurnError(X_WO, X_WO_start_) < kTurnTolerance;
  if (lifted_) {
    turned_ = turned_ || (over && (task_ == "put_down" || height > kLaidHeight));
    laid_ = laid_ || height < kLaidHeight;
  }
  lifted_ = lifted_ || height > kLiftedHeight;
}

void SuccessCriterion::ObserveRelation(const Observed& now) {
  const double speed = (now.X_WO.p - p_before_).norm() * kControlRate;
  p_before_ = now.X_WO.p;
  rested_ = speed < kAtRest && !now.held ? rested_ + 1 : 0;
  beside_ = beside_ || (moved_ && rested_ >= kRestSteps && IsBeside(task_, now.X_WO.p, now.X_WR.p));
}

bool SuccessCriterion::success() const {
  if (task_ == "put_down") return lifted_ && turned_ && laid_;
  if (task_ == "rotate") return turned_;
  return task_ == "push" || task_ == "pick" ? moved_ : beside_;
}

double TurnError(const Pose& X_WO, const Pose& X_WO_start) {
  const Eigen::Vector3d euler = ToEuler(X_WO.q * X_WO_start.q.conjugate());
  const Eigen::Vector3d quarter(std::numbers::pi / 2, 0, 0);
  return std::min((euler - quarter).norm(), (euler + quarter).norm());
}

Eigen::Vector3d DirectionOf(const std::string& relation) {
  if (relation == "place_left") return Eigen::Vector3d::UnitX();
  if (relation == "place_right") return -Eigen::Vector3d::UnitX();
  if (relation == "place_front") return Eigen::Vector3d::UnitY();
  ETUDE_CHECK(relation == "place_behind", "task={}", relation);
  return -Eigen::Vector3d::UnitY();
}

bool IsBeside(const std::string& relation, const Eigen::Vector3d& p_WO, const Eigen::Vector3d& p_WR) {
  const Eigen::Vector3d direction = DirectionOf(relation);
  Eigen::Vector3d d = p_WO - p_WR;
  d.z() = 0;
  const double along = d.dot(direction);
  return along > kBesideNear && along < kBesideFar && (d - along * direction).norm() < kBesideAside;
}

bool LiesDown(const Pose& X_WO) {
  const Eigen::Vector3d up = X_WO.q * Eigen::Vector3d::UnitZ();
  return std::abs(up.z()) < std::sin(kLyingTilt) && X_WO.p.z() < kLaidHeight;
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
