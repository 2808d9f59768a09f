// SPDX-License-Identifier: Apache-2.0
// A compiled MuJoCo scene: robot, table, objects, camera and light, composed as MJCF from
// worker/assets. Immutable after Build and shared by any number of Worlds. Only worker/sim includes
// mujoco/*.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "services/core/result.h"
#include "services/episode/camera.h"
#include "services/spec/campaign_spec.h"

namespace etude::sim {

/// A convex piece of collision geometry, fixed to a body. Neutral: no MuJoCo and no FCL types.
struct Geometry {
  enum class Shape { kBox, kSphere, kCapsule, kCylinder, kConvex };
  std::string name;
  std::string body;  ///< body it is fixed to, e.g. "forearm", "coke", "world"
  Shape shape = Shape::kBox;
  Eigen::Vector3d size = Eigen::Vector3d::Zero();  ///< box: half sizes; sphere: radius; capsule,
                                                   ///< cylinder: radius, half length along z
  Pose X_BG;                                       ///< geometry in its body
  std::vector<Eigen::Vector3d> vertices;           ///< kConvex only, in G
};

/// Joints from which on a hand can be turned any way at any place.
inline constexpr std::size_t kJointsOfAnyPose = 6;

struct ArmInfo {
  std::vector<std::string> joints;  ///< arm joints, in order (data, never a constant count)
  Eigen::VectorXd q_home;           ///< (nq)
  Eigen::VectorXd q_min, q_max;     ///< (nq), rad
  Eigen::VectorXd torque_limit;     ///< (nu), N m
  Eigen::VectorXd joint_speed;      ///< (nv), rad/s, the published most of each joint
  /// (nv), rad/s, the most to plan for: less than joint_speed where a joint's damping would take too much of its torque
  Eigen::VectorXd planned_speed;
  std::vector<std::string> gripper_joints;
  std::vector<std::string> bodies;  ///< bodies of the robot, base to fingers (the base stands still)
  /// Groups of bodies that close on an object: it is grasped when each group touches it.
  std::vector<std::vector<std::string>> finger_groups;
  double gripper_open = 0;    ///< driven gripper joint when open, rad or m
  double gripper_closed = 0;  ///< driven gripper joint when closed on air
  /// rad below the horizontal from which the hand naturally comes at an object: 0 level, pi/2 from above
  double approach_pitch = 0;
  /// rad: pitch of the hand after it has turned an object over, a quarter of a turn from approach_pitch
  double turned_pitch = 0;
  /// Frame E: origin in the fingertip zone, x back along the hand, y along the opening.
  std::string tool_site;
  /// False of fewer than six joints: only a hand that points straight down comes to every place, turned any way about
  /// the vertical.
  bool turns_any_way() const { return joints.size() >= kJointsOfAnyPose; }
  /// Whether a pose of the tool leaves the joints a choice.
  bool is_redundant() const { return joints.size() > kJointsOfAnyPose; }
};

struct ObjectInfo {
  std::string name;
  Eigen::Vector3d half_extent;  ///< m, of the upright AABB
  double rest_height = 0;       ///< body origin above the table when it stands upright, m
  double mass = 0;              ///< kg
};

class Scene {
 public:
  /// @error kInvalidArgument: unknown robot or object; kInternal: MuJoCo refuses the MJCF (its
  /// message).
  static Result<std::shared_ptr<const Scene>> Build(const SceneSpec& spec);
  ~Scene();

  const ArmInfo& arm() const { return arm_; }
  const std::vector<ObjectInfo>& objects() const { return objects_; }  ///< order of spec.objects
  const Camera& camera() const { return camera_; }
  int body_count() const;                               ///< "world" included
  int control_delay() const { return control_delay_; }  ///< control steps (WorldSpec)
  /// Every collision piece: robot, table ("world") and objects, taken from the compiled model. The
  /// table is an infinite plane in the simulation and a slab with its top at z = 0 here.
  const std::vector<Geometry>& geometry() const { return geometry_; }
  const std::string& mjcf() const { return mjcf_; }
  const std::string& sha256() const { return sha256_; }  ///< of MJCF and assets

  struct Model;  ///< holds the mjModel
  const Model& model() const { return *model_; }

 private:
  Scene();
  ArmInfo arm_;
  std::vector<ObjectInfo> objects_;
  Camera camera_;
  int control_delay_ = 0;
  std::vector<Geometry> geometry_;
  std::string mjcf_, sha256_;
  std::unique_ptr<Model> model_;
};

}  // namespace etude::sim
