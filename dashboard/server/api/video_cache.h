// SPDX-License-Identifier: Apache-2.0
// Episodes as mp4, made once and kept in a folder of bounded size.
#pragma once

#include <cstdint>

#include "services/core/file.h"
#include "services/store/dataset.h"

namespace etude::api {

/// FOLDER/<hash>.mp4 of what one camera saw, made now when it is not there; named by the episode's file (its place,
/// size and time), so that one that was made again gets a video of its own. Then the videos that were asked for the
/// longest time ago are removed until the folder holds at most `most_bytes`. One thread at a time.
/// @error kNotFound: no pictures; of the store and of services/video
Result<Path> CachedVideo(const Path& folder, const store::EpisodeRecord& record, std::size_t camera,
                         std::uint64_t most_bytes = 2ull << 30);

}  // namespace etude::api
