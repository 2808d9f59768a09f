// SPDX-License-Identifier: Apache-2.0
// attempts.jsonl: what failed in a dataset's folder, a line an attempt.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "services/core/file.h"
#include "services/episode/episode.h"

namespace etude::store {

/// Bytes of a line that is read; DatasetWriter writes none that is longer.
inline constexpr std::size_t kMaxAttemptLine = 1 << 20;

struct AttemptLine {
  std::uint64_t index = 0;
  std::uint32_t attempt = 0;
  std::string outcome;
  OrderedJson details;  ///< whatever the worker said; null where there are none
  std::string text;     ///< of the line
};

/// Calls `take` for each, in their order. They are only a record: a line that is torn, too long or not understood is
/// left out, and a folder without the file has none.
void ForEachAttempt(const Path& dataset, const std::function<void(const AttemptLine&)>& take);

}  // namespace etude::store
