// SPDX-License-Identifier: Apache-2.0
#include "worker/sim/robot_xml.h"

#include <fmt/format.h>

#include <cstring>
#include <map>
#include <set>

namespace etude::sim {
namespace {

using tinyxml2::XMLElement;

const std::string kPrefix = "user_";

std::string Attribute(const XMLElement* element, const char* name) {
  const char* value = element->Attribute(name);
  return value ? value : "";
}

bool Is(const XMLElement* element, const char* name) { return std::strcmp(element->Name(), name) == 0; }

void Collect(XMLElement* from, const char* name, std::vector<XMLElement*>& found) {
  if (Is(from, name)) found.push_back(from);
  for (XMLElement* child = from->FirstChildElement(); child; child = child->NextSiblingElement())
    Collect(child, name, found);
}

std::string Print(const XMLElement* element) {
  tinyxml2::XMLPrinter printer;
  element->Accept(&printer);
  return printer.CStr();
}

}  // namespace

Result<RobotXml> RobotXml::Parse(const std::string& normalised, const Path& folder, const std::string& joint) {
  RobotXml xml;
  if (xml.document_->Parse(normalised.c_str(), normalised.size()) != tinyxml2::XML_SUCCESS)
    return Fail(Code::kInternal, fmt::format("read MuJoCo's own XML: {}", xml.document_->ErrorStr()));
  XMLElement* world = xml.Section("worldbody");
  if (!world) return Fail(Code::kInvalidArgument, "the MJCF has no <worldbody>");
  for (XMLElement* body = world->FirstChildElement("body"); body; body = body->NextSiblingElement("body")) {
    std::vector<XMLElement*> joints;
    Collect(body, "joint", joints);
    for (XMLElement* found : joints)
      if (Attribute(found, "name") == joint) xml.root_ = body;
  }
  if (!xml.root_) return Fail(Code::kInvalidArgument, fmt::format("the MJCF has no joint '{}'", joint));
  for (XMLElement* other = world->FirstChildElement(); other; other = other->NextSiblingElement())
    if (other != xml.root_ && !Is(other, "light") && !Is(other, "camera"))
      xml.notes_.push_back(
          fmt::format("<{}> '{}' beside the robot stays behind", other->Name(), Attribute(other, "name")));
  xml.Rename(xml.document_->RootElement());
  if (!xml.root_->Attribute("childclass")) xml.root_->SetAttribute("childclass", (kPrefix + "main").c_str());
  xml.DropWhatStaysBehind();
  xml.NameEverything();
  ETUDE_RETURN_IF_ERROR(xml.TakeFiles(folder));
  return xml;
}

XMLElement* RobotXml::Section(const char* name) { return document_->RootElement()->FirstChildElement(name); }

std::vector<XMLElement*> RobotXml::All(const char* element) {
  std::vector<XMLElement*> found;
  Collect(root_, element, found);
  return found;
}

XMLElement* RobotXml::Find(const char* element, const std::string& name) {
  for (XMLElement* candidate : All(element))
    if (Attribute(candidate, "name") == name) return candidate;
  return nullptr;
}

void RobotXml::Rename(XMLElement* element) {
  const auto prefix = [&](const char* attribute) {
    if (const char* value = element->Attribute(attribute)) element->SetAttribute(attribute, (kPrefix + value).c_str());
  };
  for (const char* reference : {"class", "childclass", "material", "mesh", "hfield", "texture"}) prefix(reference);
  const XMLElement* parent = element->Parent()->ToElement();
  const std::string section = parent ? parent->Name() : "";
  if (section == "asset") prefix("name");
  // outside of the body tree nothing inherits a childclass
  const bool classed = section == "equality" || section == "tendon" || Is(element, "mesh") || Is(element, "material");
  if (classed && section != "default" && !element->Attribute("class"))
    element->SetAttribute("class", (kPrefix + "main").c_str());
  for (XMLElement* child = element->FirstChildElement(); child; child = child->NextSiblingElement()) Rename(child);
}

void RobotXml::DropWhatStaysBehind() {
  for (const char* kind : {"light", "camera", "freejoint"})
    for (XMLElement* element : All(kind)) {
      if (Is(element, "freejoint")) notes_.push_back("the free joint of its base is left out: the robot stands still");
      element->Parent()->DeleteChild(element);
    }
  for (XMLElement* site : All("site")) site->SetAttribute("group", 4);  // marks are not to be seen in pictures
}

void RobotXml::NameEverything() {
  for (const char* kind : {"body", "geom"}) {
    int number = 0;
    for (XMLElement* element : All(kind)) {
      if (!element->Attribute("name"))
        element->SetAttribute("name", fmt::format("{}{}_{}", kPrefix, kind, number).c_str());
      ++number;
    }
  }
}

Status RobotXml::TakeFiles(const Path& folder) {
  XMLElement* assets = Section("asset");
  if (!assets) return {};
  const XMLElement* compiler = Section("compiler");
  std::map<Path, std::string> taken;
  for (XMLElement* asset = assets->FirstChildElement(); asset; asset = asset->NextSiblingElement()) {
    const std::string file = Attribute(asset, "file");
    if (file.empty()) continue;
    const char* where = Is(asset, "texture") ? "texturedir" : "meshdir";
    const Path path = folder / (compiler ? Attribute(compiler, where) : "") / file;
    auto [entry, is_new] = taken.try_emplace(path.lexically_normal());
    if (is_new) {
      entry->second = fmt::format("{}{}{}", kPrefix, files_.size(), path.extension().string());
      ETUDE_ASSIGN_OR_RETURN(auto bytes, ReadBinaryFile(path));
      files_.push_back({entry->second, std::move(bytes), true});
    }
    asset->SetAttribute("file", entry->second.c_str());
  }
  return {};
}

std::string RobotXml::Children(const char* section) {
  std::string text;
  if (const XMLElement* element = Section(section))
    for (const XMLElement* child = element->FirstChildElement(); child; child = child->NextSiblingElement())
      text += Print(child);
  return text;
}

std::string RobotXml::Defaults() {
  const XMLElement* defaults = Section("default");
  return defaults && defaults->Attribute("class") ? Print(defaults)
                                                  : fmt::format("<default class=\"{}main\"/>\n", kPrefix);
}

std::string RobotXml::Assets() { return Children("asset"); }
std::string RobotXml::Body() { return Print(root_); }
std::string RobotXml::Tendon() { return Children("tendon"); }

std::string RobotXml::Equality() {
  std::set<std::string> names;
  for (const char* kind : {"body", "joint"})
    for (XMLElement* element : All(kind)) names.insert(Attribute(element, "name"));
  std::string text;
  const XMLElement* section = Section("equality");
  for (const XMLElement* item = section ? section->FirstChildElement() : nullptr; item;
       item = item->NextSiblingElement()) {
    bool ours = true;
    for (const char* end : {"joint1", "joint2", "body1", "body2"})
      if (item->Attribute(end)) ours = ours && names.contains(Attribute(item, end));
    if (ours) text += Print(item);
  }
  return text;
}

}  // namespace etude::sim
