// SPDX-License-Identifier: Apache-2.0
// A dataset -> a folder that LeRobot opens: LeRobotDataset(repo_id, root=OUT), without a network.
//   3.0: data, videos and metadata of many episodes a file; 2.1 (LeRobot up to 0.3, robocasa, GR00T): a file an
//   episode.
// README.md says what is in it and where the rules come from.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "services/core/file.h"
#include "services/core/output_folder.h"
#include "services/core/result.h"

namespace etude::exports {

enum class LeRobotVersion : std::uint8_t { k30, k21 };

/// Called after each episode.
using Progress = std::function<void(std::uint64_t done, std::uint64_t total)>;

struct LeRobotOptions {
  LeRobotVersion version = LeRobotVersion::k30;
  Leftover leftover = Leftover::kRefuse;
  std::vector<std::uint64_t> indices;         ///< of the episodes; none: all, in order
  std::uint64_t data_file_bytes = 100 << 20;  ///< 3.0: a file of rows is closed once it is so large
  std::uint64_t video_file_bytes = 200 << 20;
  Progress progress;  ///< may be empty
};

struct LeRobotReport {
  std::uint64_t episodes = 0, frames = 0, tasks = 0, videos = 0;
};

/// Episode by episode; in memory are one of them, the sentences, and LeRobot's metadata of a hundred. OUT appears when
/// all of it is durable. A stop request ends it before the next episode.
/// @error kInvalidArgument: OUT is there, episodes that are not alike, odd sizes of pictures; kNotFound: no dataset, or
/// no episode in it; kExhausted: stopped; of the store and the disk
Result<LeRobotReport> ExportLeRobot(const Path& dataset, const Path& out, const LeRobotOptions& options);

}  // namespace etude::exports
