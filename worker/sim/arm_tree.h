// SPDX-License-Identifier: Apache-2.0
// Private to worker/sim: where the bodies of an arm are, apart from the rest of the scene.
#pragma once

#include <mujoco/mujoco.h>

#include <Eigen/Core>
#include <vector>

#include "services/episode/pose.h"

namespace etude::sim {

using Matrix6Xd = Eigen::Matrix<double, 6, Eigen::Dynamic>;

/// Forward kinematics and Jacobians of all bodies but the objects. Does what mj_kinematics, mj_comPos and mj_jac do,
/// but those go through every object, geom and site of a scene: plans took 2.4 times as long with them. Immutable:
/// threads may share one.
class ArmTree {
 public:
  /// What Place* write. One per thread.
  struct Frames {
    std::vector<Pose> X_WB;               ///< of the bodies, in the order of IndexOf
    std::vector<Eigen::Vector3d> p_WJ;    ///< m, anchor of each joint
    std::vector<Eigen::Vector3d> axis_W;  ///< unit, of each joint
  };

  ArmTree() = default;
  /// @param arm_q  addresses in qpos of the arm's joints: the columns of Jacobians
  ArmTree(const mjModel& mj, int tool_site, const std::vector<int>& arm_q);

  /// Place of a body (MuJoCo's id) in Frames::X_WB; checked: objects have none.
  int IndexOf(int body) const;
  /// The bodies and joints from the world to the tool; what Frames has of others stays as it was.
  void PlaceTool(const mjtNum* qpos, Frames& frames) const;
  void PlaceAll(const mjtNum* qpos, Frames& frames) const;

  Pose X_WE(const Frames& frames) const { return frames.X_WB[tool_body_] * X_BE_; }
  /// (6, n), linear rows first, in world.
  void ToolJacobian(const Frames& frames, Matrix6Xd& J) const;
  /// (3, n) of the velocity in world of point `p_W` (m) of the body at `index`.
  Eigen::MatrixXd PointJacobian(const Frames& frames, int index, const Eigen::Vector3d& p_W) const;

 private:
  struct Joint {
    int type = 0;     ///< mjtJoint: hinge, slide or ball
    int q = 0;        ///< address in qpos
    int column = -1;  ///< of Jacobians; -1: of the gripper, held
    double rest = 0;  ///< rad or m of qpos at which the body is as the model has it
    Eigen::Vector3d axis_B, p_BJ;
  };
  struct Body {
    int parent = 0;
    Pose X_PB;  ///< with its joints at rest
    int first_joint = 0, joint_count = 0;
  };
  void Fit(Frames& frames) const;  ///< to as many bodies and joints
  void PlaceBody(int index, const mjtNum* qpos, Frames& frames) const;
  template <class Each>
  void ForJointsUnder(int index, Each each) const;  ///< the arm's joints that move a body

  std::vector<Body> bodies_;  ///< parents first; 0 is the world
  std::vector<Joint> joints_;
  std::vector<int> index_of_;    ///< by MuJoCo's id; -1: an object's
  std::vector<int> tool_chain_;  ///< indices, base to tool, without the world
  int tool_body_ = 0, columns_ = 0;
  Pose X_BE_;
};

}  // namespace etude::sim
