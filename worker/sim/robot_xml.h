// SPDX-License-Identifier: Apache-2.0
// Private to worker/sim: the XML of a robot, made fit to stand in a scene of ours.
#pragma once

#include <map>
#include <set>
#include <string>
#include <vector>

#include "services/core/file.h"
#include "services/core/result.h"
#include "worker/assets/object.h"
#include "worker/sim/mjcf_document.h"

namespace etude::sim {

/// What is taken from a document: one body of its world with all below, and the defaults, assets, equalities and
/// tendons that belong to it. Assets and classes get a prefix, so that none has a name of ours; every body and geom
/// has a name. Lights, cameras, sensors, actuators and what else stands in its world stay behind.
class RobotXml {
 public:
  /// @param joint  some joint of the robot
  /// @param prefix  of classes and assets, "user_"
  /// @error kInvalidArgument: no such joint; kNotFound: a mesh or texture; kCorrupt: one that is a Git LFS pointer
  static Result<RobotXml> Take(MjcfDocument document, const std::string& joint, std::string prefix);

  /// Gives another name to what is named like one of `taken`: bodies, joints, geoms and sites.
  void Rename(const std::set<std::string>& taken);
  /// The name that "body", "joint", "geom" or "site" `name` of the file has now; an attached gripper's file comes
  /// first.
  std::string NameOf(const std::string& kind, const std::string& name) const;
  /// The same of the arm's own file, where both have a `name`.
  std::string ArmNameOf(const std::string& kind, const std::string& name) const;
  /// Puts `gripper`, whose names are not this robot's, under body or site `at`, displaced by `X`.
  /// @error kInvalidArgument: no such body or site
  Status Attach(RobotXml gripper, const std::string& at, const Pose& X);

  tinyxml2::XMLElement* root() const { return root_; }  ///< <body>, the robot's base
  /// <body>, <geom>, <joint> or <site> of that name in the robot, or null.
  tinyxml2::XMLElement* Find(const char* element, const std::string& name) const;
  /// See MjcfDocument; of the robot's own file, before a gripper is attached.
  std::string Resolved(const tinyxml2::XMLElement& element, const char* attribute) const {
    return document_.Resolved(element, attribute);
  }
  std::vector<tinyxml2::XMLElement*> All(const char* element) const;  ///< of the robot, in the order of the text
  std::set<std::string> Names() const;                                ///< of bodies, joints, geoms and sites
  /// See MjcfDocument; of the attached gripper, too. `joint` as it is now.
  double ActuatorLimit(const std::string& joint) const;
  const std::string& mass_settings() const { return document_.mass_settings(); }
  std::string prefix() const { return prefix_; }
  const Path& file() const { return document_.file(); }

  std::string Defaults() const;  ///< for inside our <default>
  std::string Assets() const;    ///< for inside our <asset>
  std::string Body() const;
  std::string Equality() const;
  std::string Tendon() const;
  const std::vector<assets::AssetFile>& files() const { return files_; }
  const std::vector<Path>& sources() const { return sources_; }  ///< every file that was read
  const std::vector<std::string>& notes() const { return notes_; }

 private:
  explicit RobotXml(MjcfDocument document) : document_(std::move(document)) {}
  Status FindRoot(const std::string& joint);
  void Prefix(tinyxml2::XMLElement* element);
  void NameAssets();
  void NameEverything();
  void DropWhatStaysBehind();
  void DropUnusedAssets();
  void KeepOnlyOwn(const char* section);
  Status TakeFiles();
  std::string Children(const char* section) const;

  MjcfDocument document_;
  std::string prefix_, main_class_;
  tinyxml2::XMLElement* root_ = nullptr;
  /// (kind, name) to the name now.
  using NewNames = std::map<std::pair<std::string, std::string>, std::string>;

  std::map<std::string, double> limits_;  ///< of joints, by their name now
  NewNames renamed_, gripper_renamed_;
  std::string other_defaults_, other_assets_, other_equality_, other_tendon_;  ///< of the gripper
  std::vector<assets::AssetFile> files_;
  std::vector<Path> sources_;
  std::vector<std::string> notes_;
};

}  // namespace etude::sim
