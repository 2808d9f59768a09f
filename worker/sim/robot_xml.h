// SPDX-License-Identifier: Apache-2.0
// Private to worker/sim: the XML of a user's robot, made fit to stand in a scene of ours.
#pragma once

#include <tinyxml2.h>

#include <memory>
#include <string>
#include <vector>

#include "services/core/file.h"
#include "services/core/result.h"
#include "worker/assets/object.h"

namespace etude::sim {

/// What is taken from the user's document, renamed so that no asset and no class has a name of ours, every body
/// and geom with a name.
class RobotXml {
 public:
  /// @param normalised  as mj_saveLastXML writes it: no includes, radians, quaternions
  /// @param folder  of the user's file, for meshes and textures
  /// @param joint  some joint of the robot
  static Result<RobotXml> Parse(const std::string& normalised, const Path& folder, const std::string& joint);

  tinyxml2::XMLElement* root() { return root_; }  ///< <body>, the robot's base
  /// <body>, <geom>, <joint> or <site> of that name in the robot, or null.
  tinyxml2::XMLElement* Find(const char* element, const std::string& name);
  std::vector<tinyxml2::XMLElement*> All(const char* element);  ///< of the robot, in the order of the text

  std::string Defaults();  ///< for inside our <default>
  std::string Assets();    ///< for inside our <asset>
  std::string Body();
  std::string Equality();  ///< of joints and bodies of the robot
  std::string Tendon();
  const std::vector<assets::AssetFile>& files() const { return files_; }
  const std::vector<std::string>& notes() const { return notes_; }

 private:
  RobotXml() : document_(std::make_unique<tinyxml2::XMLDocument>()) {}
  void Rename(tinyxml2::XMLElement* element);
  void NameEverything();
  void DropWhatStaysBehind();
  Status TakeFiles(const Path& folder);
  tinyxml2::XMLElement* Section(const char* name);
  std::string Children(const char* section);

  std::unique_ptr<tinyxml2::XMLDocument> document_;
  tinyxml2::XMLElement* root_ = nullptr;
  std::vector<assets::AssetFile> files_;
  std::vector<std::string> notes_;
};

}  // namespace etude::sim
