// SPDX-License-Identifier: Apache-2.0
// An episode as LeRobot has it: named features, a row a picture. What is sampled is what robomimic's arrays in the
// episode's file have too: the state at the picture, and the last command before the next one.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "services/core/config.h"
#include "services/core/result.h"
#include "services/episode/episode.h"
#include "services/export/feature_statistics.h"
#include "services/export/parquet_writer.h"
#include "services/video/mp4_writer.h"

namespace etude::exports {

struct Feature {
  std::string name;  ///< "observation.state"
  ParquetType type = ParquetType::kFloat;
  std::vector<std::string> names;  ///< of its numbers; one a dimension
  bool operator==(const Feature&) const = default;

  bool is_scalar() const { return names.size() == 1; }
};

struct CameraFeature {
  std::string camera, name;  ///< "front", "observation.images.front"
  int width = 0, height = 0;
  bool operator==(const CameraFeature&) const = default;
};

/// What all episodes of one dataset must have alike.
struct FrameLayout {
  std::string robot;
  int fps = 0;
  int image_stride = 1;
  std::vector<Feature> features;       ///< without those that LeRobot adds by itself
  std::vector<CameraFeature> cameras;  ///< that have pictures
  bool operator==(const FrameLayout&) const = default;
};

/// Every second picture is a key frame, so that readers who ask for single pictures find them quickly.
video::Mp4Options VideoOptions(const CameraFeature& camera, int fps);

/// Where an episode and its rows stand in the export.
struct FramePlace {
  std::int64_t episode = 0;      ///< its number, from 0
  std::int64_t first_index = 0;  ///< rows of all episodes before it
  std::int64_t task = 0;         ///< number of its sentence
};

/// Features: observation.state (joints, gripper), action (10: x, y, z, rotation in 6D, gripper), next.reward,
/// next.done, next.success; and, for people and other losses than a policy's, label.* (hand and target in space and in
/// the picture, stage, whether to imitate).
/// @error kInvalidArgument: its pictures come at a rate that is no whole number
Result<FrameLayout> LayoutOf(const Episode& episode);
/// @error kInvalidArgument: by what `episode` differs from the others, and what to do
Status CheckLayout(const FrameLayout& layout, const Episode& episode);

/// LeRobot's own: timestamp, frame_index, episode_index, index, task_index.
const std::vector<Feature>& DefaultFeatures();
/// The layout's features, then the default ones.
std::vector<ParquetColumn> ColumnsOf(const FrameLayout& layout);

struct FrameTable {
  std::size_t rows = 0;
  std::vector<ParquetCells> cells;                      ///< as ColumnsOf
  std::map<std::string, FeatureStatistics> statistics;  ///< of every column, by name
};
/// @pre CheckLayout
FrameTable TableOf(const FrameLayout& layout, const Episode& episode, const FramePlace& place);

/// "features" of info.json, videos included.
OrderedJson FeaturesJson(const FrameLayout& layout);

}  // namespace etude::exports
