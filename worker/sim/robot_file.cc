// SPDX-License-Identifier: Apache-2.0
#include "worker/sim/robot_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>

#include "services/core/thread_annotations.h"
#include "services/episode/pose.h"
#include "worker/sim/robot_builder.h"
#include "worker/sim/robot_masses.h"

namespace etude::sim {
namespace {

using Eigen::Vector3d;

Result<RobotFile> ReadFile(const Path& yaml) {
  ETUDE_ASSIGN_OR_RETURN(RobotFile file, LoadConfig<RobotFile>(yaml));
  if (file.joints.empty()) return Fail(Code::kInvalidArgument, fmt::format("{}: joints: none named", yaml.string()));
  return file;
}

/// Visual geoms without mass where `masses` says so.
Result<RobotXml> ReadXml(const Path& yaml, const char* key, const std::string& mjcf, const std::string& joint,
                         const char* prefix, const std::string& masses) {
  const Path path = yaml.parent_path() / mjcf;
  if (mjcf.empty() || !std::filesystem::is_regular_file(path))
    return Fail(Code::kNotFound, fmt::format("{}: {}: no file '{}'", yaml.string(), key, path.string()));
  ETUDE_ASSIGN_OR_RETURN(MjcfDocument document, MjcfDocument::Read(path));
  ETUDE_ASSIGN_OR_RETURN(RobotXml xml, RobotXml::Take(std::move(document), joint, prefix));
  if (masses == kMassesOfCollision) {
    ETUDE_RETURN_IF_ERROR(LightenVisuals(xml));
  }
  return xml;
}

Result<RobotXml> ReadArm(const Path& yaml, const RobotFile& file) {
  return ReadXml(yaml, "mjcf", file.mjcf, file.joints.at(0), "user_", file.masses);
}
Result<RobotXml> ReadHand(const Path& yaml, const RobotFile& file) {
  return ReadXml(yaml, "gripper.mjcf", file.gripper.mjcf, file.gripper.joint, "gripper_", file.masses);
}

/// Arm and, where it has a file of its own, gripper.
/// @param names  filled with the names that both have before `taken` changes some
Result<RobotXml> ReadRobotXml(const Path& yaml, const RobotFile& file, std::set<std::string> taken,
                              std::set<std::string>& names) {
  ETUDE_ASSIGN_OR_RETURN(RobotXml arm, ReadArm(yaml, file));
  ETUDE_RETURN_IF_ERROR(FixMasses(arm));
  names = arm.Names();
  arm.Rename(taken);
  const RobotFile::Gripper& hand = file.gripper;
  if (hand.mjcf.empty() && hand.attach.empty()) return arm;
  if (hand.attach.empty() || hand.position.size() != 3 || hand.euler.size() != 3)
    return Fail(Code::kInvalidArgument,
                fmt::format("{}: gripper: mjcf needs attach (a body or site of the arm), and three numbers each of "
                            "position and euler",
                            yaml.string()));
  ETUDE_ASSIGN_OR_RETURN(RobotXml gripper, ReadHand(yaml, file));
  ETUDE_RETURN_IF_ERROR(FixMasses(gripper));
  names.merge(gripper.Names());
  taken.merge(arm.Names());
  gripper.Rename(taken);
  const Pose X{Vector3d::Map(hand.position.data()), FromEuler(Vector3d::Map(hand.euler.data()))};
  ETUDE_RETURN_IF_ERROR(arm.Attach(std::move(gripper), arm.NameOf("site", arm.NameOf("body", hand.attach)), X));
  return arm;
}

Result<LoadedRobot> ReadRobot(const Path& yaml, const std::set<std::string>& taken) {
  ETUDE_ASSIGN_OR_RETURN(const RobotFile file, ReadFile(yaml));
  std::set<std::string> names;
  ETUDE_ASSIGN_OR_RETURN(RobotXml xml, ReadRobotXml(yaml, file, taken, names));
  ETUDE_ASSIGN_OR_RETURN(const ModelPtr alone, CompileAlone(xml));
  ETUDE_ASSIGN_OR_RETURN(LoadedRobot robot, BuildRobot(file, xml, alone.get(), yaml.string()));
  robot.sources.push_back(yaml);
  robot.names = std::move(names);
  return robot;
}

/// Robots as they were read last: a campaign builds a scene for each episode.
class Cache {
 public:
  Result<LoadedRobot> Get(const Path& yaml, const std::set<std::string>& taken) {
    const MutexLock lock(mutex_);
    Entry& entry = entries_[yaml.string()];
    if (entry.robots.empty() || entry.stamp != StampOf(entry.sources)) {
      entry = {};
      ETUDE_ASSIGN_OR_RETURN(LoadedRobot robot, ReadRobot(yaml, taken));
      entry.sources = robot.sources;
      entry.names = robot.names;
      entry.stamp = StampOf(robot.sources);
      return entry.robots[Common(entry.names, taken)] = std::move(robot);
    }
    const auto found = entry.robots.find(Common(entry.names, taken));
    if (found != entry.robots.end()) return found->second;
    ETUDE_ASSIGN_OR_RETURN(LoadedRobot robot, ReadRobot(yaml, taken));
    return entry.robots[Common(entry.names, taken)] = std::move(robot);
  }

