// SPDX-License-Identifier: Apache-2.0
// Other tables than the wooden one.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "worker/assets/object_parts.h"

namespace etude::assets {

Canvas ClothTexture() {
  const int n = 512, threads = 96;
  Canvas canvas(n, n, {0.30, 0.38, 0.46});
  for (int y = 0; y < n; ++y)
    for (int x = 0; x < n; ++x) {
      const double u = (x + .5) / n, v = (y + .5) / n;
      const double warp = std::sin(std::numbers::pi * u * threads), weft = std::sin(std::numbers::pi * v * threads);
      const double weave = .90 + .10 * warp * weft;
      const double worn = .92 + .16 * (Noise(u * 5, v * 5, 31) - .5) + .10 * (Noise(u * 60, v * 60, 32) - .5);
      const bool stripe = std::fmod(u * 8, 1.0) < .08 || std::fmod(v * 8, 1.0) < .08;
      canvas.at(x, y) = (stripe ? Color(0.62, 0.66, 0.68) : Color(0.30, 0.38, 0.46)) * (weave * worn);
    }
  return canvas;
}

Canvas StoneTexture() {
  const int n = 512;
  Canvas canvas(n, n, {0.66, 0.66, 0.65});
  for (int y = 0; y < n; ++y)
    for (int x = 0; x < n; ++x) {
      const double u = (x + .5) / n, v = (y + .5) / n;
      const double cloud =
          .5 * Noise(u * 6, v * 6, 41) + .3 * Noise(u * 24, v * 24, 42) + .2 * Noise(u * 80, v * 80, 43);
      const double speck = Noise(u * 150, v * 150, 44);
      const double tone = .52 + .34 * cloud - (speck > .80 ? .22 : 0.0) + (speck < .14 ? .14 : 0.0);
      canvas.at(x, y) = Color(1.0, 0.985, 0.96) * std::clamp(tone, 0.0, 1.0);
    }
  return canvas;
}

}  // namespace etude::assets
