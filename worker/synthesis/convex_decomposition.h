// SPDX-License-Identifier: Apache-2.0
// Collision shapes: a body as a few convex pieces.
#pragma once

#include <optional>
#include <vector>

#include "worker/assets/mesh.h"
#include "worker/synthesis/heightfield.h"

namespace etude::synthesis {

struct PieceOptions {
  int slices = 5;      ///< at most, along the longest axis, for a body without a hole, >= 1
  double fill = 0.05;  ///< so much more than the body may the pieces hold; then no more slices are made
  int sectors = 8;     ///< around the hole, for a body with one, >= 3
  int points = 64;     ///< at most, of a piece
};

/// Cuts a closed body by planes and takes the convex hull of each part: as few slices along its longest axis as do, or
/// sectors around its hole, which so stays open. Convex as long as each part is; else a piece fills its hollows.
/// @param hole  in the frame of the mesh
std::vector<assets::Mesh> ConvexPieces(const assets::Mesh& mesh, const std::optional<Hole>& hole,
                                       const PieceOptions& options = {});

}  // namespace etude::synthesis
