// SPDX-License-Identifier: Apache-2.0
// Videos of rollouts. OpenCV stays behind this header.
#pragma once

#include <string>
#include <vector>

#include "services/cli/decision_insights.h"
#include "services/core/file.h"
#include "services/core/result.h"

namespace etude::cli {

/// Has the policy's part drawn into videos.
struct Overlay {
  InsightFunction ask;
  InsightTally tally;  ///< of the videos that were written
};

/// Writes FOLDER/<index>-<task>-<outcome>.mp4 of at most `limit` recorded rollouts, failures first,
/// twice the camera's size, at real time. Existing videos are kept and count.
/// @param overlay  not null: <index>-<task>-<outcome>-overlay.mp4, large enough for small text, with what the policy
///                 saw and said at its last decision (overlay.h) and the judge's state. A decision without an insight
///                 has its pictures plain. A stop request ends it before the next video.
/// @returns the files.
/// @error of the store; kUnavailable when libav cannot write mp4.
Result<std::vector<Path>> WriteVideos(const Path& rollouts, const Path& folder, int limit, Overlay* overlay = nullptr);

}  // namespace etude::cli
