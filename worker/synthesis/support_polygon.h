// SPDX-License-Identifier: Apache-2.0
// What a body stands on: a mirrored relief ends in an edge or a point, so a little of it is pressed flat.
#pragma once

#include <Eigen/Core>

#include "worker/assets/mesh.h"

namespace etude::synthesis {

struct SupportOptions {
  double least_half = 0.014;  ///< m along y that the foot should reach, half as much along x
  double deepest = 0.10;      ///< of the body's height: at most so much is pressed flat
};

/// The rectangle that a body stands on, inside of the flat part of its underside.
struct SupportPolygon {
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();  ///< m
  Eigen::Vector2d half = Eigen::Vector2d::Zero();    ///< m, along x and y
};

/// Presses all below a horizontal plane (all but) flat and returns the foot that this makes. The plane is the lowest
/// whose foot is large enough; nothing is pressed where what is flat already is nine tenths of that foot, though it be
/// less than least_half. The mesh stays closed: its faces keep their neighbours, and a hundredth of their height.
/// @param mesh  m, z up
SupportPolygon FlattenSupport(assets::Mesh& mesh, const SupportOptions& options = {});

}  // namespace etude::synthesis
