// SPDX-License-Identifier: Apache-2.0
#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>

#include "worker/sim/controller.h"
#include "worker/sim/model.h"

namespace etude::sim {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

constexpr int kIterations = 100, kLeapIterations = 4;
constexpr double kDamping = 1e-3;                          ///< m (and rad): steps shrink only very near a singularity
constexpr double kLargestStep = 0.35;                      ///< rad per joint and iteration
constexpr double kDonePosition = 1e-6, kDoneAngle = 1e-6;  ///< stop refining
/// A redundant arm slides home in each iteration as far as the tool's pose allows, until less than this (rad) is left:
/// its answer is then a function of the tool's pose and the branch.
constexpr double kDoneSlide = 1e-4;
constexpr double kGoodPosition = 0.5e-3, kGoodAngle = 2e-3;  ///< accept
/// Far targets are approached by poses no further apart than this, so that the arm stays in its
/// branch (elbow and wrist as in the seed): what follows only the tool's pose cannot change branch
/// on the way.
constexpr double kLeapPosition = 0.05, kLeapAngle = 0.25;
/// Later tries start away from the seed by these much in turn; fixed, so that the answer is a
/// function.
constexpr std::array kNudges{0.0, 0.2, -0.2, 0.5, -0.5};

Vector6d ErrorOf(const Pose& now, const Pose& target) {
  Vector6d error;
  error << target.p - now.p, RotationVector(now.q, target.q);
  return error;
}

bool Within(const Vector6d& error, double position, double angle) {
  return error.head<3>().norm() < position && error.tail<3>().norm() < angle;
}

struct DampedStep {
  Eigen::VectorXd q;  ///< rad
  double slide = 0;   ///< rad, the largest part of it that only draws a redundant arm home
};

DampedStep StepOf(const Matrix6Xd& J, const Vector6d& error, const Eigen::VectorXd& home) {
  // more damping while far away: linearisation is poor there
  const double damping = kDamping + 0.05 * std::min(1.0, error.squaredNorm());
  const Matrix6d normal = J * J.transpose() + damping * damping * Matrix6d::Identity();
  const Eigen::LLT<Matrix6d> factors(normal);  // damping keeps it positive definite
  DampedStep step{J.transpose() * factors.solve(error)};
  if (J.cols() <= 6) return step;
  // twice, because damping lets a little of it move the tool: enough to miss the target for good
  Eigen::VectorXd slide = home - J.transpose() * factors.solve(J * home);
  slide -= J.transpose() * factors.solve(J * slide);
  step.q += slide;
  step.slide = slide.cwiseAbs().maxCoeff();
  return step;
}

// Joints that stand at a limit and would go on are held there, and the others do their part.
DampedStep StepWithinLimits(Matrix6Xd J, const Vector6d& error, const Eigen::VectorXd& q, const ArmInfo& arm) {
  Eigen::VectorXd home = arm.q_home - q;
  DampedStep step = StepOf(J, error, home);
  for (Eigen::Index held = 0; held < q.size() && J.cols() > 6; ++held) {
    bool more = false;
    for (Eigen::Index i = 0; i < q.size(); ++i) {
      const bool out = (q[i] >= arm.q_max[i] && step.q[i] > 0) || (q[i] <= arm.q_min[i] && step.q[i] < 0);
      if (!out) continue;
      J.col(i).setZero();
      home[i] = 0;
      more = true;
    }
    if (!more) break;
    step = StepOf(J, error, home);
  }
  return step;
}

}  // namespace

struct Kinematics::State {
  std::vector<mjtNum> qpos;  ///< of the whole scene; only the robot's own are used
  ArmTree::Frames frames;
  Matrix6Xd J;
};

Kinematics::Kinematics(std::shared_ptr<const Scene> scene)
    : scene_(std::move(scene)), state_(std::make_unique<State>()) {
  const Scene::Model& model = scene_->model();
  state_->qpos.assign(model.mj->qpos0, model.mj->qpos0 + model.mj->nq);
  model.SetHome(state_->qpos.data());
}
Kinematics::Kinematics(Kinematics&&) noexcept = default;
Kinematics::~Kinematics() = default;

Pose Kinematics::X_WE(const Eigen::VectorXd& q) {
  const Scene::Model& model = scene_->model();
  model.SetArm(state_->qpos.data(), q);
  model.tree.PlaceTool(state_->qpos.data(), state_->frames);
  return model.tree.X_WE(state_->frames);
}

