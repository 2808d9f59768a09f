// SPDX-License-Identifier: Apache-2.0
// What a policy is asked and what it answers, whoever asks: a worker, a browser session, a robot's driver.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "services/core/config.h"
#include "services/core/result.h"
#include "services/episode/action.h"
#include "services/episode/camera.h"
#include "services/episode/episode.h"

namespace etude::policy {

/// What is seen and wanted now.
struct Question {
  std::string instruction;
  std::vector<float> joints;          ///< arm joints then gripper joints, rad or m
  int width = 0, height = 0;          ///< px
  std::span<const std::uint8_t> rgb;  ///< height*width*3, top row first
  std::string robot;                  ///< a known robot's name or its file's; "": not said
  std::optional<Camera> camera;       ///< that took the picture, in the robot's world; none: not said
};

/// What a rollout asked at a step of its record, or would have asked in a demonstration.
/// @param rgb  the picture of cameras[0] at that step; the question points into it
Question QuestionAt(const Episode& episode, int step, std::span<const std::uint8_t> rgb);

/// kWaypoints waypoints over the next kHorizonSteps control steps, and what the modules say.
struct Answer {
  std::vector<Waypoint> waypoints;
  OrderedJson modules;  ///< e.g. {"TAR3D": {"position": [x, y, z]}, ...}
  std::uint64_t checkpoint_step = 0;
  double server_p99_ms = 0;  ///< of the server's last answers, from observation to action; 0: not measured yet
};

/// Asks a policy; what it returns as an error ends the rollout.
using AskFunction = std::function<Result<Answer>(const Question&)>;

}  // namespace etude::policy
