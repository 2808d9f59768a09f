// SPDX-License-Identifier: Apache-2.0
#include "worker/synthesis/texture.h"

#include <algorithm>
#include <cstring>

namespace etude::synthesis {
namespace {

/// The pixels whose neighbours are all on the object.
std::vector<std::uint8_t> Eroded(const Picture& picture) {
  const auto at = [&](int x, int y) {
    return x >= 0 && y >= 0 && x < picture.width && y < picture.height &&
           picture.mask[static_cast<std::size_t>(y) * picture.width + x];
  };
  std::vector<std::uint8_t> inside(picture.pixels(), 1);
  for (int y = 0; y < picture.height; ++y)
    for (int x = 0; x < picture.width; ++x)
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx)
          if (!at(x + dx, y + dy)) inside[static_cast<std::size_t>(y) * picture.width + x] = 0;
  return inside;
}

/// Gives each pixel beside those `inside` the mean colour of its neighbours there, and makes it one of them.
void Grow(Texture& texture, std::vector<std::uint8_t>& inside) {
  const std::vector<std::uint8_t> before = inside;
  for (int y = 0; y < texture.height; ++y)
    for (int x = 0; x < texture.width; ++x) {
      const std::size_t i = static_cast<std::size_t>(y) * texture.width + x;
      if (before[i]) continue;
      int sum[3] = {}, count = 0;
      for (int v = std::max(0, y - 1); v <= std::min(texture.height - 1, y + 1); ++v)
        for (int u = std::max(0, x - 1); u <= std::min(texture.width - 1, x + 1); ++u) {
          const std::size_t k = static_cast<std::size_t>(v) * texture.width + u;
          if (!before[k]) continue;
          ++count;
          for (int c = 0; c < 3; ++c) sum[c] += texture.rgb[3 * k + c];
        }
      if (count == 0) continue;
      inside[i] = 1;
      for (int c = 0; c < 3; ++c) texture.rgb[3 * i + c] = static_cast<std::uint8_t>((sum[c] + count / 2) / count);
    }
}

}  // namespace

Texture TextureOf(const Picture& picture, int margin) {
  Texture texture{picture.width, picture.height, picture.rgb};
  std::vector<std::uint8_t> inside = Eroded(picture);
  for (int round = 0; round <= margin; ++round) Grow(texture, inside);
  return texture;
}

std::vector<std::uint8_t> ToTexFile(const Texture& texture) {
  const std::int32_t size[2] = {texture.width, texture.height};
  std::vector<std::uint8_t> bytes(sizeof size + texture.rgb.size());
  std::memcpy(bytes.data(), size, sizeof size);
  std::copy(texture.rgb.begin(), texture.rgb.end(), bytes.begin() + sizeof size);
  return bytes;
}

}  // namespace etude::synthesis
