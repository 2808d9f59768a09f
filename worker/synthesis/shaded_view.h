// SPDX-License-Identifier: Apache-2.0
// A picture of one body for people: textured, lit as in a scene, without any graphics library.
#pragma once

#include "worker/assets/mesh.h"
#include "worker/synthesis/texture.h"

namespace etude::synthesis {

struct ViewOptions {
  int size = 160;           ///< px, of the square picture
  double extent = 0.11;     ///< m, its height and width
  double elevation = 0.55;  ///< rad that the camera looks down
  double yaw = 0.25;        ///< rad that the body is turned about the vertical
};

/// The body as a camera sees it that stands in +y, as those of the scenes do; on white, its middle in the picture's.
/// @param mesh  m, with texture coordinates
Texture ShadedView(const assets::Mesh& mesh, const Texture& texture, const ViewOptions& options = {});

}  // namespace etude::synthesis
