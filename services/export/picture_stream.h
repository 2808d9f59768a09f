// SPDX-License-Identifier: Apache-2.0
// The pictures of one camera of one episode into a video, counted on the way.
#pragma once

#include "services/core/result.h"
#include "services/episode/episode.h"
#include "services/export/feature_statistics.h"
#include "services/video/mp4_writer.h"

namespace etude::exports::internal {

/// The first picture becomes a key frame. @error kCorrupt: a frame does not inflate; of the encoder
Result<FeatureStatistics> WritePictures(const Episode& episode, std::size_t camera, video::Mp4Writer& video);

}  // namespace etude::exports::internal
