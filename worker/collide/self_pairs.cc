// SPDX-License-Identifier: Apache-2.0
#include "worker/collide/self_pairs.h"

#include <algorithm>
#include <numbers>

#include "services/core/check.h"
#include "services/core/rng.h"

namespace etude::collide::internal {
namespace {

constexpr double kSame = 1e-6;  ///< m and rad; poses closer than this are the same

bool SamePose(const Pose& a, const Pose& b) { return (a.p - b.p).norm() < kSame && AngleBetween(a.q, b.q) < kSame; }

// Poses of all bodies, the world last.
std::vector<Pose> Poses(sim::Kinematics& kinematics, const Eigen::VectorXd& q, double gripper) {
  std::vector<Pose> poses = kinematics.ArmPoses(q, gripper);
  poses.push_back(Pose{});
  return poses;
}

void CountJoints(sim::Kinematics& kinematics, const Eigen::VectorXd& q, Eigen::MatrixXi& joints_between) {
  const std::vector<Pose> before = Poses(kinematics, q, 0);
  for (int joint = 0; joint < q.size(); ++joint) {
    Eigen::VectorXd moved = q;
    moved[joint] += 0.1;
    const std::vector<Pose> after = Poses(kinematics, moved, 0);
    for (std::size_t a = 0; a < before.size(); ++a)
      for (std::size_t b = 0; b < before.size(); ++b)
        if (!SamePose(before[a].inverse() * before[b], after[a].inverse() * after[b])) ++joints_between(a, b);
  }
}

}  // namespace

std::vector<Eigen::VectorXd> SpreadConfigurations(const sim::ArmInfo& arm, int count) {
  Rng rng(MixSeed({1}, "spread configurations"));
  const Eigen::VectorXd lower = arm.q_min.cwiseMax(-std::numbers::pi);
  const Eigen::VectorXd upper = arm.q_max.cwiseMin(std::numbers::pi);
  std::vector<Eigen::VectorXd> spread;
  for (int i = 0; i < count; ++i) {
    Eigen::VectorXd q(lower.size());
    for (int joint = 0; joint < q.size(); ++joint) q[joint] = rng.Uniform(lower[joint], upper[joint]);
    spread.push_back(q);
  }
  return spread;
}

ArmStructure FindStructure(const sim::ArmInfo& arm, sim::Kinematics& kinematics) {
  const int n = static_cast<int>(arm.bodies.size());
  ArmStructure structure;
  structure.joints_between = Eigen::MatrixXi::Zero(n + 1, n + 1);
  const Eigen::VectorXd q = SpreadConfigurations(arm, 1).front();
  CountJoints(kinematics, q, structure.joints_between);

  // the tool's body: the last that keeps the tool's pose when the arm and the gripper move
  const Eigen::VectorXd q_moved = SpreadConfigurations(arm, 2).back();
  const Pose X_WE = kinematics.X_WE(q), X_WE_moved = kinematics.X_WE(q_moved);
  const std::vector<Pose> open = Poses(kinematics, q, 0), closed = Poses(kinematics, q, 1);
  const std::vector<Pose> moved = Poses(kinematics, q_moved, 0);
  structure.tool_body = -1;
  for (int body = 0; body < n; ++body) {
    if (!SamePose(open[body], closed[body])) continue;
    if (!SamePose(open[body].inverse() * X_WE, moved[body].inverse() * X_WE_moved)) continue;
    structure.tool_body = body;
    structure.X_BE = open[body].inverse() * X_WE;
  }
  ETUDE_CHECK(structure.tool_body >= 0, "no body of the arm carries the tool");

  structure.with_tool.resize(n);
  for (int body = 0; body < n; ++body)
    structure.with_tool[body] = structure.joints_between(body, structure.tool_body) == 0;
  return structure;
}

}  // namespace etude::collide::internal
