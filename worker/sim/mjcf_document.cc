// SPDX-License-Identifier: Apache-2.0
#include "worker/sim/mjcf_document.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <set>
#include <sstream>

namespace etude::sim {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using tinyxml2::XMLElement;

constexpr int kDeepestInclude = 16;
constexpr std::uint64_t kLargestFile = 64u << 20;  ///< bytes of one XML file
constexpr std::size_t kMostFiles = 1000;

/// Settings of <compiler> that decide on masses, with their defaults.
constexpr std::array kMassSettings{std::pair{"boundmass", "0"},           std::pair{"boundinertia", "0"},
                                   std::pair{"settotalmass", "-1"},       std::pair{"balanceinertia", "false"},
                                   std::pair{"inertiafromgeom", "auto"},  std::pair{"inertiagrouprange", "0 5"},
                                   std::pair{"exactmeshinertia", "false"}};

/// Elements that later releases brought and that cannot be left out.
const std::set<std::string> kNewerElements{"frame", "replicate", "attach", "flexcomp", "plugin", "model"};

/// Attributes that later releases brought and that a scene of ours does not need.
const std::set<std::pair<std::string, std::string>> kNewerAttributes{{"joint", "actuatorfrcrange"},
                                                                     {"joint", "actuatorfrclimited"},
                                                                     {"joint", "actuatorgravcomp"},
                                                                     {"mesh", "maxhullvert"},
                                                                     {"mesh", "inertia"},
                                                                     {"mesh", "content_type"},
                                                                     {"texture", "content_type"},
                                                                     {"texture", "colorspace"},
                                                                     {"texture", "nchannel"},
                                                                     {"material", "metallic"},
                                                                     {"material", "roughness"},
                                                                     {"body", "gravcomp"},
                                                                     {"body", "sleep"},
                                                                     {"fixed", "actuatorfrcrange"},
                                                                     {"fixed", "armature"},
                                                                     {"spatial", "actuatorfrcrange"},
                                                                     {"spatial", "armature"}};

/// An actuator's defaults may stand under any of its kinds.
bool SharesDefaults(const XMLElement& defaults, const XMLElement& element) {
  static const std::set<std::string> kActuators{"general", "motor",    "position", "velocity",
                                                "damper",  "cylinder", "muscle",   "intvelocity"};
  return IsElement(defaults, element.Name()) ||
         (kActuators.contains(defaults.Name()) && kActuators.contains(element.Name()));
}

/// The next actuator of `joint`, or null.
const XMLElement* ActuatorOf(const XMLElement* actuators, const std::string& joint, const XMLElement* after) {
  const XMLElement* next = after ? after->NextSiblingElement() : actuators ? actuators->FirstChildElement() : nullptr;
  for (; next; next = next->NextSiblingElement())
    if (Attribute(*next, "joint") == joint || Attribute(*next, "jointinparent") == joint) return next;
  return nullptr;
}

double Largest(const std::string& numbers) {
  double most = 0;
  for (const double value : NumbersOf(numbers)) most = std::max(most, std::abs(value));
  return most;
}

}  // namespace

std::string Attribute(const XMLElement& element, const char* name) {
  const char* value = element.Attribute(name);
  return value ? value : "";
}

bool IsElement(const XMLElement& element, const char* name) { return std::strcmp(element.Name(), name) == 0; }

std::vector<XMLElement*> Descendants(XMLElement* from, const char* name) {
  std::vector<XMLElement*> found;
  if (IsElement(*from, name)) found.push_back(from);
  for (XMLElement* child = from->FirstChildElement(); child; child = child->NextSiblingElement()) {
    const auto below = Descendants(child, name);
    found.insert(found.end(), below.begin(), below.end());
  }
  return found;
}

std::vector<double> NumbersOf(const std::string& text) {
  std::istringstream stream(text);
  std::vector<double> values;
  for (std::string word; stream >> word;) values.push_back(std::strtod(word.c_str(), nullptr));
  return values;
}

Pose PoseOf(const XMLElement& element) {
  Pose pose;
  if (const auto p = NumbersOf(Attribute(element, "pos")); p.size() == 3) pose.p = Vector3d(p[0], p[1], p[2]);
  if (const auto q = NumbersOf(Attribute(element, "quat")); q.size() == 4)
    pose.q = Quaterniond(q[0], q[1], q[2], q[3]).normalized();
  return pose;
}

void SetPose(XMLElement& element, const Pose& pose) {
  const Quaterniond& q = pose.q;
  element.SetAttribute("pos", fmt::format("{} {} {}", pose.p.x(), pose.p.y(), pose.p.z()).c_str());
  element.SetAttribute("quat", fmt::format("{} {} {} {}", q.w(), q.x(), q.y(), q.z()).c_str());
}

