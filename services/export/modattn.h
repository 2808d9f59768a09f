// SPDX-License-Identifier: Apache-2.0
// Demonstrations in the layout that the paper's authors published (repository ir-lab/ModAttn and the simulator that
// goes with it) -> a dataset of ours:
//   DIR/<episode>/states.json      a list, an entry a step of 8 ms: q, dq, target (x, y, z, roll, pitch, yaw),
//                                  objects_to_track {EE, target2, coke, ...} {xyz, rpy}, stage, goal_object,
//                                  action_inst
//   DIR/<episode>/<step>.png       what the camera saw, from 0 on
//   DIR/<episode>/<step>_depth_map.npy   not read: our datasets have no depth
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "services/core/output_folder.h"

namespace etude::exports {

struct ModattnOptions {
  std::string robot = "ur5";     ///< ur5 | jaco2 | panda: how wide its fingers are when closed is not recorded
  std::string name = "modattn";  ///< of the campaign
  double fovy_deg = 60;          ///< of the camera, which otherwise is the one of all their scenes (CameraSpec)
  bool skip_bad = false;         ///< leave out what cannot be read; else it ends the import
  Leftover leftover = Leftover::kRefuse;
  std::function<void(std::uint64_t done, std::uint64_t total)> progress;  ///< may be empty
};

struct ModattnReport {
  std::uint64_t episodes = 0;
  std::vector<std::string> skipped;  ///< "17: why"
};

/// Episode by episode, numbered in the order of their folders' names. What was not recorded is made: a template
/// sentence for task and object (theirs were drawn while training), the gripper's command from the fingers' angle,
/// pixels from the camera. Whether the robot succeeded was not judged; details.judged is false and success is assumed.
/// OUT appears when all of it is durable.
/// @error kInvalidArgument: OUT is there, an unknown robot, content that is not as above (with folder and key);
/// kNotFound: no episode in DIR; kExhausted: stopped; kUnavailable of the disk
Result<ModattnReport> ImportModattn(const Path& folder, const Path& out, const ModattnOptions& options);

}  // namespace etude::exports
