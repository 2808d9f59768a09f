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

/// `<geom class="KLASS" type="TYPE" size="..." pos quat EXTRA/>`
std::string Geom(const std::string& klass, const std::string& type, const std::vector<double>& size, const Pose& pose,
                 const std::string& extra = {});

}  // namespace etude::assets
