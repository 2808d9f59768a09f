// SPDX-License-Identifier: Apache-2.0
#include "services/policy/conversion.h"

#include <algorithm>
#include <cmath>
#include <tuple>

namespace etude::policy {

bus::Observation ObservationOf(const Question& question) {
  bus::Observation observation;
  observation.instruction = question.instruction;
  observation.joints = question.joints;
  observation.width = static_cast<std::uint32_t>(question.width);
  observation.height = static_cast<std::uint32_t>(question.height);
  observation.image.assign(question.rgb.begin(), question.rgb.end());
  observation.robot = question.robot;
  if (question.camera) {
    const Camera& camera = *question.camera;
    observation.intrinsics = {camera.focal(), camera.focal(), 0.5 * camera.width, 0.5 * camera.height};
    const auto& [p, q] = std::tie(camera.X_WC.p, camera.X_WC.q);
    observation.camera_pose = {p.x(), p.y(), p.z(), q.w(), q.x(), q.y(), q.z()};
  }
  return observation;
}

bool AreWaypoints(std::span<const float> numbers) {
  return numbers.size() == static_cast<std::size_t>(kWaypoints) * kWaypointSize &&
         std::ranges::all_of(numbers, [](float x) { return std::isfinite(x); });
}

std::vector<Waypoint> WaypointsOf(std::span<const float> numbers) {
  std::vector<Waypoint> waypoints;
  for (int k = 0; k < kWaypoints; ++k) waypoints.push_back(FromVector(numbers.data() + k * kWaypointSize));
  return waypoints;
}

// What worker/task/rollout.cc asked.
Question QuestionAt(const Episode& episode, int step, std::span<const std::uint8_t> rgb) {
  const auto arm = episode.joint_pos.row(step), gripper = episode.gripper_qpos.row(step);
  Question question;
  question.instruction = episode.instruction;
  question.robot = episode.robot;
  question.joints.assign(arm.begin(), arm.end());
  question.joints.insert(question.joints.end(), gripper.begin(), gripper.end());
  question.camera = episode.cameras[0].camera;
  question.width = question.camera->width;
  question.height = question.camera->height;
  question.rgb = rgb;
  return question;
}

}  // namespace etude::policy
