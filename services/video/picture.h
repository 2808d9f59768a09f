// SPDX-License-Identifier: Apache-2.0
// Single pictures as PNG and WebP. OpenCV stays behind this header.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "services/core/result.h"

namespace etude::video {

/// RGB, row-major, top row first.
struct Picture {
  int width = 0, height = 0;  ///< px
  std::vector<std::uint8_t> rgb;
};

/// Lossless. @error kInvalidArgument: sizes that do not fit; kInternal of the codec.
Result<std::vector<std::uint8_t>> EncodePng(const Picture& picture);
/// @param quality  1..100. @error as EncodePng
Result<std::vector<std::uint8_t>> EncodeWebp(const Picture& picture, int quality = 80);

/// The same picture `width` px wide, its sides in proportion (at least 1 px); area-averaged when it becomes smaller,
/// nearest neighbours when larger, so that its colours stay its own. @pre it has pixels, width > 0
Picture Resized(const Picture& picture, int width);
/// Every pixel `factor` times in both directions. @pre factor > 0
Picture Enlarged(const Picture& picture, int factor);
/// Side by side; all of one height. @pre not empty
Picture Joined(std::span<const Picture> pictures);

}  // namespace etude::video
