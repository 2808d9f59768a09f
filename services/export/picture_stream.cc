// SPDX-License-Identifier: Apache-2.0
#include "services/export/picture_stream.h"

#include "services/episode/frame_cursor.h"

namespace etude::exports::internal {

Result<FeatureStatistics> WritePictures(const Episode& episode, std::size_t camera, video::Mp4Writer& video) {
  FrameCursor frames(episode, camera);
  PictureStatistics statistics;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    ETUDE_ASSIGN_OR_RETURN(const auto rgb, frames.Frame(k));
    statistics.Add(rgb);
    ETUDE_RETURN_IF_ERROR(video.Write(rgb, k == 0 ? video::KeyFrame::kForced : video::KeyFrame::kAsNeeded));
  }
  return statistics.Finish();
}

}  // namespace etude::exports::internal
