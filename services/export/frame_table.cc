// SPDX-License-Identifier: Apache-2.0
#include "services/export/frame_table.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <sstream>

#include "services/episode/action.h"
#include "services/episode/codec.h"

namespace etude::exports {
namespace {

std::vector<std::string> Numbered(const char* name, int count) {
  std::vector<std::string> names;
  for (int i = 0; i < count; ++i) names.push_back(fmt::format("{}_{}", name, i));
  return names;
}

std::vector<std::string> StateNames(const Episode& episode) {
  std::vector<std::string> names = Numbered("joint", episode.joint_pos.columns);
  for (auto& name : Numbered("gripper", episode.gripper_qpos.columns)) names.push_back(std::move(name));
  return names;
}

std::vector<std::string> ActionNames() {
  std::vector<std::string> names;
  std::istringstream words(kWaypointNames);
  for (std::string word; words >> word;) names.push_back(word);
  return names;
}

std::vector<Feature> AllFeatures(const FrameLayout& layout) {
  std::vector<Feature> all = layout.features;
  all.insert(all.end(), DefaultFeatures().begin(), DefaultFeatures().end());
  return all;
}

// What is known at one picture. Pixels behind the camera are NaN, as in the episode.
class Rows {
 public:
  Rows(const Episode& episode, const FramePlace& place, int fps)
      : episode_(episode),
        target_(episode.FindObject(episode.target)),
        place_(place),
        fps_(fps),
        count_(static_cast<int>(FrameCount(episode.steps(), episode.image_stride))) {}

  int count() const { return count_; }

  std::vector<double> At(const std::string& feature, int k) const {
    const int step = k * episode_.image_stride;
    const int command = std::min(step + episode_.image_stride, episode_.steps()) - 1;
    const bool last = k + 1 == count_;
    const auto row = [&](const Track& track, int t) {
      return std::vector<double>(track.row(t).begin(), track.row(t).end());
    };
    if (feature == "observation.state") {
      auto state = row(episode_.joint_pos, step);
      const auto gripper = row(episode_.gripper_qpos, step);
      state.insert(state.end(), gripper.begin(), gripper.end());
      return state;
    }
    if (feature == "action") return row(episode_.actions_abs, command);
    if (feature == "label.eef_position") return row(episode_.eef_pos, step);
    if (feature == "label.eef_quaternion") return row(episode_.eef_quat, step);
    if (feature == "label.eef_pixel") return row(episode_.eef_pixel, step);
    if (feature == "label.target_position") return TargetPosition(step);
    if (feature == "label.target_pixel")
      return target_ == nullptr ? std::vector<double>{NAN, NAN} : row(target_->pixel, step);
    return {Scalar(feature, k, static_cast<std::size_t>(step), last)};
  }

 private:
  std::vector<double> TargetPosition(int step) const {
    if (target_ == nullptr) return {NAN, NAN, NAN};
    const auto pose = target_->pose.row(step);
    return {pose[0], pose[1], pose[2]};
  }

  double Scalar(const std::string& feature, int k, std::size_t step, bool last) const {
    if (feature == "label.stage") return episode_.phase[step];
    if (feature == "label.imitate") return episode_.supervise[step];
    if (feature == "next.done") return last;
    if (feature == "next.reward" || feature == "next.success") return last && episode_.success;
    if (feature == "timestamp") return static_cast<double>(k) / fps_;
    if (feature == "frame_index") return k;
    if (feature == "episode_index") return static_cast<double>(place_.episode);
    if (feature == "index") return static_cast<double>(place_.first_index + k);
    return static_cast<double>(place_.task);  // task_index
  }

