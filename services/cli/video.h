// SPDX-License-Identifier: Apache-2.0
// Videos of rollouts. OpenCV stays behind this header.
#pragma once

#include <string>
#include <vector>

#include "services/core/file.h"
#include "services/core/result.h"

namespace etude::cli {

/// Writes FOLDER/<index>-<task>-<outcome>.mp4 of at most `limit` recorded rollouts, failures first,
/// twice the camera's size, at real time. Existing videos are kept and count.
/// @returns the files.
/// @error of the store; kUnavailable when OpenCV cannot write mp4.
Result<std::vector<Path>> WriteVideos(const Path& rollouts, const Path& folder, int limit);

}  // namespace etude::cli
