// SPDX-License-Identifier: Apache-2.0
// Episodes as pictures for people: one row each, frames from first to last. OpenCV stays behind this header.
#pragma once

#include <cstdint>
#include <vector>

#include "services/core/file.h"
#include "services/core/result.h"

namespace etude::cli {

struct FilmstripOptions {
  std::vector<std::uint64_t> indices;  ///< rows; empty: the first `episodes` of the dataset
  int episodes = 6;
  int frames = 8;  ///< of each, evenly spread over its length, both ends among them
};

/// To a name that ends in .webp or .mp4: the episodes side by side, moving, at real time. Else writes the picture, as
/// JPEG to a name that ends in .jpg, else as PNG; under each row what was asked for and how it went.
/// @error of the store; kNotFound when an index is not there or no episode has pictures; kInvalidArgument for counts
/// below 1;
/// kUnavailable when the file cannot be written.
Status WriteFilmstrips(const Path& dataset, const Path& picture, const FilmstripOptions& options = {});

}  // namespace etude::cli
