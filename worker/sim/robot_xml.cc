// SPDX-License-Identifier: Apache-2.0
#include "worker/sim/robot_xml.h"

#include <fmt/format.h>

#include <array>

namespace etude::sim {
namespace {

using tinyxml2::XMLElement;

constexpr std::array kNamed{"body", "joint", "geom", "site"};
constexpr std::array kAssetReferences{"material", "mesh", "hfield", "texture"};
/// What may stand in <default> of our scene: defaults of actuators and sensors stay behind with them.
const std::set<std::string> kDefaults{"default", "geom", "joint", "site", "mesh", "material", "equality", "tendon"};
/// Attributes of equalities and tendons that name something, and of which kind.
const std::map<std::string, std::string> kReferences{{"joint1", "joint"},  {"joint2", "joint"}, {"joint", "joint"},
                                                     {"body1", "body"},    {"body2", "body"},   {"site", "site"},
                                                     {"sidesite", "site"}, {"geom", "geom"}};

std::string Print(const XMLElement* element) {
  tinyxml2::XMLPrinter printer;
  element->Accept(&printer);
  return printer.CStr();
}

template <class Visit>
void ForEach(XMLElement* from, const Visit& visit) {
  visit(*from);
  for (XMLElement* child = from->FirstChildElement(); child; child = child->NextSiblingElement()) ForEach(child, visit);
}

/// Deletes the children of `parent` for which `unwanted` is true.
template <class Unwanted>
void DeleteChildren(XMLElement* parent, const Unwanted& unwanted) {
  for (XMLElement* child = parent->FirstChildElement(); child;) {
    XMLElement* const here = child;
    child = child->NextSiblingElement();
    if (unwanted(*here)) parent->DeleteChild(here);
  }
}

}  // namespace

Result<RobotXml> RobotXml::Take(MjcfDocument document, const std::string& joint, std::string prefix) {
  RobotXml xml(std::move(document));
  xml.prefix_ = std::move(prefix);
  xml.sources_ = xml.document_.sources();
  ETUDE_RETURN_IF_ERROR(xml.FindRoot(joint));
  for (XMLElement* element : xml.All("joint"))
    if (const std::string name = Attribute(*element, "name"); !name.empty())
      xml.limits_[name] = xml.document_.ActuatorLimit(name);
  xml.main_class_ = xml.prefix_ + xml.document_.MainClass();
  xml.document_.DropNewerAttributes();
  xml.NameAssets();
  xml.DropWhatStaysBehind();
  xml.DropUnusedAssets();
  xml.Prefix(xml.document_.document().RootElement());
  if (!xml.root_->Attribute("childclass")) xml.root_->SetAttribute("childclass", xml.main_class_.c_str());
  xml.NameEverything();
  xml.KeepOnlyOwn("tendon");
  xml.KeepOnlyOwn("equality");
  ETUDE_RETURN_IF_ERROR(xml.TakeFiles());
  return xml;
}

Status RobotXml::FindRoot(const std::string& joint) {
  const std::string file = document_.file().string();
  XMLElement* world = document_.Section("worldbody");
  if (!world) return Fail(Code::kInvalidArgument, fmt::format("{} has no <worldbody>", file));
  for (XMLElement* body = world->FirstChildElement("body"); body; body = body->NextSiblingElement("body"))
    for (const XMLElement* found : Descendants(body, "joint"))
      if (Attribute(*found, "name") == joint) root_ = body;
  if (!root_) return Fail(Code::kInvalidArgument, fmt::format("{} has no joint '{}'", file, joint));
  for (XMLElement* other = world->FirstChildElement(); other; other = other->NextSiblingElement())
    if (other != root_ && !IsElement(*other, "light") && !IsElement(*other, "camera"))
      notes_.push_back(
          fmt::format("<{}> '{}' beside the robot stays behind", other->Name(), Attribute(*other, "name")));
  return {};
}

std::vector<XMLElement*> RobotXml::All(const char* element) const { return Descendants(root_, element); }

XMLElement* RobotXml::Find(const char* element, const std::string& name) const {
  for (XMLElement* candidate : All(element))
    if (Attribute(*candidate, "name") == name) return candidate;
  return nullptr;
}

std::set<std::string> RobotXml::Names() const {
  std::set<std::string> names;
  for (const char* kind : kNamed)
    for (const XMLElement* element : All(kind)) names.insert(Attribute(*element, "name"));
  names.erase("");
  return names;
}

double RobotXml::ActuatorLimit(const std::string& joint) const {
  const auto found = limits_.find(joint);
  return found == limits_.end() ? 0 : found->second;
}

void RobotXml::Prefix(XMLElement* element) {
  const auto prefix = [&](const char* attribute) {
    if (const char* value = element->Attribute(attribute)) element->SetAttribute(attribute, (prefix_ + value).c_str());
  };
  for (const char* reference : {"class", "childclass"}) prefix(reference);
  for (const char* reference : kAssetReferences) prefix(reference);
  const XMLElement* parent = element->Parent()->ToElement();
  const std::string section = parent ? parent->Name() : "";
  if (section == "asset") prefix("name");
  // outside of the body tree nothing inherits a childclass
  const bool classed =
      section == "equality" || section == "tendon" || IsElement(*element, "mesh") || IsElement(*element, "material");
  if (classed && section != "default" && !element->Attribute("class"))
    element->SetAttribute("class", main_class_.c_str());
  for (XMLElement* child = element->FirstChildElement(); child; child = child->NextSiblingElement()) Prefix(child);
}

/// An asset without a name has that of its file.
void RobotXml::NameAssets() {
  XMLElement* assets = document_.Section("asset");
  for (XMLElement* asset = assets ? assets->FirstChildElement() : nullptr; asset; asset = asset->NextSiblingElement())
    if (!asset->Attribute("name")) asset->SetAttribute("name", Path(Attribute(*asset, "file")).stem().c_str());
}

void RobotXml::DropWhatStaysBehind() {
  for (const char* kind : {"light", "camera", "freejoint", "joint"})
    for (XMLElement* element : All(kind)) {
      if (IsElement(*element, "joint") && Attribute(*element, "type") != "free") continue;
      if (!IsElement(*element, "light") && !IsElement(*element, "camera"))
        notes_.push_back("the free joint of its base is left out: the robot stands still");
      element->Parent()->DeleteChild(element);
    }
  for (XMLElement* site : All("site")) site->SetAttribute("group", 4);  // marks are not to be seen in pictures
  XMLElement* main = document_.Section("default");
  for (XMLElement* defaults : main ? Descendants(main, "default") : std::vector<XMLElement*>())
    DeleteChildren(defaults, [](const XMLElement& item) { return !kDefaults.contains(item.Name()); });
}

void RobotXml::DropUnusedAssets() {
  XMLElement* assets = document_.Section("asset");
  if (!assets) return;
  std::set<std::string> used;
  const auto note = [&](const XMLElement& element) {
    for (const char* reference : kAssetReferences)
      if (element.Attribute(reference)) used.insert(Attribute(element, reference));
  };
  ForEach(root_, note);
  for (const char* section : {"default", "tendon"})
    if (XMLElement* element = document_.Section(section)) ForEach(element, note);
  for (XMLElement* asset = assets->FirstChildElement(); asset; asset = asset->NextSiblingElement())
    if (IsElement(*asset, "material") && used.contains(Attribute(*asset, "name"))) note(*asset);
  DeleteChildren(assets, [&](const XMLElement& asset) { return !used.contains(Attribute(asset, "name")); });
}

void RobotXml::NameEverything() {
  for (const char* kind : {"body", "geom"}) {
    int number = 0;
    for (XMLElement* element : All(kind)) {
      if (Attribute(*element, "name").empty())  // "" is no name
        element->SetAttribute("name", fmt::format("{}{}_{}", prefix_, kind, number).c_str());
      ++number;
    }
  }
}

/// Leaves out what of equalities or tendons refers to something that stays behind.
void RobotXml::KeepOnlyOwn(const char* section) {
  XMLElement* items = document_.Section(section);
  if (!items) return;
  std::set<std::string> names = Names();
  if (const XMLElement* tendons = document_.Section("tendon"))
    for (const auto* tendon = tendons->FirstChildElement(); tendon; tendon = tendon->NextSiblingElement())
      names.insert(Attribute(*tendon, "name"));
  DeleteChildren(items, [&](XMLElement& item) {
    bool foreign = false;
    ForEach(&item, [&](const XMLElement& element) {
      for (const auto* attribute = element.FirstAttribute(); attribute; attribute = attribute->Next())
        if (const std::string key = attribute->Name();
            kReferences.contains(key) || key == "tendon1" || key == "tendon2" || key == "site1" || key == "site2")
          foreign = foreign || !names.contains(attribute->Value());
    });
    return foreign;
  });
}

Status RobotXml::TakeFiles() {
  XMLElement* assets = document_.Section("asset");
  if (!assets) return {};
  std::map<Path, std::string> taken;
  for (XMLElement* asset = assets->FirstChildElement(); asset; asset = asset->NextSiblingElement())
    for (const char* key : {"file", "fileright", "fileleft", "fileup", "filedown", "filefront", "fileback"}) {
      const std::string file = Attribute(*asset, key);
      if (file.empty()) continue;
      const Path path = document_.AssetPath(*asset, file);
      auto [entry, is_new] = taken.try_emplace(path);
      if (is_new) {
        entry->second = fmt::format("{}{}{}", prefix_, files_.size(), path.extension().string());
        ETUDE_ASSIGN_OR_RETURN(auto bytes, ReadBinaryFile(path));
        if (bytes.empty()) return Fail(Code::kCorrupt, fmt::format("{} is empty", path.string()));
        constexpr std::string_view kPointer = "version https://git-lfs";
        if (std::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size()).starts_with(kPointer))
          return Fail(Code::kCorrupt,
                      fmt::format("{} is a pointer of Git LFS, not the file: git lfs pull brings it", path.string()));
        files_.push_back({entry->second, std::move(bytes), true});
        sources_.push_back(path);
      }
      asset->SetAttribute(key, entry->second.c_str());
    }
  return {};
}

