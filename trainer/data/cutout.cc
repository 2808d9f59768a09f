// SPDX-License-Identifier: Apache-2.0
#include "trainer/data/cutout.h"

#include <algorithm>
#include <cstddef>

#include "services/core/check.h"

namespace etude::data {

void CutOut(double most, int width, int height, Rng& rng, std::span<std::uint8_t> rgb) {
  ETUDE_CHECK(rgb.size() == 3 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height), "{} bytes",
              rgb.size());
  const double share = rng.Uniform(0, most);
  const auto grey = static_cast<std::uint8_t>(rng.Below(256));
  const int first_left = -static_cast<int>(rng.Below(kCutoutBlock)),
            first_top = -static_cast<int>(rng.Below(kCutoutBlock));
  for (int top = first_top; top < height; top += kCutoutBlock)
    for (int left = first_left; left < width; left += kCutoutBlock) {
      if (!rng.Bernoulli(share)) continue;
      const int from = std::max(left, 0), to = std::min(left + kCutoutBlock, width);
      for (int y = std::max(top, 0); y < std::min(top + kCutoutBlock, height); ++y)
        std::fill_n(rgb.begin() + 3 * (static_cast<std::ptrdiff_t>(y) * width + from), 3 * (to - from), grey);
    }
}

}  // namespace etude::data
