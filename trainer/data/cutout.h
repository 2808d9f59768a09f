// SPDX-License-Identifier: Apache-2.0
// Hidden parts of a training picture (cutout: DeVries and Taylor 2017, with many small squares instead of one large),
// so that a policy finds a thing by what is left of it.
#pragma once

#include <cstdint>
#include <span>

#include "services/core/rng.h"

namespace etude::data {

inline constexpr int kCutoutBlock = 8;  ///< px, along both sides

/// Covers squares of a grid, which is displaced by chance, with one grey by chance, in a picture (height, width, 3):
/// each with a probability that is drawn from 0 to `most`. The draws do not depend on the picture. Thread-safe.
/// @pre rgb.size() == 3 * width * height, 0 <= most <= 1
void CutOut(double most, int width, int height, Rng& rng, std::span<std::uint8_t> rgb);

}  // namespace etude::data
