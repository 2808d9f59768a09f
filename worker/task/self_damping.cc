// SPDX-License-Identifier: Apache-2.0
#include "worker/task/self_damping.h"

#include <algorithm>
#include <vector>

namespace etude::task {
namespace {

constexpr double kInfluence = 0.06;  // m
constexpr double kRest = 0.005;      // m
constexpr double kRate = 8;          // 1/s, a fifth of the controller's: what is asked of the arm is late by its lag
constexpr int kMostRounds = 50;
constexpr double kSmallChange = 1e-4;  // m/s

}  // namespace

VelocityDampers SelfDampers(collide::Checker& checker, sim::Kinematics& kinematics, const Eigen::VectorXd& q,
                            double gripper) {
  const collide::WithGripper measured(checker, gripper);
  const auto near = checker.Distances(q, kInfluence, collide::PairSet::kSelfApart);
  std::vector<sim::Kinematics::BodyPoint> points;
  for (const collide::Proximity& pair : near) {
    points.push_back({pair.body_a, pair.p_WA});
    points.push_back({pair.body_b, pair.p_WB});
  }
  VelocityDampers dampers;
  if (points.empty()) return dampers;
  const std::vector<Eigen::MatrixXd> jacobians = kinematics.PointJacobians(q, points);
  dampers.slopes.resize(static_cast<Eigen::Index>(near.size()), q.size());
  dampers.least.resize(dampers.slopes.rows());
  for (std::size_t i = 0; i < near.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    dampers.slopes.row(row) = near[i].normal.transpose() * (jacobians[2 * i] - jacobians[2 * i + 1]);
    dampers.least[row] = -kRate * std::max(0.0, near[i].distance - kRest);
  }
  return dampers;
}

// Hildreth's method: the bounds in turn, each with a multiplier that only pushes.
Eigen::VectorXd Damped(const Eigen::VectorXd& v, const VelocityDampers& dampers) {
  Eigen::VectorXd damped = v;
  if (dampers.Allow(v)) return damped;
  Eigen::VectorXd pushes = Eigen::VectorXd::Zero(dampers.least.size());
  for (int round = 0; round < kMostRounds; ++round) {
    double change = 0;
    for (Eigen::Index i = 0; i < pushes.size(); ++i) {
      const Eigen::VectorXd slope = dampers.slopes.row(i);
      const double square = slope.squaredNorm();
      if (square < 1e-8) continue;  // no joint moves these two apart
      const double missing = dampers.least[i] - slope.dot(damped);
      const double push = std::max(-pushes[i], missing / square);
      pushes[i] += push;
      damped += push * slope;
      change = std::max(change, std::abs(push) * square);
    }
    if (change < kSmallChange) break;
  }
  return damped;
}

}  // namespace etude::task
