// SPDX-License-Identifier: Apache-2.0
// The one way in which a part of a picture is taken: trainer, policy server and clients see the same pixels.
#pragma once

#include <cstdint>
#include <span>

#include "services/core/result.h"

namespace etude::codec {

/// Rectangle of a picture, px; (u, v) is its top-left pixel.
struct Region {
  int u = 0, v = 0, width = 0, height = 0;

  std::size_t bytes() const { return static_cast<std::size_t>(width) * static_cast<std::size_t>(height) * 3; }
  bool operator==(const Region&) const = default;
};

/// Whether `region` is not empty and lies inside a picture of this size. No number overflows it.
bool Fits(const Region& region, int picture_width, int picture_height);

/// Copies `region` of an RGB picture (row-major, 3 bytes a pixel) to `out` (region.bytes()). Thread-safe.
/// @error kInvalidArgument with the numbers when the region does not fit the picture, or a buffer not its size.
Status CropPicture(std::span<const std::uint8_t> picture, int picture_width, int picture_height, const Region& region,
                   std::span<std::uint8_t> out);

}  // namespace etude::codec
