// SPDX-License-Identifier: Apache-2.0
// A whole scene as text and files in memory, composed from a campaign's choice of robot, objects,
// camera.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "services/core/result.h"
#include "services/episode/camera.h"
#include "services/episode/campaign_spec.h"
#include "worker/assets/object.h"
#include "worker/assets/robot.h"

namespace etude::assets {

struct SceneDescription {
  std::string mjcf;
  std::vector<AssetFile> files;  ///< everything that the MJCF names, once each
  RobotModel robot;
  std::vector<ObjectModel> objects;  ///< in the order of the spec
  Camera camera;
  std::string sha256;  ///< of MJCF, file names and contents
};

/// Physics step, s.
inline constexpr double kTimestep = 0.002;

/// A pure function of `spec`.
/// @param make_object, make_robot  pure functions of a name: what stands behind it
/// @error kInvalidArgument: unknown robot or object, an object named twice, a bad camera vector
Result<SceneDescription> DescribeScene(const SceneSpec& spec, const ObjectMaker& make_object = MakeObject,
                                       const RobotMaker& make_robot = MakeRobot);

}  // namespace etude::assets
