// SPDX-License-Identifier: Apache-2.0
#include "services/codec/crop.h"

#include <fmt/format.h>

#include <cstring>

namespace etude::codec {

bool Fits(const Region& region, int picture_width, int picture_height) {
  // subtractions of numbers that are not negative: nothing overflows
  return region.u >= 0 && region.v >= 0 && region.width > 0 && region.height > 0 && region.width <= picture_width &&
         region.height <= picture_height && region.u <= picture_width - region.width &&
         region.v <= picture_height - region.height;
}

Status CropPicture(std::span<const std::uint8_t> picture, int picture_width, int picture_height, const Region& region,
                   std::span<std::uint8_t> out) {
  if (!Fits(region, picture_width, picture_height))
    return Fail(Code::kInvalidArgument,
                fmt::format("crop {}x{} px at ({}, {}) does not fit a picture of {}x{} px", region.width, region.height,
                            region.u, region.v, picture_width, picture_height));
  const std::size_t whole_row = static_cast<std::size_t>(picture_width) * 3;
  if (picture.size() != whole_row * static_cast<std::size_t>(picture_height) || out.size() != region.bytes())
    return Fail(Code::kInvalidArgument,
                fmt::format("crop {}x{} px of a {}x{} picture: buffers of {} and {} bytes", region.width, region.height,
                            picture_width, picture_height, picture.size(), out.size()));
  const std::size_t row = static_cast<std::size_t>(region.width) * 3;
  const std::uint8_t* from =
      picture.data() + static_cast<std::size_t>(region.v) * whole_row + static_cast<std::size_t>(region.u) * 3;
  for (int y = 0; y < region.height; ++y)
    std::memcpy(out.data() + row * static_cast<std::size_t>(y), from + whole_row * static_cast<std::size_t>(y), row);
  return {};
}

}  // namespace etude::codec
