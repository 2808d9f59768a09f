// SPDX-License-Identifier: Apache-2.0
// Pictures on disk. OpenCV stays behind this header.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "services/core/file.h"
#include "worker/synthesis/picture.h"
#include "worker/synthesis/texture.h"

namespace etude::synthesis {

/// Reads a colour picture and its depth: 16 bits, larger is nearer, 0 is off the object.
/// Depth is stretched to 0..1 over the object.
/// @param relief  height of the nearest point over the outline, in widths of the picture
/// @error kNotFound, kCorrupt: not a picture; kInvalidArgument: other sizes, not 16 bits, or no object.
Result<Picture> ReadPicture(const Path& rgb, const Path& depth, double relief);

/// @error kInternal.
Result<std::vector<std::uint8_t>> EncodePng(const Texture& texture);

/// The depth as PNG of 16 bits, as ReadPicture takes it.
Result<std::vector<std::uint8_t>> EncodeDepth(const Picture& picture);

/// Any picture file's bytes. @error kCorrupt: not a picture; `origin` names it.
Result<Texture> DecodePicture(const std::vector<std::uint8_t>& bytes, const std::string& origin);
/// A row with a column for each colour (red, green, blue in 0..1); grey when there is none.
Texture PaletteTexture(const std::vector<Eigen::Vector3d>& colors);

/// One tile of a contact sheet.
struct Tile {
  Texture picture;
  std::string caption;
};
/// Writes pictures side by side, their captions below; as JPEG to a name that ends in .jpg, else as PNG. @error
/// kInvalidArgument: no tiles, or of several sizes.
Status WriteContactSheet(const std::vector<Tile>& tiles, int columns, const Path& path);

}  // namespace etude::synthesis