void RobotXml::Rename(const std::set<std::string>& taken) {
  std::set<std::string> names = Names();
  NewNames changed;
  for (const char* kind : kNamed)
    for (XMLElement* element : All(kind)) {
      const std::string name = Attribute(*element, "name");
      if (!taken.contains(name)) continue;
      std::string other = prefix_ + name;
      while (names.contains(other) || taken.contains(other)) other = prefix_ + other;
      element->SetAttribute("name", other.c_str());
      changed[{kind, name}] = other;
      notes_.push_back(fmt::format("{} '{}' is called '{}' here: there is a '{}' already", kind, name, other, name));
    }
  for (const char* section : {"equality", "tendon"})
    if (XMLElement* items = document_.Section(section))
      ForEach(items, [&](XMLElement& element) {
        for (const auto& [key, kind] : kReferences)
          if (const auto found = changed.find({kind, Attribute(element, key.c_str())}); found != changed.end())
            element.SetAttribute(key.c_str(), found->second.c_str());
      });
  for (const auto& [of, name] : changed) {
    if (of.first == "joint") limits_[name] = limits_[of.second];
    renamed_[of] = name;
  }
}

std::string RobotXml::NameOf(const std::string& kind, const std::string& name) const {
  const auto found = gripper_renamed_.find({kind, name});
  return found == gripper_renamed_.end() ? ArmNameOf(kind, name) : found->second;
}

