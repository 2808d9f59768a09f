// SPDX-License-Identifier: Apache-2.0
// A whole scene as text and files in memory, composed from a campaign's choice of robot, objects,
// camera.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "services/core/result.h"
#include "services/episode/camera.h"
#include "services/spec/campaign_spec.h"
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

/// The name of the table's geom.
inline constexpr const char* kTableGeom = "table";

/// Physics step, s.
inline constexpr double kTimestep = 0.002;

/// A pure function of its arguments.
/// @param robot  what spec.robot names
/// @param make_object  a pure function of a name: what stands behind it
/// @error kInvalidArgument: unknown object, an object named twice, a bad camera vector
Result<SceneDescription> DescribeScene(const SceneSpec& spec, RobotModel robot,
                                       const ObjectMaker& make_object = MakeObject);

}  // namespace etude::assets
