// SPDX-License-Identifier: Apache-2.0
// One picture for a screen. OpenCV stays behind this header.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "services/core/result.h"

namespace etude {

/// RGB, top row first -> JPEG. @param quality  1..100
/// @error kInvalidArgument: sizes that do not fit; kInternal of the codec
Result<std::vector<std::uint8_t>> EncodeJpeg(std::span<const std::uint8_t> rgb, int width, int height,
                                             int quality = 85);

}  // namespace etude
