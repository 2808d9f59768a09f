// SPDX-License-Identifier: Apache-2.0
#include "services/export/picture_stream.h"

#include <fmt/format.h>

#include <vector>

#include "services/codec/frame.h"

namespace etude::exports::internal {

Result<FeatureStatistics> WritePictures(const CameraTrack& track, video::Mp4Writer& video) {
  std::vector<std::uint8_t> rgb(3ull * track.camera.width * track.camera.height);
  PictureStatistics statistics;
  for (std::size_t k = 0; k < track.frames.size(); ++k) {
    if (Status inflated = codec::InflateFrame(track.frames[k], rgb); !inflated)
      return Fail(inflated.error().Wrap(fmt::format("camera {} frame {}", track.camera.name, k)));
    statistics.Add(rgb);
    ETUDE_RETURN_IF_ERROR(video.Write(rgb, k == 0 ? video::KeyFrame::kForced : video::KeyFrame::kAsNeeded));
  }
  return statistics.Finish();
}

}  // namespace etude::exports::internal
