// SPDX-License-Identifier: Apache-2.0
#include "worker/task/user_files.h"

#include <algorithm>
#include <iterator>
#include <vector>

#include "services/core/file.h"
#include "services/core/hash.h"
#include "services/spec/object_names.h"
#include "services/spec/task_name.h"
#include "worker/sim/robot_file.h"
#include "worker/sim/scene.h"

namespace etude::task {
namespace {

// A scene has room for 2,000 files, and an object has a handful.
constexpr std::size_t kObjectsOfAScene = 100;

}  // namespace

Result<std::string> UserFilesSha256(const CampaignSpec& spec) {
  std::vector<std::string> robots, objects;
  std::ranges::copy_if(spec.robots, std::back_inserter(robots), sim::IsRobotFile);
  std::ranges::copy_if(spec.objects, std::back_inserter(objects), IsObjectPath);
  std::string all;
  for (const std::string& name : spec.tasks) {
    ETUDE_ASSIGN_OR_RETURN(const TaskName task, ParseTask(name));
    if (IsTaskPath(task.base)) all += task.spec->sha256;
  }
  if (robots.empty() && objects.empty()) return all.empty() ? all : Sha256Hex(all);
  for (const std::string& object : objects) {
    // the scene has all but its extent, which decides where things may stand
    const Path path(object), folder = path.filename() == "object.yaml" ? path.parent_path() : path;
    ETUDE_ASSIGN_OR_RETURN(const auto yaml, ReadBinaryFile(folder / "object.yaml"));
    all += Sha256Hex(yaml);
  }
  if (robots.empty()) robots.push_back(spec.robots.at(0));

  for (const std::string& robot : robots) {
    SceneSpec scene_spec(spec);
    scene_spec.robot = robot;
    for (std::size_t first = 0; first == 0 || first < objects.size(); first += kObjectsOfAScene) {
      const auto begin = objects.begin() + static_cast<std::ptrdiff_t>(first);
      const auto end =
          objects.begin() + static_cast<std::ptrdiff_t>(std::min(objects.size(), first + kObjectsOfAScene));
      scene_spec.objects.assign(begin, end);
      ETUDE_ASSIGN_OR_RETURN(const auto scene, sim::Scene::Build(scene_spec));
      all += scene->sha256();
    }
    if (!sim::IsRobotFile(robot)) continue;
    // the scene has all but what is the planner's: home, speeds, pitches
    ETUDE_ASSIGN_OR_RETURN(const auto yaml, ReadBinaryFile(robot));
    all += Sha256Hex(yaml);
  }
  return Sha256Hex(all);
}

}  // namespace etude::task
