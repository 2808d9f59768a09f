// SPDX-License-Identifier: Apache-2.0
// One compiled scene with all objects, shared by the tests of a program.
#pragma once

#include <gtest/gtest.h>

#include <map>
#include <memory>
#include <string>

#include "worker/sim/world.h"

namespace etude::sim {

inline std::shared_ptr<const Scene> SceneOf(const std::string& robot) {
  static std::map<std::string, std::shared_ptr<const Scene>> scenes;
  auto& scene = scenes[robot];
  if (!scene) {
    SceneSpec spec;
    spec.robot = robot;
    auto built = Scene::Build(spec);
    if (!built) {
      ADD_FAILURE() << built.error().message;
      std::abort();
    }
    scene = *built;
  }
  return scene;
}

inline std::shared_ptr<const Scene> FullScene() { return SceneOf("ur5"); }

using Vector6d = Eigen::Matrix<double, 6, 1>;

/// Moves the target straight from where E is to `end` and stays there for `hold` control steps.
/// `each` sees (target position error, control step) after every step.
template <class Each>
void MoveTo(World& world, const Pose& end, double speed, double gripper, int hold, Each each) {
  const Pose start = world.X_WE();
  const double distance = (end.p - start.p).norm();
  const double turn = AngleBetween(start.q, end.q);
  // trapezoid with 1 m/s^2 in the path parameter s of 0..length (m, or 0.4 m a radian)
  const double length = std::max(distance, 0.4 * turn), acceleration = 1.0, dt = 0.008;
  double s = 0, v = 0;
  const Eigen::AngleAxisd whole(end.q * start.q.conjugate());
  for (int step = 0; s < length && step < 5000; ++step) {
    const double braking = std::sqrt(2 * acceleration * std::max(0.0, length - s));
    v = std::min({speed, v + acceleration * dt, std::max(braking, 0.01)});
    s = std::min(length, s + v * dt);
    const double f = s / length;
    Vector6d V;
    V << (end.p - start.p) / length * v, whole.axis() * whole.angle() / length * v;
    const Eigen::Quaterniond q(Eigen::AngleAxisd(whole.angle() * f, whole.axis()) * start.q);
    const Waypoint target{{start.p + f * (end.p - start.p), q}, gripper};
    world.Step(target, V);
    each(target.X_WE);
  }
  for (int i = 0; i < hold; ++i) {
    world.Step({end, gripper}, Vector6d::Zero());
    each(end);
  }
}

}  // namespace etude::sim