Result<MjcfDocument> MjcfDocument::Read(const Path& file) {
  MjcfDocument mjcf;
  mjcf.file_ = file;
  ETUDE_RETURN_IF_ERROR(mjcf.ReadInto(*mjcf.document_, file, 0));
  mjcf.JoinSections();
  ETUDE_RETURN_IF_ERROR(mjcf.ReadCompiler());
  ETUDE_RETURN_IF_ERROR(mjcf.RefuseWhatIsNewer());
  for (const char* section : {"default", "worldbody"})
    if (XMLElement* element = mjcf.Section(section)) ETUDE_RETURN_IF_ERROR(mjcf.Normalise(element));
  return mjcf;
}

Status MjcfDocument::ReadInto(tinyxml2::XMLDocument& document, const Path& path, int depth) {
  if (depth > kDeepestInclude || sources_.size() >= kMostFiles)
    return Fail(Code::kInvalidArgument, fmt::format("{}: includes go more than {} deep or to more than {} files",
                                                    file_.string(), kDeepestInclude, kMostFiles));
  ETUDE_ASSIGN_OR_RETURN(const std::string text, ReadTextFile(path, kLargestFile));
  if (document.Parse(text.c_str(), text.size()) != tinyxml2::XML_SUCCESS)
    return Fail(Code::kInvalidArgument, fmt::format("{} is no XML: {}", path.string(), document.ErrorStr()));
  XMLElement* root = document.RootElement();
  if (!root || !std::string_view(root->Name()).starts_with("mujoco"))
    return Fail(Code::kInvalidArgument,
                fmt::format("{} is no MJCF: its root is <{}>, not <mujoco>", path.string(), root ? root->Name() : ""));
  sources_.push_back(path);
  return PutIncludesIn(document, root, depth);
}

Status MjcfDocument::PutIncludesIn(tinyxml2::XMLDocument& document, XMLElement* parent, int depth) {
  for (XMLElement* child = parent->FirstChildElement(); child;) {
    XMLElement* const here = child;
    child = child->NextSiblingElement();
    if (!IsElement(*here, "include")) {
      ETUDE_RETURN_IF_ERROR(PutIncludesIn(document, here, depth));
      continue;
    }
    // MuJoCo's rule: from the main file's folder, whoever includes
    tinyxml2::XMLDocument included;
    ETUDE_RETURN_IF_ERROR(
        ReadInto(included, (file_.parent_path() / Attribute(*here, "file")).lexically_normal(), depth + 1));
    tinyxml2::XMLNode* last = here;
    for (const auto* node = included.RootElement()->FirstChildElement(); node; node = node->NextSiblingElement())
      last = parent->InsertAfterChild(last, node->DeepClone(&document));
    parent->DeleteChild(here);
  }
  return {};
}

XMLElement* MjcfDocument::Section(const char* name) const { return document_->RootElement()->FirstChildElement(name); }

std::string MjcfDocument::MainClass() const {
  const XMLElement* defaults = Section("default");
  return defaults ? Attribute(*defaults, "class") : "main";
}

void MjcfDocument::JoinSections() {
  XMLElement* root = document_->RootElement();
  for (XMLElement* later = root->FirstChildElement(); later;) {
    XMLElement* const here = later;
    later = later->NextSiblingElement();
    XMLElement* const first = Section(here->Name());
    if (first == here) continue;
    for (const auto* attribute = here->FirstAttribute(); attribute; attribute = attribute->Next())
      first->SetAttribute(attribute->Name(), attribute->Value());
    while (XMLElement* child = here->FirstChildElement()) {
      // a class says of each kind once what it says; the later counts
      const bool of_class = IsElement(*here, "default") && !IsElement(*child, "default");
      XMLElement* const known = of_class ? first->FirstChildElement(child->Name()) : nullptr;
      if (!known) {
        first->InsertEndChild(child);
        continue;
      }
      for (const auto* attribute = child->FirstAttribute(); attribute; attribute = attribute->Next())
        known->SetAttribute(attribute->Name(), attribute->Value());
      here->DeleteChild(child);
    }
    root->DeleteChild(here);
  }
  if (XMLElement* defaults = Section("default"); defaults && !defaults->Attribute("class"))
    defaults->SetAttribute("class", "main");
}

