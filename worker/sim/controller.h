// SPDX-License-Identifier: Apache-2.0
// Operational-space control of the tool (Khatib 1987): torques that move E like a unit-mass
// spring-damper.
#pragma once

#include <Eigen/Core>

#include "services/episode/pose.h"

namespace etude::sim {

struct ControllerConfig {
  double kp = 400;              ///< 1/s^2, position stiffness
  double kv = 40;               ///< 1/s, damping (critical: 2 sqrt(kp))
  double ko = 400;              ///< 1/s^2, orientation stiffness
  double max_linear = 0.5;      ///< m/s: errors are saturated so that the spring never drives faster
  double max_angular = 2.0;     ///< rad/s
  double null_kv = 10;          ///< 1/s, joint damping in the null space
  double null_kp = 40;          ///< 1/s^2, spring of a redundant arm's null space towards its posture, as far as the
                                ///< joints' speeds allow
  double share_damping = 0.03;  ///< m (and rad): near a singularity the force alone moves a redundant arm
  double stop_kp = 400;         ///< 1/s^2, stiffness of the soft stops (see ControlState::stop)
  double dry_speed = 0.02;      ///< rad/s of a joint from which on the whole of its dry friction is overcome
};

/// What the controller needs to know at one instant. All in world.
struct ControlState {
  Pose X_WE;
  Eigen::VectorXd v;     ///< (n) joint velocities
  Eigen::MatrixXd J;     ///< (6, n) geometric Jacobian of E, linear rows first
  Eigen::MatrixXd M;     ///< (n, n) joint-space inertia
  Eigen::VectorXd bias;  ///< (n) Coriolis, centrifugal, gravity
  /// (n) rad from q to the posture that a redundant arm (n > 6) shall keep as far as the tool allows, or empty.
  Eigen::VectorXd posture;
  /// (n) rad/s that the way to the posture must not take a joint beyond, besides what the tool asks of it; or empty.
  Eigen::VectorXd speed;
  /// (n) rad that each joint is inside the margin before its stop, signed back to the middle, or empty.
  Eigen::VectorXd stop;
  /// (n) N m of dry friction, or empty. It is overcome where the tool has to go: else a light wrist, whose spring is as
  /// light as it is, would stay stuck far off its target.
  Eigen::VectorXd friction;
};

/// Rotation vector (axis times angle, angle in [0, pi]) that turns `from` into `to`, in world.
Eigen::Vector3d RotationVector(const Eigen::Quaterniond& from, const Eigen::Quaterniond& to);

/// `X` moved by the twist `V` (m/s, rad/s, linear first, world) for `seconds`, which may be negative.
Pose Advanced(const Pose& X, const Eigen::Matrix<double, 6, 1>& V, double seconds);

/// The smallest joint motion (n) that moves the tool by `dx` (6, linear first): damped least squares.
/// @param J  (6, n) of the tool; @param damping  m (and rad), keeps it finite near a singularity
Eigen::VectorXd JointMotion(const Eigen::MatrixXd& J, const Eigen::Matrix<double, 6, 1>& dx, double damping);

/// What the spring and the path ask of the tool (6, linear first): kp e_p + kv (V_ref - J v). Reads X_WE, J, v.
Eigen::Matrix<double, 6, 1> ToolAcceleration(const ControlState& state, const Pose& X_WE_target,
                                             const Eigen::Matrix<double, 6, 1>& V_WE_target,
                                             const ControllerConfig& config);

/// `u` below of a redundant arm: joint accelerations (n) besides those that the force at the tool makes. That force
/// alone moves light joints most; a plan's joints take the smallest motion, and a light wrist would have to be twice as
/// fast as planned. Reads J, v, posture, speed.
Eigen::VectorXd RedundantAcceleration(const ControlState& state, const Eigen::Matrix<double, 6, 1>& acceleration,
                                      const ControllerConfig& config);

/// Joint torques (n), N m, for the tool's acceleration a = kp e_p + kv (V_ref - J v):
///   tau = J^T Lambda (a - J u) + M u + bias + M stop_kp stop + friction
///   u = -null_kv v                                          six joints and fewer
///   u = J^+ a + (1 - J^+ J) (null_kp posture - null_kv v)   a redundant arm
/// with Lambda = (J M^-1 J^T)^-1 (damped near singularities) and the full rotation vector as error. u shares the tool's
/// motion among the joints of a redundant arm as Kinematics::Solve does, whatever each weighs; the posture's rest is
/// where (1 - J^+ J) posture = 0. Only the stops disturb the tool.
Eigen::VectorXd OperationalSpaceTorques(const ControlState& state, const Pose& X_WE_target,
                                        const Eigen::Matrix<double, 6, 1>& V_WE_target, const ControllerConfig& config);

/// What an arm within its limits gives of `demand`: the bias, and of the rest as large a share as no joint's limit is
/// exceeded by. Clipping each joint for itself would bend the force at the tool, and so its way, towards wherever the
/// strong joints push.
/// A joint that its bias alone takes (nearly) to its limit is clipped instead: it must not stop the others.
/// @param demand, bias, limit  (n) N m each; limit > 0
Eigen::VectorXd WithinLimits(const Eigen::VectorXd& demand, const Eigen::VectorXd& bias, const Eigen::VectorXd& limit);

}  // namespace etude::sim
