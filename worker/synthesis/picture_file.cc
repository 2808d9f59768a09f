// SPDX-License-Identifier: Apache-2.0
#include "worker/synthesis/picture_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "worker/synthesis/decoded_picture.h"

namespace etude::synthesis {
namespace {

constexpr int kCaption = 18;             // px
constexpr double kLetters = 0.38 / 160;  // size of OpenCV's font for each px of a tile
constexpr int kJpegQuality = 85;

Result<cv::Mat> Read(const Path& path, int flags) {
  ETUDE_ASSIGN_OR_RETURN(const auto bytes, ReadBinaryFile(path, 1u << 28));
  cv::Mat picture = Decoded(bytes, flags);
  if (picture.empty()) return Fail(Code::kCorrupt, fmt::format("read '{}': not a picture", path.string()));
  return picture;
}

Result<std::vector<std::uint8_t>> Encode(const cv::Mat& picture, const char* kind = ".png") {
  std::vector<std::uint8_t> bytes;
  if (!cv::imencode(kind, picture, bytes, {cv::IMWRITE_JPEG_QUALITY, kJpegQuality}))
    return Fail(Code::kInternal, fmt::format("encoding a {} picture failed", kind));
  return bytes;
}

cv::Mat ToMat(const Texture& texture) {
  cv::Mat picture(texture.height, texture.width, CV_8UC3);
  std::copy(texture.rgb.begin(), texture.rgb.end(), picture.data);
  cv::cvtColor(picture, picture, cv::COLOR_RGB2BGR);
  return picture;
}

}  // namespace

Result<Picture> ReadPicture(const Path& rgb, const Path& depth, double relief) {
  ETUDE_ASSIGN_OR_RETURN(cv::Mat colors, Read(rgb, cv::IMREAD_COLOR));
  ETUDE_ASSIGN_OR_RETURN(const cv::Mat heights, Read(depth, cv::IMREAD_UNCHANGED));
  if (heights.type() != CV_16UC1 || heights.size() != colors.size())
    return Fail(Code::kInvalidArgument,
                fmt::format("read '{}': depth must have 16 bits, one channel and the {} x {} px of '{}'",
                            depth.string(), colors.cols, colors.rows, rgb.string()));
  cv::cvtColor(colors, colors, cv::COLOR_BGR2RGB);
  double low = 0, high = 0;
  cv::minMaxLoc(heights, &low, &high, nullptr, nullptr, heights > 0);
  if (high == 0) return Fail(Code::kInvalidArgument, fmt::format("read '{}': depth is 0 all over", depth.string()));

  Picture picture{.width = colors.cols, .height = colors.rows, .relief = relief};
  picture.rgb.assign(colors.data, colors.data + 3 * colors.total());
  for (auto value = heights.begin<std::uint16_t>(); value != heights.end<std::uint16_t>(); ++value) {
    // the farthest point of the object is a little above the cut
    const double share = high > low ? (*value - low) / (high - low) : 1.0;
    picture.mask.push_back(*value > 0);
    picture.depth.push_back(*value > 0 ? static_cast<float>(0.05 + 0.95 * share) : 0.0f);
  }
  return picture;
}

Result<std::vector<std::uint8_t>> EncodePng(const Texture& texture) { return Encode(ToMat(texture)); }

Result<std::vector<std::uint8_t>> EncodeDepth(const Picture& picture) {
  cv::Mat heights(picture.height, picture.width, CV_16UC1);
  for (std::size_t i = 0; i < picture.pixels(); ++i)
    heights.at<std::uint16_t>(static_cast<int>(i)) =
        picture.mask[i] ? static_cast<std::uint16_t>(1 + std::lround(65534.0 * picture.depth[i])) : 0;
  return Encode(heights);
}

Result<Texture> DecodePicture(const std::vector<std::uint8_t>& bytes, const std::string& origin) {
  // as it is stored: the texture coordinates know nothing of how a camera was held
  cv::Mat picture = Decoded(bytes, cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION);
  if (picture.empty()) return Fail(Code::kCorrupt, fmt::format("the texture of '{}' is not a picture", origin));
  cv::cvtColor(picture, picture, cv::COLOR_BGR2RGB);
  return Texture{picture.cols, picture.rows, {picture.data, picture.data + 3 * picture.total()}};
}

Texture PaletteTexture(const std::vector<Eigen::Vector3d>& colors) {
  // wide columns: the ends of a smoothed lookup stay within one
  constexpr int kWidth = 8;
  const int count = std::max<int>(1, static_cast<int>(colors.size()));
  Texture texture{kWidth * count, kWidth, {}};
  for (int i = 0; i < texture.width * texture.height; ++i)
    for (int k = 0; k < 3; ++k) {
      const double value = colors.empty() ? 0.7 : std::clamp(colors[i % texture.width / kWidth][k], 0.0, 1.0);
      texture.rgb.push_back(static_cast<std::uint8_t>(std::lround(255 * value)));
    }
  return texture;
}

Status WriteContactSheet(const std::vector<Tile>& tiles, int columns, const Path& path) {
  if (tiles.empty() || columns < 1) return Fail(Code::kInvalidArgument, "a contact sheet without tiles");
  const int width = tiles[0].picture.width, height = tiles[0].picture.height, line = height + kCaption;
  const int rows = (static_cast<int>(tiles.size()) + columns - 1) / columns;
  cv::Mat sheet(rows * line, columns * width, CV_8UC3, cv::Scalar::all(255));
  for (int i = 0; i < static_cast<int>(tiles.size()); ++i) {
    const Texture& picture = tiles[i].picture;
    if (picture.width != width || picture.height != height)
      return Fail(Code::kInvalidArgument, fmt::format("contact sheet: a tile of {} x {} px beside one of {} x {}",
                                                      picture.width, picture.height, width, height));
    const int x = i % columns * width, y = i / columns * line;
    ToMat(picture).copyTo(sheet(cv::Rect(x, y, width, height)));
    cv::putText(sheet, tiles[i].caption, {x + 4, y + height + 12}, cv::FONT_HERSHEY_SIMPLEX, kLetters * width,
                cv::Scalar::all(0), 1, cv::LINE_AA);
  }
  ETUDE_ASSIGN_OR_RETURN(const auto bytes, Encode(sheet, path.extension() == ".jpg" ? ".jpg" : ".png"));
  return WriteFileAtomically(path, bytes);
}

}  // namespace etude::synthesis