  const Episode& episode_;
  const ObjectTrack* target_;  // null: a task without one
  const FramePlace& place_;
  int fps_, count_;
};

template <class T>
ParquetCells CellsOf(const std::vector<double>& values, std::size_t rows, const Feature& feature) {
  std::vector<T> typed;
  typed.reserve(values.size());
  for (const double value : values) typed.push_back(static_cast<T>(value));
  if (feature.is_scalar()) return Cells(std::move(typed));
  return Lists(std::move(typed), rows, {static_cast<std::uint32_t>(feature.names.size())});
}

ParquetCells TypedCells(const std::vector<double>& values, std::size_t rows, const Feature& feature) {
  if (feature.type == ParquetType::kBool) return CellsOf<std::uint8_t>(values, rows, feature);
  if (feature.type == ParquetType::kInt64) return CellsOf<std::int64_t>(values, rows, feature);
  return CellsOf<float>(values, rows, feature);
}

const char* DtypeOf(ParquetType type) {
  if (type == ParquetType::kBool) return "bool";
  return type == ParquetType::kInt64 ? "int64" : "float32";
}

OrderedJson VideoJson(const CameraFeature& camera, int fps) {
  const video::Mp4Options options = VideoOptions(camera, fps);
  return {{"dtype", "video"},
          {"shape", OrderedJson::array({camera.height, camera.width, 3})},
          {"names", OrderedJson::array({"height", "width", "channels"})},
          {"info",
           {{"video.height", camera.height},
            {"video.width", camera.width},
            {"video.codec", options.kCodec},
            {"video.pix_fmt", options.kPixelFormat},
            {"video.is_depth_map", false},
            {"video.fps", fps},
            {"video.channels", 3},
            {"video.g", options.key_frame_every},
            {"video.crf", options.crf},
            {"video.preset", options.kPreset},
            {"has_audio", false}}}};
}

std::vector<std::string> Differences(const FrameLayout& a, const FrameLayout& b) {
  std::vector<std::string> differences;
  if (a.robot != b.robot) differences.push_back(fmt::format("robot {}, not {}", b.robot, a.robot));
  if (a.image_stride != b.image_stride)
    differences.push_back(fmt::format("a picture each {} steps, not {}", b.image_stride, a.image_stride));
  if (a.features != b.features) differences.push_back("another number of joints");
  if (a.cameras != b.cameras) differences.push_back("other cameras or sizes of pictures");
  return differences;
}

}  // namespace

video::Mp4Options VideoOptions(const CameraFeature& camera, int fps) {
  return {.width = camera.width, .height = camera.height, .rate = {fps, 1}, .key_frame_every = 2, .crf = 23};
}

Result<FrameLayout> LayoutOf(const Episode& episode) {
  FrameLayout layout{
      .robot = episode.robot, .fps = 0, .image_stride = episode.image_stride, .features = {}, .cameras = {}};
  const double fps = kControlRate / episode.image_stride;
  layout.fps = static_cast<int>(std::lround(fps));
  if (layout.fps < 1 || layout.fps != fps)
    return Fail(Code::kInvalidArgument,
                fmt::format("episode {} has {} pictures a second (a picture each {} steps of 8 ms); LeRobot wants a "
                            "whole number: an image_stride of 1, 5, 25 or 125",
                            episode.index, fps, episode.image_stride));
  const std::vector<std::string> xyz{"x", "y", "z"}, uv{"u", "v"};
  layout.features = {{"observation.state", ParquetType::kFloat, StateNames(episode)},
                     {"action", ParquetType::kFloat, ActionNames()},
                     {"next.reward", ParquetType::kFloat, {"reward"}},
                     {"next.done", ParquetType::kBool, {"done"}},
                     {"next.success", ParquetType::kBool, {"success"}},
                     {"label.eef_position", ParquetType::kFloat, xyz},
                     {"label.eef_quaternion", ParquetType::kFloat, {"w", "x", "y", "z"}},
                     {"label.eef_pixel", ParquetType::kFloat, uv},
                     {"label.target_position", ParquetType::kFloat, xyz},
                     {"label.target_pixel", ParquetType::kFloat, uv},
                     {"label.stage", ParquetType::kInt64, {"stage"}},
                     {"label.imitate", ParquetType::kBool, {"imitate"}}};
  for (const auto& track : episode.cameras)
    if (!track.streams.empty())
      layout.cameras.push_back(
          {track.camera.name, "observation.images." + track.camera.name, track.camera.width, track.camera.height});
  return layout;
}

Status CheckLayout(const FrameLayout& layout, const Episode& episode) {
  ETUDE_ASSIGN_OR_RETURN(const FrameLayout found, LayoutOf(episode));
  if (found == layout) return {};
  return Fail(Code::kInvalidArgument,
              fmt::format("episode {} differs from those before it ({}); all episodes of a LeRobot dataset are alike: "
                          "take them apart first (etude dataset split --by robot)",
                          episode.index, fmt::join(Differences(layout, found), "; ")));
}

const std::vector<Feature>& DefaultFeatures() {
  static const std::vector<Feature> features{{"timestamp", ParquetType::kFloat, {"timestamp"}},
                                             {"frame_index", ParquetType::kInt64, {"frame_index"}},
                                             {"episode_index", ParquetType::kInt64, {"episode_index"}},
                                             {"index", ParquetType::kInt64, {"index"}},
                                             {"task_index", ParquetType::kInt64, {"task_index"}}};
  return features;
}

std::vector<ParquetColumn> ColumnsOf(const FrameLayout& layout) {
  std::vector<ParquetColumn> columns;
  for (const Feature& feature : AllFeatures(layout))
    columns.push_back({feature.name, feature.type, feature.is_scalar() ? 0 : 1});
  return columns;
}

FrameTable TableOf(const FrameLayout& layout, const Episode& episode, const FramePlace& place) {
  const Rows rows(episode, place, layout.fps);
  FrameTable table{.rows = static_cast<std::size_t>(rows.count()), .cells = {}, .statistics = {}};
  for (const Feature& feature : AllFeatures(layout)) {
    std::vector<double> values;
    for (int k = 0; k < rows.count(); ++k) {
      const auto row = rows.At(feature.name, k);
      values.insert(values.end(), row.begin(), row.end());
    }
    table.statistics[feature.name] = StatisticsOf(values, feature.names.size());
    table.cells.push_back(TypedCells(values, table.rows, feature));
  }
  return table;
}

OrderedJson FeaturesJson(const FrameLayout& layout) {
  OrderedJson json = OrderedJson::object();
  for (const auto& camera : layout.cameras) json[camera.name] = VideoJson(camera, layout.fps);
  for (const Feature& feature : AllFeatures(layout))
    json[feature.name] = {{"dtype", DtypeOf(feature.type)},
                          {"shape", OrderedJson::array({feature.names.size()})},
                          {"names", feature.is_scalar() ? OrderedJson() : OrderedJson(feature.names)}};
  return json;
}

}  // namespace etude::exports
