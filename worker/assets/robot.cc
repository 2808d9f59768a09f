// SPDX-License-Identifier: Apache-2.0
#include "worker/assets/robot.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <functional>
#include <map>

#include "services/core/config.h"
#include "worker/assets/robot_parts.h"

namespace etude::assets {

const std::vector<std::string>& KnownRobots() {
  static const std::vector<std::string> names{"ur5", "panda", "jaco2"};
  return names;
}

Result<RobotModel> MakeRobot(const std::string& name) {
  static const std::map<std::string, std::function<RobotModel()>> makers{
      {"ur5", MakeUr5}, {"panda", MakePanda}, {"jaco2", MakeJaco2}};
  if (const auto maker = makers.find(name); maker != makers.end()) return maker->second();
  const std::string nearest = NearestMatch(name, KnownRobots());
  return Fail(Code::kInvalidArgument,
              fmt::format("robot '{}' is not known{}; known: {}", name,
                          nearest.empty() ? "" : " (did you mean '" + nearest + "'?)", fmt::join(KnownRobots(), ", ")));
}

}  // namespace etude::assets
