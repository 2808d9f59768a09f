// SPDX-License-Identifier: Apache-2.0
// The part of MjcfDocument that makes one convention of MJCF's many: angles and orientations.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cctype>
#include <numbers>

#include "worker/sim/mjcf_document.h"

namespace etude::sim {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using tinyxml2::XMLElement;

Vector3d Axis(char letter) { return Vector3d::Unit(std::tolower(letter) - 'x'); }

/// MuJoCo's rule: small letters turn about the moving axes, capital ones about the fixed.
Quaterniond FromEulerOrder(const std::vector<double>& angles, const std::string& order) {
  Quaterniond q = Quaterniond::Identity();
  for (std::size_t i = 0; i < 3; ++i) {
    const Quaterniond turn(Eigen::AngleAxisd(angles[i], Axis(order[i])));
    q = std::islower(order[i]) ? q * turn : turn * q;
  }
  return q;
}

Quaterniond FromTwoAxes(const std::vector<double>& v) {
  const Vector3d x = Vector3d(v[0], v[1], v[2]).normalized(), along(v[3], v[4], v[5]);
  const Vector3d y = (along - x * x.dot(along)).normalized();
  Eigen::Matrix3d R;
  R << x, y, x.cross(y);
  return Quaterniond(R);
}

/// The orientation that `values` stand for as attribute `form` of an element.
Quaterniond Orientation(const std::string& form, std::vector<double> values, double unit, const std::string& order) {
  if (form == "euler") {
    for (double& angle : values) angle *= unit;
    return FromEulerOrder(values, order);
  }
  if (form == "axisangle")
    return Quaterniond(Eigen::AngleAxisd(values[3] * unit, Vector3d(values[0], values[1], values[2]).normalized()));
  if (form == "xyaxes") return FromTwoAxes(values);
  return Quaterniond::FromTwoVectors(Vector3d::UnitZ(), Vector3d(values[0], values[1], values[2]));
}

}  // namespace

Status MjcfDocument::Normalise(XMLElement* element) {
  const double unit = degrees_ ? std::numbers::pi / 180 : 1;
  for (const auto& [form, count] : {std::pair{"euler", 3u}, {"axisangle", 4u}, {"xyaxes", 6u}, {"zaxis", 3u}}) {
    if (!element->Attribute(form)) continue;
    const std::string text = Attribute(*element, form);
    const std::vector<double> values = NumbersOf(text);
    if (values.size() != count)
      return Fail(Code::kInvalidArgument, fmt::format("{}: <{} {}=\"{}\"> has {} numbers, not {}", file_.string(),
                                                      element->Name(), form, text, values.size(), count));
    const Quaterniond q = Orientation(form, values, unit, euler_order_);
    element->DeleteAttribute(form);
    element->SetAttribute("quat", fmt::format("{} {} {} {}", q.w(), q.x(), q.y(), q.z()).c_str());
  }
  // a class does not say whether its range is an angle: each joint gets its own
  const bool in_class = element->Parent()->ToElement() && IsElement(*element->Parent()->ToElement(), "default");
  if (degrees_ && !in_class && IsElement(*element, "joint") && Resolved(*element, "type") != "slide")
    for (const char* name : {"range", "ref", "springref"}) {
      std::vector<double> values = NumbersOf(Resolved(*element, name));
      if (values.empty()) continue;
      for (double& value : values) value *= unit;
      element->SetAttribute(name, fmt::format("{}", fmt::join(values, " ")).c_str());
    }
  for (XMLElement* child = element->FirstChildElement(); child; child = child->NextSiblingElement())
    ETUDE_RETURN_IF_ERROR(Normalise(child));
  return {};
}

}  // namespace etude::sim
