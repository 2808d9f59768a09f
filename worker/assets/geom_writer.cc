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

std::string Geom(const std::string& klass, const std::string& type, const std::vector<double>& size, const Pose& pose,
                 const std::string& extra) {
  const std::string size_text = size.empty() ? "" : fmt::format(" size=\"{}\"", Numbers(size));
  return fmt::format("<geom class=\"{}\" type=\"{}\"{}{}{}{}/>\n", klass, type, size_text, PoseAttributes(pose),
                     extra.empty() ? "" : " ", extra);
}

}  // namespace etude::assets