Status MjcfDocument::ReadCompiler() {
  const XMLElement* compiler = Section("compiler");
  if (!compiler) return {};
  const auto value = [&](const char* name) { return Attribute(*compiler, name); };
  if (value("coordinate") == "global")
    return Fail(Code::kInvalidArgument, fmt::format("{}: <compiler coordinate=\"global\"/> is not supported: "
                                                    "save it with local coordinates",
                                                    file_.string()));
  if (value("fitaabb") == "true")
    return Fail(Code::kInvalidArgument,
                fmt::format("{}: <compiler fitaabb=\"true\"/> is not supported: write the sizes of "
                            "geoms that are fitted to meshes, or leave it out",
                            file_.string()));
  degrees_ = value("angle") != "radian";
  strip_paths_ = value("strippath") == "true";
  mesh_folder_ = compiler->Attribute("meshdir") ? value("meshdir") : value("assetdir");
  texture_folder_ = compiler->Attribute("texturedir") ? value("texturedir") : value("assetdir");
  if (const std::string order = value("eulerseq"); !order.empty()) {
    if (order.size() != 3 || order.find_first_not_of("xyzXYZ") != std::string::npos)
      return Fail(Code::kInvalidArgument, fmt::format("{}: eulerseq '{}' is not three of xyz", file_.string(), order));
    euler_order_ = order;
  }
  for (const auto& [name, usual] : kMassSettings)
    if (compiler->Attribute(name) && value(name) != usual)
      mass_settings_ += fmt::format(" {}=\"{}\"", name, value(name));
  return {};
}

Status MjcfDocument::RefuseWhatIsNewer() const {
  for (const char* section : {"worldbody", "asset"})
    for (const std::string& name : kNewerElements)
      if (XMLElement* from = Section(section); from && !Descendants(from, name.c_str()).empty())
        return Fail(Code::kInvalidArgument,
                    fmt::format("{}: <{}> belongs to a later MuJoCo than 2.2, which is what Etude has: open the file "
                                "with that later one and save it as XML, which writes out what <{}> stands for",
                                file_.string(), name, name));
  return {};
}

const XMLElement* MjcfDocument::DefaultsOf(const XMLElement& element) const {
  XMLElement* main = Section("default");
  if (!main) return nullptr;
  std::string name = Attribute(element, "class");
  for (const tinyxml2::XMLNode* above = element.Parent(); name.empty() && above; above = above->Parent())
    if (const XMLElement* body = above->ToElement()) name = Attribute(*body, "childclass");
  for (const XMLElement* candidate : Descendants(main, "default"))
    if (Attribute(*candidate, "class") == name) return candidate;
  return main;
}

std::string MjcfDocument::Resolved(const XMLElement& element, const char* attribute) const {
  if (element.Attribute(attribute)) return Attribute(element, attribute);
  for (const XMLElement* defaults = DefaultsOf(element); defaults && IsElement(*defaults, "default");
       defaults = defaults->Parent()->ToElement()) {
    std::string value;
    for (const XMLElement* item = defaults->FirstChildElement(); item; item = item->NextSiblingElement())
      if (SharesDefaults(*item, element) && item->Attribute(attribute)) value = Attribute(*item, attribute);
    if (!value.empty()) return value;
  }
  return "";
}

Path MjcfDocument::AssetPath(const XMLElement& asset, const std::string& file) const {
  const std::string name = strip_paths_ ? file.substr(file.find_last_of("/\\") + 1) : file;
  const std::string& folder = IsElement(asset, "texture") ? texture_folder_ : mesh_folder_;
  return (file_.parent_path() / folder / name).lexically_normal();
}

double MjcfDocument::ActuatorLimit(const std::string& joint) const {
  double limit = 0;
  const XMLElement* actuators = Section("actuator");
  for (const XMLElement* item = ActuatorOf(actuators, joint, nullptr); item;
       item = ActuatorOf(actuators, joint, item)) {
    const auto value = [&](const char* name) { return Resolved(*item, name); };
    const auto number = [&](const char* name) {
      const std::vector<double> numbers = NumbersOf(value(name));
      return numbers.empty() ? 1.0 : numbers[0];
    };
    const double gear = std::abs(number("gear"));
    double own = value("forcelimited") != "false" ? gear * Largest(value("forcerange")) : 0;
    const bool motor = IsElement(*item, "motor") || (IsElement(*item, "general") && value("biastype") != "affine");
    if (own == 0 && motor && value("ctrllimited") != "false")
      own = gear * (IsElement(*item, "motor") ? 1 : number("gainprm")) * Largest(value("ctrlrange"));
    limit = std::max(limit, own);
  }
  for (XMLElement* element : Descendants(Section("worldbody"), "joint"))
    if (Attribute(*element, "name") == joint)
      if (const double most = Largest(Resolved(*element, "actuatorfrcrange")); most > 0)
        limit = limit > 0 ? std::min(limit, most) : most;
  return limit;
}

void MjcfDocument::DropNewerAttributes() {
  for (const auto& [element, attribute] : kNewerAttributes)
    for (XMLElement* found : Descendants(document_->RootElement(), element.c_str()))
      found->DeleteAttribute(attribute.c_str());
}

}  // namespace etude::sim
