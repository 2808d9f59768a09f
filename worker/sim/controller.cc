// SPDX-License-Identifier: Apache-2.0
#include "worker/sim/controller.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>

#include "services/core/check.h"
#include "worker/sim/saturated.h"

namespace etude::sim {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// Mobility (1/kg, 1/(kg m^2)) below which a direction counts as lost: a singular arm cannot push
/// there.
constexpr double kLeastMobility = 5e-3;
constexpr double kNullDamping = 1e-3;  ///< m (and rad)
constexpr double kLeastRoom = 0.1;     ///< of a joint's limit that is left for it to count in WithinLimits

/// (J M^-1 J^T)^-1, with directions near a singularity faded out instead of blown up.
Matrix6d TaskInertia(const Matrix6d& mobility) {
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(mobility);
  Vector6d inverse;
  for (int i = 0; i < 6; ++i) {
    const double s = eigen.eigenvalues()[i];
    const double lack = std::max(0.0, kLeastMobility - s);
    inverse[i] = s / (s * s + lack * lack);
  }
  return eigen.eigenvectors() * inverse.asDiagonal() * eigen.eigenvectors().transpose();
}

/// What of the joint motion `dq` does not move the tool.
Eigen::VectorXd NullSpacePart(const Eigen::MatrixXd& J, const Eigen::VectorXd& dq) {
  return dq - JointMotion(J, J * dq, kNullDamping);
}

/// Velocity in the null space towards the posture. Where the tool's own motion leaves joints little of their speed,
/// less.
Eigen::VectorXd Slide(const ControlState& state, double rate) {
  Eigen::VectorXd slide = rate * NullSpacePart(state.J, state.posture);
  if (state.speed.size() != slide.size()) return slide;
  const Eigen::VectorXd with_tool = state.v - NullSpacePart(state.J, state.v);
  double share = 1;
  for (Eigen::Index i = 0; i < slide.size(); ++i) {
    const double room = std::max(0.0, state.speed[i] - std::copysign(1.0, slide[i]) * with_tool[i]);
    if (std::abs(slide[i]) > room) share = std::min(share, room / std::abs(slide[i]));
  }
  return share * slide;
}

/// Towards where the joints have to go for the tool to have the velocity `V_WE`, at most the friction.
Eigen::VectorXd OvercomingFriction(const ControlState& state, const Vector6d& V_WE, double dry_speed) {
  constexpr double kDamping = 0.05;  // m (and rad): near a singularity no joint has far to go
  const Eigen::VectorXd v = JointMotion(state.J, V_WE, kDamping);
  return state.friction.cwiseProduct((v / dry_speed).cwiseMax(-1).cwiseMin(1));
}

}  // namespace

Eigen::VectorXd JointMotion(const Eigen::MatrixXd& J, const Vector6d& dx, double damping) {
  const Matrix6d normal = J * J.transpose() + damping * damping * Matrix6d::Identity();
  return J.transpose() * normal.ldlt().solve(dx);
}

Eigen::Vector3d RotationVector(const Eigen::Quaterniond& from, const Eigen::Quaterniond& to) {
  Eigen::Quaterniond turn = to * from.conjugate();
  if (turn.w() < 0) turn.coeffs() *= -1;
  const double sine = turn.vec().norm();
  if (sine < 1e-12) return 2 * turn.vec();
  return turn.vec() * (2 * std::atan2(sine, turn.w()) / sine);
}

Pose Advanced(const Pose& X, const Vector6d& V, double seconds) {
  const Eigen::Vector3d turn = V.tail<3>() * seconds;
  const double angle = turn.norm();
  if (angle < 1e-12) return {X.p + V.head<3>() * seconds, X.q};
  return {X.p + V.head<3>() * seconds, (Eigen::Quaterniond(Eigen::AngleAxisd(angle, turn / angle)) * X.q).normalized()};
}

Vector6d ToolAcceleration(const ControlState& state, const Pose& X_WE_target, const Vector6d& V_WE_target,
                          const ControllerConfig& config) {
  Vector6d acceleration = config.kv * (V_WE_target - state.J * state.v);
  acceleration.head<3>() +=
      config.kp * Saturated(X_WE_target.p - state.X_WE.p, config.max_linear * config.kv / config.kp);
  acceleration.tail<3>() +=
      config.ko * Saturated(RotationVector(state.X_WE.q, X_WE_target.q), config.max_angular * config.kv / config.ko);
  return acceleration;
}

Eigen::VectorXd RedundantAcceleration(const ControlState& state, const Vector6d& acceleration,
                                      const ControllerConfig& config) {
  Eigen::VectorXd slide = -NullSpacePart(state.J, state.v);
  if (state.posture.size() == state.v.size()) slide += Slide(state, config.null_kp / config.null_kv);
  return JointMotion(state.J, acceleration, config.share_damping) + config.null_kv * slide;
}

Eigen::VectorXd OperationalSpaceTorques(const ControlState& state, const Pose& X_WE_target, const Vector6d& V_WE_target,
                                        const ControllerConfig& config) {
  const Eigen::Index n = state.v.size();
  ETUDE_CHECK(state.J.rows() == 6 && state.J.cols() == n && state.M.rows() == n && state.M.cols() == n &&
                  state.bias.size() == n,
              "n={}", n);
  const Matrix6d mobility = state.J * state.M.llt().solve(state.J.transpose());
  const Matrix6d inertia = TaskInertia(mobility);
  const Vector6d V_WE = state.J * state.v;
  const Vector6d acceleration = ToolAcceleration(state, X_WE_target, V_WE_target, config);

  // what the joints do anyhow, the force at the tool need not (and takes back where it would disturb the tool)
  Eigen::VectorXd joints = -config.null_kv * state.v;
  if (n > 6) joints = RedundantAcceleration(state, acceleration, config);
  const Vector6d wrench =
      inertia * (acceleration - (n > 6 ? Vector6d(state.J * joints) : Vector6d(-config.null_kv * V_WE)));
  if (state.stop.size() == n) joints += config.stop_kp * state.stop;
  Eigen::VectorXd torque = state.J.transpose() * wrench + state.bias + state.M * joints;
  // the velocity that would be right: what the spring and the path ask for
  if (state.friction.size() == n)
    torque += OvercomingFriction(state, V_WE + acceleration / config.kv, config.dry_speed);
  return torque;
}

Eigen::VectorXd WithinLimits(const Eigen::VectorXd& demand, const Eigen::VectorXd& bias, const Eigen::VectorXd& limit) {
  const Eigen::VectorXd rest = demand - bias;
  double share = 1;
  for (Eigen::Index i = 0; i < demand.size(); ++i) {
    if (std::abs(demand[i]) <= limit[i]) continue;
    const double room = rest[i] > 0 ? limit[i] - bias[i] : limit[i] + bias[i];
    if (room > kLeastRoom * limit[i]) share = std::min(share, room / std::abs(rest[i]));
  }
  return (bias + share * rest).cwiseMax(-limit).cwiseMin(limit);
}

}  // namespace etude::sim
