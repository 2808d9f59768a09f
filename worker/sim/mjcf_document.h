// SPDX-License-Identifier: Apache-2.0
// Private to worker/sim: an MJCF file as MuJoCo's compiler understands it, still a document.
#pragma once

#include <tinyxml2.h>

#include <memory>
#include <string>
#include <vector>

#include "services/core/file.h"
#include "services/core/result.h"
#include "services/episode/pose.h"

namespace etude::sim {

/// An MJCF file made independent of its place and its compiler settings: what it includes put in, sections of one
/// name joined, angles in radians, orientations as quaternions. MuJoCo's own way there is mj_saveLastXML, which throws
/// on legal files (a default `<geom type="mesh" mass="0"/>`). Movable; not thread-safe.
class MjcfDocument {
 public:
  /// @error kNotFound: a file; kInvalidArgument: no XML, no MJCF, or what MuJoCo 2.2 has no word for
  static Result<MjcfDocument> Read(const Path& file);

  /// A section of <mujoco>, e.g. "asset"; null when there is none.
  tinyxml2::XMLElement* Section(const char* name) const;
  /// What the class at the top of <default> is called.
  std::string MainClass() const;
  tinyxml2::XMLDocument& document() { return *document_; }
  /// What `element` or else its default class says of `attribute`; "" when neither does.
  std::string Resolved(const tinyxml2::XMLElement& element, const char* attribute) const;
  /// Where the file of an asset (<mesh>, <texture> or <hfield>) is.
  Path AssetPath(const tinyxml2::XMLElement& asset, const std::string& file) const;
  /// N m (N of a slide) that the file's own actuator of a joint gives at most; 0 when it does not say.
  double ActuatorLimit(const std::string& joint) const;
  /// Leaves out what later releases of MuJoCo added without a meaning for a scene of ours. Actuators' limits are
  /// among it: ask for them before.
  void DropNewerAttributes();

  /// Those settings of <compiler> that decide on masses, as attributes of a <compiler>; "" when they are the defaults.
  const std::string& mass_settings() const { return mass_settings_; }
  const Path& file() const { return file_; }
  const std::vector<Path>& sources() const { return sources_; }  ///< this file and what it includes

 private:
  MjcfDocument() : document_(std::make_unique<tinyxml2::XMLDocument>()) {}
  Status ReadInto(tinyxml2::XMLDocument& document, const Path& path, int depth);
  Status PutIncludesIn(tinyxml2::XMLDocument& document, tinyxml2::XMLElement* parent, int depth);
  void JoinSections();
  Status ReadCompiler();
  Status RefuseWhatIsNewer() const;
  Status Normalise(tinyxml2::XMLElement* element);
  const tinyxml2::XMLElement* DefaultsOf(const tinyxml2::XMLElement& element) const;

  Path file_;
  std::unique_ptr<tinyxml2::XMLDocument> document_;
  bool degrees_ = true, strip_paths_ = false;
  std::string euler_order_ = "xyz", mesh_folder_, texture_folder_, mass_settings_;
  std::vector<Path> sources_;
};

/// Attribute of an element, "" when it has none.
std::string Attribute(const tinyxml2::XMLElement& element, const char* name);
bool IsElement(const tinyxml2::XMLElement& element, const char* name);
/// Elements of that name at and below `from`, in the order of the text.
std::vector<tinyxml2::XMLElement*> Descendants(tinyxml2::XMLElement* from, const char* name);
/// `pos` and `quat` of a normalised element.
Pose PoseOf(const tinyxml2::XMLElement& element);
void SetPose(tinyxml2::XMLElement& element, const Pose& pose);
std::vector<double> NumbersOf(const std::string& text);

}  // namespace etude::sim
