// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/embodiment.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "services/episode/action.h"

namespace etude::checkpoint {
namespace {

constexpr double kTolerance = 1e-3;

bool Same(double a, double b) { return std::abs(a - b) <= kTolerance; }

bool SamePose(const std::vector<double>& a, const std::vector<double>& b) {
  if (a.size() != b.size()) return false;
  // q and -q are one rotation
  double along = 0;
  for (std::size_t i = 3; i < a.size(); ++i) along += a[i] * b[i];
  const double sign = along < 0 ? -1 : 1;
  for (std::size_t i = 0; i < a.size(); ++i)
    if (!Same(a[i], i < 3 ? b[i] : sign * b[i])) return false;
  return true;
}

}  // namespace

Embodiment OwnFormats() {
  Embodiment result;
  result.rotation = kRotationFormat;
  result.control_rate = kControlRate;
  result.waypoints = kWaypoints;
  result.horizon = kHorizonSteps;
  return result;
}

Embodiment EmbodimentOf(const Episode& episode) {
  Embodiment result = OwnFormats();
  result.robot = episode.robot;
  result.joints = episode.joint_pos.columns + episode.gripper_qpos.columns;
  if (!episode.cameras.empty()) {
    const Camera& camera = episode.cameras[0].camera;
    result.width = camera.width;
    result.height = camera.height;
    result.fovy = camera.fovy;
    const auto& p = camera.X_WC.p;
    const auto& q = camera.X_WC.q;
    result.camera_pose = {p.x(), p.y(), p.z(), q.w(), q.x(), q.y(), q.z()};
  }
  return result;
}

std::vector<std::string> Differences(const Embodiment& here, const Embodiment& there) {
  std::vector<std::string> found;
  const auto text = [&](const char* name, const std::string& a, const std::string& b) {
    if (!a.empty() && !b.empty() && a != b) found.push_back(fmt::format("{}: {} here, {} there", name, a, b));
  };
  const auto number = [&](const char* name, double a, double b) {
    if (a != 0 && b != 0 && !Same(a, b)) found.push_back(fmt::format("{}: {:.6g} here, {:.6g} there", name, a, b));
  };
  text("robot", here.robot, there.robot);
  number("joints", here.joints, there.joints);
  number("camera width", here.width, there.width);
  number("camera height", here.height, there.height);
  number("camera fovy", here.fovy, there.fovy);
  if (!here.camera_pose.empty() && !there.camera_pose.empty() && !SamePose(here.camera_pose, there.camera_pose))
    found.push_back(fmt::format("camera pose: [{:.4g}] here, [{:.4g}] there", fmt::join(here.camera_pose, ", "),
                                fmt::join(there.camera_pose, ", ")));
  text("rotation format", here.rotation, there.rotation);
  number("control rate", here.control_rate, there.control_rate);
  number("waypoints", here.waypoints, there.waypoints);
  number("horizon", here.horizon, there.horizon);
  return found;
}

}  // namespace etude::checkpoint
