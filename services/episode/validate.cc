// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "services/codec/deflate.h"
#include "services/core/file.h"
#include "services/episode/bounded_json.h"
#include "services/episode/codec.h"
#include "services/episode/tracks.h"

namespace etude {
namespace {

constexpr std::size_t kMaxText = 4096;
constexpr int kMaxColumns = 4096;

tl::unexpected<Error> Bad(std::string message) { return Fail(Code::kInvalidArgument, std::move(message)); }

Status CheckTexts(const Episode& episode) {
  const std::pair<const char*, const std::string*> texts[] = {{"campaign", &episode.campaign},
                                                              {"spec_sha256", &episode.spec_sha256},
                                                              {"scene_sha256", &episode.scene_sha256},
                                                              {"version", &episode.version},
                                                              {"robot", &episode.robot},
                                                              {"task", &episode.task},
                                                              {"target", &episode.target},
                                                              {"reference", &episode.reference},
                                                              {"instruction", &episode.instruction},
                                                              {"outcome", &episode.outcome}};
  const auto good = [](const std::string& text) {
    return text.size() <= kMaxText && text.find('\0') == std::string::npos;
  };
  for (const auto& [name, text] : texts)
    if (!good(*text)) return Bad(fmt::format("{}: longer than {} or with a NUL", name, kMaxText));
  if (!std::all_of(episode.stage_names.begin(), episode.stage_names.end(), good))
    return Bad("stage_names: one is too long or has a NUL");
  if (episode.stage_names.size() > 255) return Bad("stage_names: more than 255");
  if (!episode.details.is_object()) return Bad("details: not a map");
  if (!IsBounded(episode.details)) return Bad(fmt::format("details: nested deeper than {}", kMaxJsonDepth));
  return {};
}

Status CheckNames(const Episode& episode) {
  if (episode.objects.size() > kMaxObjects) return Bad("objects: too many");
  if (episode.cameras.size() > kMaxCameras) return Bad("cameras: too many");
  std::set<std::string> objects, cameras;
  for (const auto& object : episode.objects)
    if (!IsPlainName(object.name) || !objects.insert(object.name).second)
      return Bad("objects: a name is not plain, or comes twice");
  for (const auto& track : episode.cameras)
    if (!IsPlainName(track.camera.name) || !cameras.insert(track.camera.name).second)
      return Bad("cameras: a name is not plain, or comes twice");
  return {};
}

// `columns` from `first` on hold a unit quaternion in every row
bool AreUnit(const Track& track, int first) {
  for (int t = 0; t < track.rows(); ++t) {
    double sum = 0;
    for (int i = first; i < first + 4; ++i) sum += static_cast<double>(track.row(t)[i]) * track.row(t)[i];
    if (std::abs(sum - 1) > 2e-3) return false;
  }
  return true;
}

// columns 3 to 8 of every row are two unit vectors at right angles (Rotation6D)
bool AreRotations(const Track& track) {
  for (int t = 0; t < track.rows(); ++t) {
    const auto row = track.row(t);
    const Eigen::Vector3d a(row[3], row[4], row[5]), b(row[6], row[7], row[8]);
    if (std::abs(a.norm() - 1) > 1e-3 || std::abs(b.norm() - 1) > 1e-3 || std::abs(a.dot(b)) > 1e-3) return false;
  }
  return true;
}

Status CheckTrack(const std::string& name, const Track& track, int columns, std::size_t steps) {
  if (name == "states" && track.columns == 0 && track.values.empty()) return {};
  if (track.columns < 1 || track.columns > kMaxColumns || (columns != kAnyColumns && track.columns != columns))
    return Bad(fmt::format("{}: {} columns", name, track.columns));
  if (track.values.size() != steps * static_cast<std::size_t>(track.columns))
    return Bad(fmt::format("{}: {} values are not {} rows of {}", name, track.values.size(), steps, track.columns));
  if (!name.ends_with("pixel") &&
      !std::all_of(track.values.begin(), track.values.end(), [](float x) { return std::isfinite(x); }))
    return Bad(name + ": a value is not finite");
  if (name == "eef_quat" && !AreUnit(track, 0)) return Bad(name + ": not a unit quaternion");
  if (name == "actions_abs" && !AreRotations(track)) return Bad(name + ": a row has no rotation");
  if (name.ends_with("/pose") && !AreUnit(track, 3)) return Bad(name + ": not a unit quaternion");
  return {};
}

Status CheckPhases(const Episode& episode, std::size_t steps) {
  if (episode.phase.size() != steps) return Bad(fmt::format("phase: {} rows, not {}", episode.phase.size(), steps));
  if (episode.supervise.size() != steps)
    return Bad(fmt::format("supervise: {} rows, not {}", episode.supervise.size(), steps));
  const std::size_t stages = std::max<std::size_t>(episode.stage_names.size(), 1);
  if (*std::max_element(episode.phase.begin(), episode.phase.end()) >= stages)
    return Bad("phase: a stage without a name");
  if (*std::max_element(episode.supervise.begin(), episode.supervise.end()) > 1)
    return Bad("supervise: neither 0 nor 1");
  return {};
}

Status CheckCamera(const Camera& camera) {
  const std::string where = "camera " + camera.name;
  if (camera.width < 1 || camera.height < 1 || camera.width > kMaxImageSide || camera.height > kMaxImageSide)
    return Bad(fmt::format("{}: {}x{} px", where, camera.width, camera.height));
  if (!(camera.fovy > 0 && camera.fovy < std::numbers::pi)) return Bad(where + ": field of view");
  if (!camera.X_WC.p.allFinite() || !(std::abs(camera.X_WC.q.norm() - 1) < 1e-3))
    return Bad(where + ": pose is not finite or not a rotation");
  return {};
}

}  // namespace

std::size_t RecordedFrames(const Episode& episode, std::size_t camera) {
  if (episode.cameras[camera].streams.empty()) return 0;
  return static_cast<std::size_t>(FrameCount(episode.steps(), episode.image_stride));
}

Status ValidateStreams(const Episode& episode, std::size_t camera,
                       std::span<const std::span<const std::uint8_t>> streams) {
  if (streams.empty()) return {};
  const CameraTrack& track = episode.cameras[camera];
  const codec::FrameLayout layout = track.layout();
  const std::string where = "camera " + track.camera.name;
  if (!layout.IsGood())
    return Bad(fmt::format("{}: chunks of {} frames x {} rows", where, layout.chunk.frames, layout.rows()));
  const auto frames = static_cast<std::size_t>(FrameCount(episode.steps(), episode.image_stride));
  if (streams.size() != layout.streams(frames))
    return Bad(fmt::format("{}: {} streams of frames, not {}", where, streams.size(), layout.streams(frames)));
  if (static_cast<std::size_t>(layout.chunk.frames) > frames)
    return Bad(fmt::format("{}: chunks of {} frames, there are {}", where, layout.chunk.frames, frames));
  if (streams.size() > kMaxStreams)
    return Bad(fmt::format("{}: {} streams of frames, more than {}", where, streams.size(), kMaxStreams));
  for (const auto& stream : streams)
    if (stream.empty() || stream.size() > codec::StreamBound(layout.stream_bytes()))
      return Bad(fmt::format("{}: a stream of {} bytes", where, stream.size()));
  return {};
}

Status ValidateEpisode(const Episode& episode) {
  const auto steps = static_cast<std::int64_t>(episode.eef_pos.values.size() / 3);
  if (steps < 1 || steps > kMaxSteps) return Bad(fmt::format("{} steps, not 1..{}", steps, kMaxSteps));
  if (episode.image_stride < 1 || episode.image_stride > 1000)
    return Bad(fmt::format("image_stride: {} not in 1..1000", episode.image_stride));
  ETUDE_RETURN_IF_ERROR(CheckTexts(episode));
  ETUDE_RETURN_IF_ERROR(CheckNames(episode));
  Status tracks;
  VisitTracks(episode, [&](const std::string& name, const Track& track, int columns) {
    if (tracks) tracks = CheckTrack(name, track, columns, static_cast<std::size_t>(steps));
  });
  ETUDE_RETURN_IF_ERROR(tracks);
  ETUDE_RETURN_IF_ERROR(CheckPhases(episode, static_cast<std::size_t>(steps)));
  for (const auto& track : episode.cameras) ETUDE_RETURN_IF_ERROR(CheckCamera(track.camera));
  const StreamSpans streams = StreamsOf(episode);
  for (std::size_t i = 0; i < streams.size(); ++i) ETUDE_RETURN_IF_ERROR(ValidateStreams(episode, i, streams[i]));
  return {};
}

}  // namespace etude
