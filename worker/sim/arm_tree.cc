// SPDX-License-Identifier: Apache-2.0
#include "worker/sim/arm_tree.h"

#include <algorithm>

#include "services/core/check.h"

namespace etude::sim {
namespace {

Eigen::Vector3d VectorAt(const mjtNum* values, int index) { return Eigen::Vector3d::Map(values + 3 * index); }

Eigen::Quaterniond QuaternionAt(const mjtNum* values) {
  return Eigen::Quaterniond(values[0], values[1], values[2], values[3]).normalized();
}

}  // namespace

ArmTree::ArmTree(const mjModel& mj, int tool_site, const std::vector<int>& arm_q)
    : index_of_(static_cast<std::size_t>(mj.nbody), -1), columns_(static_cast<int>(arm_q.size())) {
  for (int body = 0; body < mj.nbody; ++body) {
    const int parent = mj.body_parentid[body], first = mj.body_jntadr[body], count = mj.body_jntnum[body];
    if (index_of_[parent] < 0 && body > 0) continue;
    if (count > 0 && mj.jnt_type[first] == mjJNT_FREE) continue;
    index_of_[body] = static_cast<int>(bodies_.size());
    bodies_.push_back({index_of_[parent],
                       {VectorAt(mj.body_pos, body), QuaternionAt(mj.body_quat + 4 * body)},
                       static_cast<int>(joints_.size()),
                       count});
    for (int joint = first; joint < first + count; ++joint) {
      const int q = mj.jnt_qposadr[joint];
      const auto column = std::ranges::find(arm_q, q);
      joints_.push_back({mj.jnt_type[joint], q, column == arm_q.end() ? -1 : static_cast<int>(column - arm_q.begin()),
                         mj.qpos0[q], VectorAt(mj.jnt_axis, joint), VectorAt(mj.jnt_pos, joint)});
    }
  }
  tool_body_ = IndexOf(mj.site_bodyid[tool_site]);
  X_BE_ = {VectorAt(mj.site_pos, tool_site), QuaternionAt(mj.site_quat + 4 * tool_site)};
  for (int index = tool_body_; index > 0; index = bodies_[index].parent) tool_chain_.push_back(index);
  std::ranges::reverse(tool_chain_);
}

int ArmTree::IndexOf(int body) const {
  ETUDE_CHECK(index_of_.at(static_cast<std::size_t>(body)) >= 0, "body {} is an object's", body);
  return index_of_[body];
}

void ArmTree::PlaceBody(int index, const mjtNum* qpos, Frames& frames) const {
  const Body& body = bodies_[index];
  Pose X_WB = frames.X_WB[body.parent] * body.X_PB;
  for (int i = body.first_joint; i < body.first_joint + body.joint_count; ++i) {
    const Joint& joint = joints_[i];
    const Eigen::Vector3d p_WJ = X_WB * joint.p_BJ, axis_W = X_WB.q * joint.axis_B;
    if (joint.type == mjJNT_SLIDE) {
      X_WB.p += (qpos[joint.q] - joint.rest) * axis_W;
    } else {
      X_WB.q *= joint.type == mjJNT_HINGE
                    ? Eigen::Quaterniond(Eigen::AngleAxisd(qpos[joint.q] - joint.rest, joint.axis_B))
                    : QuaternionAt(qpos + joint.q);
      X_WB.p = p_WJ - X_WB.q * joint.p_BJ;
    }
    frames.p_WJ[i] = p_WJ;
    frames.axis_W[i] = axis_W;
  }
  frames.X_WB[index] = X_WB;
}

void ArmTree::Fit(Frames& frames) const {
  frames.X_WB.resize(bodies_.size());
  frames.p_WJ.resize(joints_.size());
  frames.axis_W.resize(joints_.size());
}

void ArmTree::PlaceTool(const mjtNum* qpos, Frames& frames) const {
  Fit(frames);
  for (const int index : tool_chain_) PlaceBody(index, qpos, frames);
}

void ArmTree::PlaceAll(const mjtNum* qpos, Frames& frames) const {
  Fit(frames);
  for (int index = 1; index < static_cast<int>(bodies_.size()); ++index) PlaceBody(index, qpos, frames);
}

template <class Each>
void ArmTree::ForJointsUnder(int index, Each each) const {
  for (; index > 0; index = bodies_[index].parent)
    for (int i = bodies_[index].first_joint; i < bodies_[index].first_joint + bodies_[index].joint_count; ++i)
      if (joints_[i].column >= 0) each(joints_[i], i);
}

void ArmTree::ToolJacobian(const Frames& frames, Matrix6Xd& J) const {
  J.setZero(6, columns_);
  const Eigen::Vector3d p_WE = X_WE(frames).p;
  ForJointsUnder(tool_body_, [&](const Joint& joint, int i) {
    if (joint.type == mjJNT_SLIDE) {
      J.col(joint.column).head<3>() = frames.axis_W[i];
      return;
    }
    J.col(joint.column).head<3>() = frames.axis_W[i].cross(p_WE - frames.p_WJ[i]);
    J.col(joint.column).tail<3>() = frames.axis_W[i];
  });
}

Eigen::MatrixXd ArmTree::PointJacobian(const Frames& frames, int index, const Eigen::Vector3d& p_W) const {
  Eigen::MatrixXd J = Eigen::MatrixXd::Zero(3, columns_);
  ForJointsUnder(index, [&](const Joint& joint, int i) {
    J.col(joint.column) = joint.type == mjJNT_SLIDE ? frames.axis_W[i] : frames.axis_W[i].cross(p_W - frames.p_WJ[i]);
  });
  return J;
}

}  // namespace etude::sim
