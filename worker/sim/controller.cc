// SPDX-License-Identifier: Apache-2.0
#include "worker/sim/controller.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>

#include "services/core/check.h"

namespace etude::sim {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// Mobility (1/kg, 1/(kg m^2)) below which a direction counts as lost: a singular arm cannot push
/// there.
constexpr double kLeastMobility = 5e-3;
constexpr double kNullDamping = 1e-3;  ///< m (and rad)

/// `v`, no longer than `limit`.
Eigen::Vector3d Saturated(const Eigen::Vector3d& v, double limit) {
  const double norm = v.norm();
  return norm > limit ? Eigen::Vector3d(v * (limit / norm)) : v;
}

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
  const Matrix6d normal = J * J.transpose() + kNullDamping * kNullDamping * Matrix6d::Identity();
  return dq - J.transpose() * normal.ldlt().solve(J * dq);
}

}  // namespace

Eigen::Vector3d RotationVector(const Eigen::Quaterniond& from, const Eigen::Quaterniond& to) {
  Eigen::Quaterniond turn = to * from.conjugate();
  if (turn.w() < 0) turn.coeffs() *= -1;
  const double sine = turn.vec().norm();
  if (sine < 1e-12) return 2 * turn.vec();
  return turn.vec() * (2 * std::atan2(sine, turn.w()) / sine);
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

  Vector6d acceleration = config.kv * (V_WE_target - V_WE);
  acceleration.head<3>() +=
      config.kp * Saturated(X_WE_target.p - state.X_WE.p, config.max_linear * config.kv / config.kp);
  acceleration.tail<3>() +=
      config.ko * Saturated(RotationVector(state.X_WE.q, X_WE_target.q), config.max_angular * config.kv / config.ko);

  // N^T (-k M v) = -k (M v - J^T Lambda J v): what is left of joint damping once the tool's motion
  // is taken out
  const Vector6d wrench = inertia * (acceleration + config.null_kv * V_WE);
  Eigen::VectorXd joints = -config.null_kv * state.v;
  if (n > 6 && state.posture.size() == n) joints += config.null_kp * NullSpacePart(state.J, state.posture);
  if (state.stop.size() == n) joints += config.stop_kp * state.stop;
  return state.J.transpose() * wrench + state.bias + state.M * joints;
}

}  // namespace etude::sim
