// SPDX-License-Identifier: Apache-2.0
#include "worker/sim/robot_masses.h"

#include <fmt/format.h>

#include <utility>

#include "worker/sim/robot_builder.h"

namespace etude::sim {
namespace {

using Eigen::Vector3d;
using tinyxml2::XMLElement;

/// A mass for what shall weigh nothing: MuJoCo refuses a body that moves and has none.
constexpr const char* kNoMass = "1e-6";  // kg
constexpr double kSomeMass = 1e-3;       // kg

/// Leaves its visual geoms (almost) no mass.
/// @return  them, each with the text of its mass as it was
std::vector<std::pair<XMLElement*, std::string>> TakeVisualMasses(RobotXml& xml, const mjModel* whole) {
  std::vector<std::pair<XMLElement*, std::string>> visuals;
  for (XMLElement* geom : xml.All("geom")) {
    const int id = mj_name2id(whole, mjOBJ_GEOM, geom->Attribute("name"));
    if (id < 0 || Collides(whole, id)) continue;  // what a <composite> makes geoms of is none itself
    // MuJoCo looks at the faces of what weighs something, and at no others
    if (const auto own = NumbersOf(xml.Resolved(*geom, "mass")); !own.empty() && own[0] == 0) continue;
    visuals.emplace_back(geom, Attribute(*geom, "mass"));
    geom->SetAttribute("mass", kNoMass);
  }
  return visuals;
}

}  // namespace

Status FixMasses(RobotXml& xml) {
  if (xml.mass_settings().empty()) return {};
  ETUDE_ASSIGN_OR_RETURN(const ModelPtr mj, CompileAlone(xml, xml.mass_settings()));
  for (XMLElement* body : xml.All("body")) {
    const int id = mj_name2id(mj.get(), mjOBJ_BODY, body->Attribute("name"));
    while (XMLElement* old = body->FirstChildElement("inertial")) body->DeleteChild(old);
    if (mj->body_mass[id] <= 0) {
      for (XMLElement* geom = body->FirstChildElement("geom"); geom; geom = geom->NextSiblingElement("geom"))
        geom->SetAttribute("mass", "0");
      continue;
    }
    XMLElement* inertial = body->InsertNewChildElement("inertial");
    const mjtNum *p = mj->body_ipos + 3 * id, *q = mj->body_iquat + 4 * id, *inertia = mj->body_inertia + 3 * id;
    SetPose(*inertial, {Vector3d(p[0], p[1], p[2]), Eigen::Quaterniond(q[0], q[1], q[2], q[3])});
    inertial->SetAttribute("mass", fmt::format("{}", mj->body_mass[id]).c_str());
    inertial->SetAttribute("diaginertia", fmt::format("{} {} {}", inertia[0], inertia[1], inertia[2]).c_str());
  }
  return {};
}

Status LightenVisuals(RobotXml& xml) {
  ETUDE_ASSIGN_OR_RETURN(const ModelPtr whole, CompileAlone(xml, xml.mass_settings()));
  const auto visuals = TakeVisualMasses(xml, whole.get());
  ETUDE_ASSIGN_OR_RETURN(const ModelPtr bare, CompileAlone(xml, xml.mass_settings()));
  for (const auto& [geom, mass] : visuals) {
    const char* body = geom->Parent()->ToElement()->Attribute("name");
    if (bare->body_mass[mj_name2id(bare.get(), mjOBJ_BODY, body)] > kSomeMass) continue;
    // nothing else gives this body a mass
    geom->DeleteAttribute("mass");
    if (!mass.empty()) geom->SetAttribute("mass", mass.c_str());
  }
  return {};
}

Result<std::vector<VisualMass>> VisualMassesOf(RobotXml xml) {
  ETUDE_ASSIGN_OR_RETURN(const ModelPtr whole, CompileAlone(xml, xml.mass_settings()));
  TakeVisualMasses(xml, whole.get());
  ETUDE_ASSIGN_OR_RETURN(const ModelPtr bare, CompileAlone(xml, xml.mass_settings()));
  std::vector<VisualMass> visuals;
  // where the total is a setting, nothing weighs twice
  if (mj_getTotalmass(whole.get()) - mj_getTotalmass(bare.get()) < kSomeMass) return visuals;
  for (const XMLElement* body : xml.All("body")) {
    const int id = mj_name2id(whole.get(), mjOBJ_BODY, body->Attribute("name"));
    const double rest = bare->body_mass[id], mass = whole->body_mass[id] - rest;
    if (mass > kSomeMass && rest > kSomeMass) visuals.push_back({body->Attribute("name"), mass});
  }
  return visuals;
}

}  // namespace etude::sim
