// SPDX-License-Identifier: Apache-2.0
// Small helpers that print MJCF. Numbers print with the fewest digits that read back the same.
#pragma once

#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "services/episode/pose.h"

namespace etude::assets {

/// "1 0.5 -2"
std::string Numbers(const std::vector<double>& values);
std::string Numbers(const Eigen::Vector3d& v);
/// ` pos="..." quat="w x y z"`, each left out when it is the identity.
std::string PoseAttributes(const Pose& pose);

/// The quaternion that turns z onto `direction` (for cylinders and capsules).
Eigen::Quaterniond AlongAxis(const Eigen::Vector3d& direction);

/// `<geom class="KLASS" type="TYPE" size="..." pos quat EXTRA/>`
std::string Geom(const std::string& klass, const std::string& type, const std::vector<double>& size, const Pose& pose,
                 const std::string& extra = {});
/// A capsule or cylinder from `a` to `b`.
std::string GeomBetween(const std::string& klass, const std::string& type, double radius, const Eigen::Vector3d& a,
                        const Eigen::Vector3d& b, const std::string& extra = {});
/// `<inertial .../>` of a solid cylinder of `mass` with its centre at `centre` and its axis along
/// `axis`.
std::string CylinderInertial(double mass, double radius, double length, const Eigen::Vector3d& centre,
                             const Eigen::Vector3d& axis);
std::string BoxInertial(double mass, const Eigen::Vector3d& half, const Eigen::Vector3d& centre);

}  // namespace etude::assets
