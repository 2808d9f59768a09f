// SPDX-License-Identifier: Apache-2.0
// What a body is painted with.
#pragma once

#include <cstdint>
#include <vector>

#include "worker/synthesis/picture.h"

namespace etude::synthesis {

/// Red, green, blue, row by row, first row on top.
struct Texture {
  int width = 0;
  int height = 0;
  std::vector<std::uint8_t> rgb;
};

/// The colours of a picture, those of the object continued for `margin` px past its outline, so that no background
/// shows at the edge of a body. Pixels at the outline are mixed with the background: they are replaced, too.
Texture TextureOf(const Picture& picture, int margin = 6);

/// MuJoCo's custom texture format: int32 width, int32 height, RGB bytes.
std::vector<std::uint8_t> ToTexFile(const Texture& texture);

}  // namespace etude::synthesis
