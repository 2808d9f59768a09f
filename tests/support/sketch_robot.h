// SPDX-License-Identifier: Apache-2.0
// A copy of the robot that comes along as an example, to change.
#pragma once

#include <filesystem>
#include <string>

#include "tests/support/replace_in_file.h"
#include "tests/support/temporary_folder.h"

namespace etude {

class SketchRobot {
 public:
  SketchRobot() { std::filesystem::copy("deploy/robots", folder_.path(), std::filesystem::copy_options::recursive); }
  /// The YAML, as a spec names it.
  std::string yaml() const { return (folder_.path() / "sketch.yaml").string(); }
  void InYaml(const std::string& from, const std::string& to) { ReplaceInFile(yaml(), from, to); }
  void InMjcf(const std::string& from, const std::string& to) {
    ReplaceInFile(folder_.path() / "sketch/sketch.xml", from, to);
  }
  /// Five joints: its forearm does not roll.
  void WithoutRoll() {
    InMjcf("<joint name=\"roll\" axis=\"0 0 1\" range=\"-175 175\" armature=\"0.02\"/>", "");
    InMjcf("<position joint=\"roll\" kp=\"500\" forcerange=\"-30 30\"/>", "");
    InYaml("bend, roll, nod", "bend, nod");
    InYaml("[0, -0.15, 1.95, 0, 1.3416, 0]", "[0, -0.15, 1.95, 1.3416, 0]");
    InYaml("[2.5, 2.5, 2.5, 3, 3, 3]", "[2.5, 2.5, 2.5, 3, 3]");
  }

 private:
  TemporaryFolder folder_;
};

}  // namespace etude
