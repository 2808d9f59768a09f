// SPDX-License-Identifier: Apache-2.0
// Private to object_files: a picture's bytes as OpenCV's matrix.
#pragma once

#include <cstdint>
#include <opencv2/imgcodecs.hpp>
#include <vector>

namespace etude::synthesis {

/// @param flags  cv::IMREAD_*
/// @returns an empty matrix for what is no picture, and for one that OpenCV refuses by an exception: too large a one.
inline cv::Mat Decoded(const std::vector<std::uint8_t>& bytes, int flags) {
  if (bytes.empty()) return {};
  try {
    return cv::imdecode(bytes, flags);
  } catch (const cv::Exception&) {
    return {};
  }
}

}  // namespace etude::synthesis
