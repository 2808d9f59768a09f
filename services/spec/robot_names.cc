// SPDX-License-Identifier: Apache-2.0
#include "services/spec/robot_names.h"

#include <algorithm>
#include <vector>

#include "services/core/config.h"
#include "services/core/share.h"

namespace etude {
namespace {

std::vector<std::string> NamesIn(const Path& folder) {
  std::vector<std::string> names;
  std::error_code error;
  for (std::filesystem::directory_iterator it(folder, error), end; !error && it != end; it.increment(error))
    if (it->path().extension() == ".yaml") names.push_back(it->path().stem().string());
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace

Result<Path> FindRobot(const std::string& robot) {
  if (robot.ends_with(".yaml")) return Path(robot);
  ETUDE_ASSIGN_OR_RETURN(const Path folder, FindShared("robots"));
  const std::vector<std::string> known = NamesIn(folder);
  if (std::find(known.begin(), known.end(), robot) != known.end()) return folder / (robot + ".yaml");
  return Fail(Code::kInvalidArgument, NotKnown(robot, known) + ", or a .yaml of your own");
}

}  // namespace etude
