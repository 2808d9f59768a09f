// SPDX-License-Identifier: Apache-2.0
// Pictures of a campaign's scenes for people. OpenCV stays behind this header.
#pragma once

#include <cstdint>
#include <vector>

#include "services/core/file.h"
#include "services/core/result.h"
#include "services/spec/campaign_spec.h"
#include "worker/sim/renderer.h"

namespace etude {

struct ScenePictureOptions {
  std::vector<std::uint64_t> indices{0};  ///< episodes, side by side
  std::uint32_t attempt = 0;
  bool segmentation = false;  ///< beside FILE.png also FILE-segmentation.png: a colour a body
  bool depth = false;         ///< and FILE-depth.png: 16 bits, mm along the viewing direction
};

/// Writes the first picture of each episode, as the camera of `spec` sees it, and prints what is asked for and the
/// files. A name that ends in .jpg gets JPEG, any other, and depth always, PNG.
/// @error kInvalidArgument: bad spec, or no episodes; kNotFound: that attempt has no scene; kUnavailable: no GL, or not
/// written.
Status WriteScenePictures(const CampaignSpec& spec, const Path& picture, const ScenePictureOptions& options,
                          const sim::RendererConfig& renderer);

}  // namespace etude
