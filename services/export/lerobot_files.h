// SPDX-License-Identifier: Apache-2.0
// The two ways in which LeRobot's versions lay out files, behind one interface: what is said of an episode is the same.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "services/core/config.h"
#include "services/core/file.h"
#include "services/core/result.h"
#include "services/export/frame_table.h"
#include "services/export/lerobot.h"

namespace etude::exports::internal {

inline constexpr std::int64_t kChunkSize = 1000;  ///< files (3.0) or episodes (2.1) a folder

/// One episode, ready to be written.
struct LeRobotEpisode {
  const Episode* source = nullptr;
  FramePlace place;
  FrameTable table;                           ///< statistics of pictures are added by WritePictures
  OrderedJson facts = OrderedJson::object();  ///< ours: seed, outcome, ...; texts and numbers
};

/// Writes into a folder. Not thread-safe.
class LeRobotFiles {
 public:
  virtual ~LeRobotFiles() = default;
  /// @error of the disk and the encoder
  virtual Status Write(LeRobotEpisode& episode) = 0;
  /// Ends all files and writes the metadata.
  /// @param tasks  sentences, in the order of their numbers
  virtual Status Finish(const std::vector<std::string>& tasks,
                        const std::map<std::string, FeatureStatistics>& statistics, LeRobotReport& report) = 0;
};

std::unique_ptr<LeRobotFiles> MakeFiles30(const Path& folder, const FrameLayout& layout, const LeRobotOptions& options);
std::unique_ptr<LeRobotFiles> MakeFiles21(const Path& folder, const FrameLayout& layout);

/// What info.json of both versions says.
OrderedJson InfoJson(const char* version, const FrameLayout& layout, const LeRobotReport& report);
/// {"observation.state": {"min": ...}, ...}
OrderedJson StatisticsJson(const std::map<std::string, FeatureStatistics>& statistics, WithQuantiles quantiles);

}  // namespace etude::exports::internal
