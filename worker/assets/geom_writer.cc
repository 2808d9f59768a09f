// SPDX-License-Identifier: Apache-2.0
#include "worker/assets/geom_writer.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace etude::assets {

std::string Numbers(const std::vector<double>& values) { return fmt::format("{}", fmt::join(values, " ")); }

std::string Numbers(const Eigen::Vector3d& v) { return fmt::format("{} {} {}", v.x(), v.y(), v.z()); }

std::string PoseAttributes(const Pose& pose) {
  std::string text;
  if (!pose.p.isZero(0)) text += fmt::format(" pos=\"{}\"", Numbers(pose.p));
  const auto& q = pose.q;
  if (!q.coeffs().isApprox(Eigen::Quaterniond::Identity().coeffs(), 0))
    text += fmt::format(" quat=\"{} {} {} {}\"", q.w(), q.x(), q.y(), q.z());
  return text;
}

Eigen::Quaterniond AlongAxis(const Eigen::Vector3d& direction) {
  return Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), direction);
}

std::string Geom(const std::string& klass, const std::string& type, const std::vector<double>& size, const Pose& pose,
                 const std::string& extra) {
  const std::string size_text = size.empty() ? "" : fmt::format(" size=\"{}\"", Numbers(size));
  return fmt::format("<geom class=\"{}\" type=\"{}\"{}{}{}{}/>\n", klass, type, size_text, PoseAttributes(pose),
                     extra.empty() ? "" : " ", extra);
}

std::string GeomBetween(const std::string& klass, const std::string& type, double radius, const Eigen::Vector3d& a,
                        const Eigen::Vector3d& b, const std::string& extra) {
  return Geom(klass, type, {radius, (b - a).norm() / 2}, {(a + b) / 2, AlongAxis(b - a)}, extra);
}

std::string CylinderInertial(double mass, double radius, double length, const Eigen::Vector3d& centre,
                             const Eigen::Vector3d& axis) {
  const double across = mass * (3 * radius * radius + length * length) / 12;
  return fmt::format("<inertial mass=\"{}\" diaginertia=\"{} {} {}\"{}/>\n", mass, across, across,
                     mass * radius * radius / 2,
                     " pos=\"" + Numbers(centre) + "\"" + PoseAttributes({Eigen::Vector3d::Zero(), AlongAxis(axis)}));
}

std::string BoxInertial(double mass, const Eigen::Vector3d& half, const Eigen::Vector3d& centre) {
  const Eigen::Vector3d s = half.cwiseProduct(half) * (mass / 3);
  return fmt::format("<inertial mass=\"{}\" diaginertia=\"{} {} {}\" pos=\"{}\"/>\n", mass, s.y() + s.z(),
                     s.x() + s.z(), s.x() + s.y(), Numbers(centre));
}

}  // namespace etude::assets
