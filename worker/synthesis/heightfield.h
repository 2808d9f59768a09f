// SPDX-License-Identifier: Apache-2.0
// From a picture with depth to a closed body: a grid displaced by the depth, cut at a small height, mirrored behind
// the cut, smoothed.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "services/core/result.h"
#include "worker/assets/mesh.h"
#include "worker/synthesis/picture.h"

namespace etude::synthesis {

struct HeightfieldOptions {
  int max_faces = 2400;    ///< >= 100; sets how fine the grid is
  double cut = 0.03;       ///< depth below which there is no object, 0..0.5
  double smoothing = 0.5;  ///< how far a vertex moves towards the mean of its neighbours in a round, 0..1
  int rounds = 3;          ///< of Laplacian smoothing, >= 0; the volume is restored afterwards
};

/// Where one can look through a body.
struct Hole {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  Eigen::Vector3d axis = Eigen::Vector3d::UnitZ();  ///< unit
};

struct HeightfieldBody {
  assets::Mesh mesh;
  std::optional<Hole> hole;  ///< the largest one, when it is large
};

/// The body in a picture: x right, y up in the picture, z towards the viewer, origin in the picture's middle, in widths
/// of the picture. The mesh is watertight (every edge has exactly two faces), wound outwards and in one piece: the
/// picture's largest connected part. Texture coordinates are those of the picture, the same in front and behind.
/// @error kInvalidArgument: lists of the wrong length, options out of range, or no object in the picture.
/// Thread safety: concurrent calls.
Result<HeightfieldBody> RaiseHeightfield(const Picture& picture, const HeightfieldOptions& options = {});

/// Laplacian smoothing with uniform weights, then scaled about the centre to the volume it had. Normals are made anew.
/// @param mesh  closed, its vertices shared by the faces around them
void Smooth(assets::Mesh& mesh, double factor, int rounds);

}  // namespace etude::synthesis
