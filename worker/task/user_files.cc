// SPDX-License-Identifier: Apache-2.0
#include "worker/task/user_files.h"

#include <algorithm>
#include <filesystem>
#include <iterator>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "services/core/hash.h"
#include "services/spec/object_names.h"
#include "services/spec/task_name.h"
#include "worker/sim/robot_file.h"
#include "worker/sim/scene.h"

namespace etude::task {
namespace {

// A scene has room for 2,000 files, and an object has a handful.
constexpr std::size_t kObjectsOfAScene = 100;

std::vector<std::string> RobotFilesOf(const CampaignSpec& spec) {
  std::vector<std::string> robots;
  std::ranges::copy_if(spec.robots, std::back_inserter(robots), sim::IsRobotFile);
  return robots;
}

std::vector<std::string> ObjectPathsOf(const CampaignSpec& spec) {
  std::vector<std::string> objects;
  std::ranges::copy_if(spec.objects, std::back_inserter(objects), IsObjectPath);
  return objects;
}

/// Every file that a scene of the spec's robots and objects is read from. Tasks' files are read once a campaign.
Result<std::vector<Path>> FilesOf(const CampaignSpec& spec) {
  std::vector<Path> files;
  for (const std::string& robot : RobotFilesOf(spec)) {
    ETUDE_ASSIGN_OR_RETURN(const auto loaded, sim::LoadRobot(robot));
    files.insert(files.end(), loaded.sources.begin(), loaded.sources.end());
  }
  for (const std::string& object : ObjectPathsOf(spec)) {
    std::error_code error;
    for (std::filesystem::directory_iterator it(ObjectFolder(object), error), end; !error && it != end;
         it.increment(error))
      files.push_back(it->path());
    if (error) return Fail(ErrnoError("read", ObjectFolder(object), error.value()));
  }
  return files;
}

// The hash of a scene of these objects; those of two halves where they have more files than MuJoCo takes for one.
Result<std::string> SceneHashes(SceneSpec spec, std::span<const std::string> objects) {
  spec.objects.assign(objects.begin(), objects.end());
  const auto scene = sim::Scene::Build(spec);
  if (scene) return (*scene)->sha256();
  if (scene.error().code != Code::kExhausted || objects.size() < 2) return Fail(scene.error());
  const std::size_t half = objects.size() / 2;
  ETUDE_ASSIGN_OR_RETURN(const std::string first, SceneHashes(spec, objects.first(half)));
  ETUDE_ASSIGN_OR_RETURN(const std::string second, SceneHashes(spec, objects.subspan(half)));
  return first + second;
}

}  // namespace

Result<std::string> UserFilesSha256(const CampaignSpec& spec) {
  std::vector<std::string> robots = RobotFilesOf(spec);
  const std::vector<std::string> objects = ObjectPathsOf(spec);
  std::string all;
  for (const std::string& name : spec.tasks) {
    ETUDE_ASSIGN_OR_RETURN(const TaskName task, ParseTask(name));
    if (IsTaskPath(task.base)) all += task.spec->sha256;
  }
  if (robots.empty() && objects.empty()) return all.empty() ? all : Sha256Hex(all);
  for (const std::string& object : objects) {
    // the scene has all but its extent, which decides where things may stand
    ETUDE_ASSIGN_OR_RETURN(const auto yaml, ReadBinaryFile(ObjectFolder(object) / "object.yaml"));
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
      ETUDE_ASSIGN_OR_RETURN(const std::string hashes, SceneHashes(scene_spec, {begin, end}));
      all += hashes;
    }
    if (!sim::IsRobotFile(robot)) continue;
    // the scene has all but what is the planner's: home, speeds, pitches
    ETUDE_ASSIGN_OR_RETURN(const auto yaml, ReadBinaryFile(robot));
    all += Sha256Hex(yaml);
  }
  return Sha256Hex(all);
}

Result<std::string> UserFiles::Sha256(const CampaignSpec& spec) {
  const MutexLock lock(mutex_);
  std::string spec_sha256 = SpecHash(spec);
  if (spec_sha256 == spec_sha256_ && StampOf(files_) == stamp_) return sha256_;
  ETUDE_ASSIGN_OR_RETURN(auto files, FilesOf(spec));
  std::string stamp = StampOf(files);  // before they are read: what is written meanwhile is seen the next time
  ETUDE_ASSIGN_OR_RETURN(sha256_, UserFilesSha256(spec));
  spec_sha256_ = std::move(spec_sha256);
  files_ = std::move(files);
  stamp_ = std::move(stamp);
  return sha256_;
}

}  // namespace etude::task