 private:
  using Names = std::set<std::string>;
  static Names Common(const Names& a, const Names& b) {
    Names both;
    std::ranges::set_intersection(a, b, std::inserter(both, both.end()));
    return both;
  }
  struct Entry {
    std::vector<Path> sources;
    std::string stamp;
    Names names;
    std::map<Names, LoadedRobot> robots;  ///< by those of its names that were taken
  };
  Mutex mutex_;
  std::map<std::string, Entry> entries_ ETUDE_GUARDED_BY(mutex_);
};

}  // namespace

bool IsRobotFile(const std::string& robot) { return robot.ends_with(".yaml"); }

Result<LoadedRobot> LoadRobot(const Path& yaml, const std::set<std::string>& taken) {
  InstallHandlers();
  static Cache cache;
  return cache.Get(yaml, taken);
}

Result<std::vector<VisualMass>> WeighVisuals(const Path& yaml) {
  InstallHandlers();
  ETUDE_ASSIGN_OR_RETURN(const RobotFile file, ReadFile(yaml));
  ETUDE_ASSIGN_OR_RETURN(RobotXml arm, ReadArm(yaml, file));
  const std::string base = Attribute(*arm.root(), "name");
  ETUDE_ASSIGN_OR_RETURN(std::vector<VisualMass> visuals, VisualMassesOf(std::move(arm)));
  std::erase_if(visuals, [&](const VisualMass& visual) { return visual.body == base; });
  if (!file.gripper.mjcf.empty()) {
    ETUDE_ASSIGN_OR_RETURN(RobotXml hand, ReadHand(yaml, file));
    ETUDE_ASSIGN_OR_RETURN(const std::vector<VisualMass> more, VisualMassesOf(std::move(hand)));
    visuals.insert(visuals.end(), more.begin(), more.end());
  }
  std::ranges::stable_sort(visuals, std::greater(), &VisualMass::mass);
  return visuals;
}

MassReport WeighRobot(const Scene& scene) {
  constexpr double kHeaviest = 100, kWidest = 0.7, kNarrowest = 5e-4;  // kg; m, radius of gyration
  const mjModel* mj = scene.model().mj.get();
  MassReport report;
  for (std::size_t i = 1; i < scene.arm().bodies.size(); ++i) {
    const std::string& name = scene.arm().bodies[i];
    const int body = scene.model().BodyId(name);
    const double mass = mj->body_mass[body];
    if (mass == 0) continue;  // a frame
    report.total += mass;
    const auto inertia = Vector3d::Map(mj->body_inertia + 3 * body);
    const double widest = std::sqrt(inertia.maxCoeff() / mass), narrowest = std::sqrt(inertia.minCoeff() / mass);
    if (mass > kHeaviest) report.implausible.push_back(fmt::format("{} has {:g} kg", name, mass));
    if (widest > kWidest || narrowest < kNarrowest)
      report.implausible.push_back(fmt::format("{} has radii of gyration {:g} .. {:g} m", name, narrowest, widest));
  }
  return report;
}

}  // namespace etude::sim
