// SPDX-License-Identifier: Apache-2.0
#include "services/video/picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "services/core/check.h"

namespace etude::video {
namespace {

cv::Mat Borrowed(const Picture& picture) {
  return {picture.height, picture.width, CV_8UC3, const_cast<std::uint8_t*>(picture.rgb.data())};
}

Picture Scaled(const Picture& picture, int width, int height, int interpolation) {
  Picture scaled{width, height, std::vector<std::uint8_t>(static_cast<std::size_t>(width) * height * 3)};
  cv::Mat target(height, width, CV_8UC3, scaled.rgb.data());
  cv::resize(Borrowed(picture), target, target.size(), 0, 0, interpolation);
  return scaled;
}

Result<std::vector<std::uint8_t>> Encode(const Picture& picture, const char* format, const std::vector<int>& settings) {
  if (picture.width <= 0 || picture.height <= 0 ||
      picture.rgb.size() != static_cast<std::size_t>(picture.width) * picture.height * 3) {
    return Fail(Code::kInvalidArgument, fmt::format("encode a picture as {}: {} bytes are not {}x{} px", format,
                                                    picture.rgb.size(), picture.width, picture.height));
  }
  try {
    cv::Mat bgr;
    cv::cvtColor(Borrowed(picture), bgr, cv::COLOR_RGB2BGR);
    std::vector<std::uint8_t> bytes;
    if (cv::imencode(format, bgr, bytes, settings)) return bytes;
    return Fail(Code::kInternal, fmt::format("encode a picture as {}: OpenCV refused", format));
  } catch (const cv::Exception& error) {
    return Fail(Code::kInternal, fmt::format("encode a picture as {}: {}", format, error.what()));
  }
}

}  // namespace

Result<std::vector<std::uint8_t>> EncodePng(const Picture& picture) {
  return Encode(picture, ".png", {cv::IMWRITE_PNG_COMPRESSION, 3});
}

Result<std::vector<std::uint8_t>> EncodeWebp(const Picture& picture, int quality) {
  return Encode(picture, ".webp", {cv::IMWRITE_WEBP_QUALITY, std::clamp(quality, 1, 100)});
}

Picture Resized(const Picture& picture, int width) {
  ETUDE_CHECK(picture.width > 0 && picture.height > 0 && width > 0);
  const int height = std::max(1, static_cast<int>(static_cast<std::int64_t>(picture.height) * width / picture.width));
  return Scaled(picture, width, height, width < picture.width ? cv::INTER_AREA : cv::INTER_NEAREST);
}

Picture Enlarged(const Picture& picture, int factor) {
  ETUDE_CHECK(picture.width > 0 && picture.height > 0 && factor > 0);
  return Scaled(picture, picture.width * factor, picture.height * factor, cv::INTER_NEAREST);
}

Picture Joined(std::span<const Picture> pictures) {
  ETUDE_CHECK(!pictures.empty());
  Picture joined{0, pictures[0].height, {}};
  for (const auto& picture : pictures) {
    ETUDE_CHECK(picture.height == joined.height, "{} px beside {} px", picture.height, joined.height);
    joined.width += picture.width;
  }
  joined.rgb.reserve(static_cast<std::size_t>(joined.width) * joined.height * 3);
  for (int row = 0; row < joined.height; ++row)
    for (const auto& picture : pictures) {
      const auto stride = static_cast<std::ptrdiff_t>(picture.width) * 3;
      joined.rgb.insert(joined.rgb.end(), picture.rgb.begin() + row * stride, picture.rgb.begin() + (row + 1) * stride);
    }
  return joined;
}

}  // namespace etude::video