Eigen::MatrixXd Kinematics::Jacobian(const Eigen::VectorXd& q) {
  X_WE(q);
  scene_->model().tree.ToolJacobian(state_->frames, state_->J);
  return state_->J;
}

std::vector<Eigen::MatrixXd> Kinematics::PointJacobians(const Eigen::VectorXd& q,
                                                        const std::vector<BodyPoint>& points) {
  const Scene::Model& model = scene_->model();
  model.SetArm(state_->qpos.data(), q);
  model.tree.PlaceAll(state_->qpos.data(), state_->frames);
  std::vector<Eigen::MatrixXd> jacobians;
  jacobians.reserve(points.size());
  for (const BodyPoint& point : points)
    jacobians.push_back(
        model.tree.PointJacobian(state_->frames, model.tree.IndexOf(model.BodyId(point.body)), point.p_W));
  return jacobians;
}

std::vector<Pose> Kinematics::BodyPoses(const Eigen::VectorXd& q, double gripper,
                                        const std::vector<std::string>& bodies) {
  PlaceAll(q, gripper);
  const Scene::Model& model = scene_->model();
  std::vector<Pose> poses;
  poses.reserve(bodies.size());
  for (const std::string& body : bodies) poses.push_back(state_->frames.X_WB[model.tree.IndexOf(model.BodyId(body))]);
  return poses;
}

std::vector<Pose> Kinematics::ArmPoses(const Eigen::VectorXd& q, double gripper) {
  PlaceAll(q, gripper);
  std::vector<Pose> poses;
  poses.reserve(scene_->model().arm_bodies.size());
  for (const int index : scene_->model().arm_bodies) poses.push_back(state_->frames.X_WB[index]);
  return poses;
}

void Kinematics::PlaceAll(const Eigen::VectorXd& q, double gripper) {
  const Scene::Model& model = scene_->model();
  model.SetArm(state_->qpos.data(), q);
  model.SetGripper(state_->qpos.data(), gripper);
  model.tree.PlaceAll(state_->qpos.data(), state_->frames);
}

std::optional<Eigen::VectorXd> Kinematics::Solve(const Pose& X_WE_target, const Eigen::VectorXd& q_seed) {
  for (const double nudge : kNudges) {
    Eigen::VectorXd q = q_seed;
    for (Eigen::Index i = 0; i < q.size(); ++i) q[i] += (i % 2 ? -nudge : nudge);
    if (Approach(X_WE_target, q)) return q;
  }
  return std::nullopt;
}

bool Kinematics::Approach(const Pose& target, Eigen::VectorXd& q) {
  const ArmInfo& arm = scene_->arm();
  q = q.cwiseMax(arm.q_min).cwiseMin(arm.q_max);
  const Pose start = X_WE(q);
  const Vector6d whole = ErrorOf(start, target);
  const int leaps = static_cast<int>(
      std::ceil(std::max({whole.head<3>().norm() / kLeapPosition, whole.tail<3>().norm() / kLeapAngle, 1.0})));
  for (int i = 1; i < leaps; ++i) {
    const double f = static_cast<double>(i) / leaps;
    // where the straight line is out of reach the nearest pose does: only the end counts
    Refine(Interpolate(start, target, f), kLeapIterations, q);
  }
  return Refine(target, kIterations, q);
}

// `q` is within its limits, before and after, and where state_->frames are.
bool Kinematics::Refine(const Pose& target, int iterations, Eigen::VectorXd& q) {
  const Scene::Model& model = scene_->model();
  const ArmInfo& arm = scene_->arm();
  for (int iteration = 0; iteration <= iterations; ++iteration) {
    const Vector6d error = ErrorOf(model.tree.X_WE(state_->frames), target);
    const bool there = Within(error, kDonePosition, kDoneAngle);
    if (there && q.size() <= 6) return true;
    if (iteration == iterations) return Within(error, kGoodPosition, kGoodAngle);
    model.tree.ToolJacobian(state_->frames, state_->J);
    const DampedStep step = StepWithinLimits(state_->J, error, q, arm);
    if (there && step.slide < kDoneSlide) return true;
    q += step.q * std::min(1.0, kLargestStep / std::max(step.q.cwiseAbs().maxCoeff(), 1e-12));
    q = q.cwiseMax(arm.q_min).cwiseMin(arm.q_max);
    X_WE(q);
  }
  return false;
}

}  // namespace etude::sim
