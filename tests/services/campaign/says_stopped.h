// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "services/core/config.h"
#include "services/core/file.h"

namespace etude::campaign {

/// Whether the dataset's collector.json says of its last collector that it was stopped.
inline bool SaysStopped(const Path& data) {
  const auto text = ReadTextFile(data / "collector.json");
  return OrderedJson::parse(text.value_or("{}")).value("ended", "") == "stopped";
}

}  // namespace etude::campaign
