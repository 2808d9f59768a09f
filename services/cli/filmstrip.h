// SPDX-License-Identifier: Apache-2.0
// Episodes as pictures for people: one row each, frames from first to last. OpenCV stays behind this header.
#pragma once

#include "services/core/file.h"
#include "services/core/result.h"

namespace etude::cli {

struct FilmstripOptions {
  int episodes = 6;  ///< rows: the first ones of the dataset
  int frames = 8;    ///< of each, evenly spread over its length, both ends among them
};

/// Writes the picture as PNG, under each row what was asked for and how it went.
/// @error of the store; kNotFound when no episode has pictures; kInvalidArgument for counts below 1;
/// kUnavailable when the file cannot be written.
Status WriteFilmstrips(const Path& dataset, const Path& png, const FilmstripOptions& options = {});

}  // namespace etude::cli