std::string RobotXml::ArmNameOf(const std::string& kind, const std::string& name) const {
  const auto found = renamed_.find({kind, name});
  return found == renamed_.end() ? name : found->second;
}

Status RobotXml::Attach(RobotXml gripper, const std::string& at, const Pose& X) {
  XMLElement* body = Find("body", at);
  Pose X_BG = X;
  if (XMLElement* site = body ? nullptr : Find("site", at)) {
    body = site->Parent()->ToElement();
    X_BG = PoseOf(*site) * X;
  }
  if (!body)
    return Fail(Code::kInvalidArgument,
                fmt::format("gripper.attach: {} has no body or site '{}'", file().string(), at));
  std::string name = gripper.prefix_ + "mount";
  while (Find("body", name) || gripper.Find("body", name)) name = gripper.prefix_ + name;
  XMLElement* mount = body->InsertNewChildElement("body");
  mount->SetAttribute("name", name.c_str());
  SetPose(*mount, X_BG);
  mount->InsertEndChild(gripper.root_->DeepClone(&document_.document()));
  other_defaults_ = gripper.Defaults();
  other_assets_ = gripper.Assets();
  other_equality_ = gripper.Equality();
  other_tendon_ = gripper.Tendon();
  for (auto& file : gripper.files_) files_.push_back(std::move(file));
  sources_.insert(sources_.end(), gripper.sources_.begin(), gripper.sources_.end());
  for (const std::string& note : gripper.notes_) notes_.push_back("gripper: " + note);
  for (const auto& [joint, limit] : gripper.limits_) limits_.try_emplace(joint, limit);
  gripper_renamed_ = std::move(gripper.renamed_);
  return {};
}

std::string RobotXml::Children(const char* section) const {
  std::string text;
  if (const XMLElement* element = document_.Section(section))
    for (const XMLElement* child = element->FirstChildElement(); child; child = child->NextSiblingElement())
      text += Print(child);
  return text;
}

std::string RobotXml::Defaults() const {
  const XMLElement* defaults = document_.Section("default");
  return (defaults ? Print(defaults) : fmt::format("<default class=\"{}\"/>\n", main_class_)) + other_defaults_;
}

std::string RobotXml::Assets() const { return Children("asset") + other_assets_; }
std::string RobotXml::Body() const { return Print(root_); }
std::string RobotXml::Tendon() const { return Children("tendon") + other_tendon_; }
std::string RobotXml::Equality() const { return Children("equality") + other_equality_; }

}  // namespace etude::sim
