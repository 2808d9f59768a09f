// SPDX-License-Identifier: Apache-2.0
#include "worker/task/disturbance.h"

#include <algorithm>
#include <cmath>

#include "worker/task/smooth_step.h"

namespace etude::task {
namespace {

constexpr double kRotationPerMetre = 5.0;  // rad per m: a push of 3 cm turns by up to 0.15 rad
constexpr double kPushMargin = 0.008;      // m kept free while pushed

Eigen::Vector3d DrawInBall(double radius, Rng& rng) {
  for (;;) {
    const double x = rng.Uniform(-1, 1);
    const double y = rng.Uniform(-1, 1);
    const Eigen::Vector3d p(x, y, rng.Uniform(-1, 1));
    if (p.squaredNorm() <= 1) return radius * p;
  }
}

Eigen::Quaterniond FromRotationVector(const Eigen::Vector3d& r) {
  const double angle = r.norm();
  if (angle < 1e-12) return Eigen::Quaterniond::Identity();
  return Eigen::Quaterniond(Eigen::AngleAxisd(angle, r / angle));
}

}  // namespace

Push DrawPush(const RandomizationSpec& randomization, Rng& rng) {
  Push push;
  push.offset = DrawInBall(randomization.disturbance, rng);
  push.rotation = DrawInBall(randomization.disturbance * kRotationPerMetre, rng);
  push.steps = 20 + static_cast<int>(rng.Below(11));
  return push;
}

plan::Motion PushMotion(const plan::Motion& motion, int from, const Push& push) {
  plan::Motion pushed;
  for (int i = 1; i <= push.steps; ++i) {
    const double s = static_cast<double>(i) / push.steps;
    const double rate = SmoothStepRate(s) / push.steps * kControlRate;  // 1/s
    // The path's own speed falls linearly to zero: it advances by s - s^2 / 2 of the push's steps.
    const double path_step = from + push.steps * (s - s * s / 2);
    Pose X_WE = motion.At(path_step);
    X_WE.p += SmoothStep(s) * push.offset;
    X_WE.q = (FromRotationVector(SmoothStep(s) * push.rotation) * X_WE.q).normalized();
    const int on_path = std::min(static_cast<int>(path_step), motion.steps() - 1);
    Eigen::Matrix<double, 6, 1> V_WE = (1 - s) * motion.V_WE[on_path];
    V_WE.head<3>() += rate * push.offset;
    V_WE.tail<3>() += rate * push.rotation;
    pushed.X_WE.push_back(X_WE);
    pushed.V_WE.push_back(V_WE);
  }
  return pushed;
}

PushVerdict JudgePush(const plan::Motion& motion, const Eigen::VectorXd& q, const Eigen::VectorXd& joint_speed,
                      sim::Kinematics& kinematics, collide::Checker& checker) {
  constexpr int kEvery = 5;  // control steps
  Eigen::VectorXd q_now = q;
  for (int i = kEvery - 1; i < motion.steps(); i += kEvery) {
    const auto next = kinematics.Solve(motion.X_WE[i], q_now);
    if (!next || checker.Collides(*next, kPushMargin)) return PushVerdict::kBlocked;
    const Eigen::VectorXd speed = (*next - q_now).cwiseAbs() * (kControlRate / kEvery);
    if ((speed.array() > joint_speed.array()).any()) return PushVerdict::kTooFast;
    q_now = *next;
  }
  return motion.steps() > 0 ? PushVerdict::kFree : PushVerdict::kBlocked;
}

}  // namespace etude::task
