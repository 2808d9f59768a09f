// SPDX-License-Identifier: Apache-2.0
// The state of one simulation. One World per thread; the Scene is shared.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "services/episode/action.h"
#include "worker/sim/scene.h"

namespace etude::sim {

/// Physics runs at 500 Hz: 4 steps per control step of 8 ms.
inline constexpr int kPhysicsStepsPerControl = 4;

class World {
 public:
  explicit World(std::shared_ptr<const Scene> scene);
  World(World&&) noexcept;
  ~World();

  const Scene& scene() const { return *scene_; }

  /// Everything to the model's initial state: home arm, open gripper, zero velocities and warm
  /// starts. After Reset the future depends only on what is set and commanded next.
  void Reset();
  void SetArm(const Eigen::VectorXd& q);  ///< at rest there; call Forward() after the last Set*
  void SetObject(const std::string& name, const Pose& X_WO);
  /// Recomputes positions and contacts after Set*, without moving time.
  void Forward();

  /// One control step (8 ms): operational-space control towards `target` (see controller.h), then
  /// kPhysicsStepsPerControl physics steps with the torques recomputed at each.
  /// In a world with control_delay() the arm obeys the target of that many calls ago; before, it holds the
  /// pose that it had at the first call after Reset.
  /// @param target  pose of E that is due at the end of this control step
  /// @param V_WE  feed-forward of the path, linear m/s then angular rad/s; zero to hold. Inside the
  /// step
  ///              the path is taken as straight: `target` moved back by V_WE.
  void Step(const Waypoint& target, const Eigen::Matrix<double, 6, 1>& V_WE);
  /// The next Step ends with an object at `X_WO`, moving at `v_WO` (m/s, world) without turning, as a hand that is not
  /// in the picture would hold it. Whoever guides keeps it off other things: it is moved, whatever is in the way.
  void Guide(const std::string& object, const Pose& X_WO, const Eigen::Vector3d& v_WO);

  Eigen::VectorXd q() const;          ///< arm joints (nq), rad
  Eigen::VectorXd v() const;          ///< arm joints (nv), rad/s
  Eigen::VectorXd gripper_q() const;  ///< driven gripper joints
  double gripper() const;             ///< how far the fingers are closed, as measured: 0 open .. 1 closed
  Pose X_WE() const;                  ///< tool site in world
  Pose ObjectPose(const std::string& name) const;
  std::vector<float> StateVector() const;  ///< qpos and qvel
  double time() const;                     ///< s
  /// Poses of ArmInfo::bodies, in their order.
  std::vector<Pose> ArmPoses() const;
  /// What the controller asked of each arm joint at the last physics step, before the limits, N m; zero after Reset.
  const Eigen::VectorXd& demanded_torque() const;
  /// False once MuJoCo warned of NaN, a huge value or a full buffer since Reset: the attempt is
  /// void.
  bool healthy() const;

  /// MuJoCo's number of a body, as in Renderer::RenderSegmentation; 0 is "world".
  int BodyId(const std::string& name) const;
  /// Every pair of bodies in contact now, one entry a contact point; the names live as long as the scene.
  std::vector<std::pair<std::string_view, std::string_view>> Contacts() const;
  /// Names of bodies in contact with `body` now.
  std::vector<std::string> ContactsOf(const std::string& body) const;
  /// True when every group of fingers touches `object`.
  bool Grasped(const std::string& object) const;

  struct State;  ///< holds the mjData
  State& state() { return *state_; }
  const State& state() const { return *state_; }

 private:
  void Obey(const Waypoint& target, const Eigen::Matrix<double, 6, 1>& V_WE);

  std::shared_ptr<const Scene> scene_;
  std::unique_ptr<State> state_;
};

/// Kinematics of the arm apart from the simulation. One per thread.
class Kinematics {
 public:
  explicit Kinematics(std::shared_ptr<const Scene> scene);
  Kinematics(Kinematics&&) noexcept;
  ~Kinematics();

  /// Tool pose at q (nq).
  Pose X_WE(const Eigen::VectorXd& q);
  /// Geometric Jacobian of the tool at q: (6, nq), linear rows first, in world.
  Eigen::MatrixXd Jacobian(const Eigen::VectorXd& q);
  /// A point that moves with a body of the arm, at q.
  struct BodyPoint {
    std::string body;
    Eigen::Vector3d p_W;  ///< m, world
  };
  /// Jacobian of each point's velocity in world by the arm's joints, (3, nq) each; gripper joints are held.
  std::vector<Eigen::MatrixXd> PointJacobians(const Eigen::VectorXd& q, const std::vector<BodyPoint>& points);
  /// Pose of every body of `bodies`, which are no objects, at q with the gripper at `gripper` (0 open .. 1 closed).
  std::vector<Pose> BodyPoses(const Eigen::VectorXd& q, double gripper, const std::vector<std::string>& bodies);
  /// The same of ArmInfo::bodies, in their order.
  std::vector<Pose> ArmPoses(const Eigen::VectorXd& q, double gripper);
  /// Inverse kinematics from `q_seed` (damped least squares within joint limits). Follows the
  /// straight line from the seed's pose, so that the answer is in the seed's branch; a function of
  /// its arguments. A redundant arm (nq > 6) comes as near to its home as the tool's pose allows.
  /// @returns the solution, or nothing when it does not come within 0.5 mm and 2 mrad.
  std::optional<Eigen::VectorXd> Solve(const Pose& X_WE, const Eigen::VectorXd& q_seed);

 private:
  struct State;
  void PlaceAll(const Eigen::VectorXd& q, double gripper);
  bool Approach(const Pose& target, Eigen::VectorXd& q);
  bool Refine(const Pose& target, int iterations, Eigen::VectorXd& q);

  std::shared_ptr<const Scene> scene_;
  std::unique_ptr<State> state_;
};

}  // namespace etude::sim
