// SPDX-License-Identifier: Apache-2.0
#include "worker/view/frame.h"

#include <fmt/format.h>

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

namespace etude {

Result<std::vector<std::uint8_t>> EncodeJpeg(std::span<const std::uint8_t> rgb, int width, int height, int quality) {
  if (width <= 0 || height <= 0 || rgb.size() != static_cast<std::size_t>(width) * height * 3)
    return Fail(Code::kInvalidArgument,
                fmt::format("encode a picture: {} bytes are not {} x {} pixels", rgb.size(), width, height));
  try {
    const cv::Mat seen(height, width, CV_8UC3, const_cast<std::uint8_t*>(rgb.data()));
    cv::Mat picture;
    cv::cvtColor(seen, picture, cv::COLOR_RGB2BGR);
    std::vector<std::uint8_t> bytes;
    if (cv::imencode(".jpg", picture, bytes, {cv::IMWRITE_JPEG_QUALITY, quality})) return bytes;
    return Fail(Code::kInternal, "encode a picture: the JPEG codec failed");
  } catch (const cv::Exception& error) {
    return Fail(Code::kInternal, fmt::format("encode a picture: {}", error.what()));
  }
}

}  // namespace etude
