// SPDX-License-Identifier: Apache-2.0
// One episode: what it is, its tracks, its pictures and its video.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "dashboard/server/api/arrays.h"
#include "dashboard/server/api/context.h"
#include "dashboard/server/api/video_cache.h"
#include "services/codec/deflate.h"
#include "services/episode/action.h"
#include "services/episode/tracks.h"
#include "services/spec/task_name.h"
#include "services/video/picture.h"

namespace etude::api {
namespace {

using Record = std::shared_ptr<const store::EpisodeRecord>;

struct OpenedEpisode {
  std::shared_ptr<sources::DatasetSource> source;
  Record record;
};

Result<OpenedEpisode> OpenEpisode(Context& context, const http::Request& request) {
  OpenedEpisode opened;
  ETUDE_ASSIGN_OR_RETURN(const std::uint64_t index, request.Index("n"));
  ETUDE_ASSIGN_OR_RETURN(opened.source, context.sources.Dataset(request.Parameter("id")));
  ETUDE_ASSIGN_OR_RETURN(opened.record, opened.source->Episode(index));
  return opened;
}

// ---- attributes ---------------------------------------------------------------------------------

OrderedJson Stages(const Episode& episode) {
  OrderedJson stages = OrderedJson::array();
  const auto& phase = episode.phase;
  for (std::size_t from = 0; from < phase.size();) {
    std::size_t to = from;
    while (to < phase.size() && phase[to] == phase[from]) ++to;
    const std::string name =
        phase[from] < episode.stage_names.size() ? episode.stage_names[phase[from]] : std::to_string(phase[from]);
    stages.push_back({{"name", name}, {"from", from}, {"to", to}});
    from = to;
  }
  return stages;
}

OrderedJson Unsupervised(const Episode& episode) {
  OrderedJson spans = OrderedJson::array();
  const auto& supervise = episode.supervise;
  for (std::size_t from = 0; from < supervise.size(); ++from) {
    if (supervise[from] != 0) continue;
    std::size_t to = from;
    while (to < supervise.size() && supervise[to] == 0) ++to;
    spans.push_back({{"from", from}, {"to", to}});
    from = to;
  }
  return spans;
}

std::vector<std::string> Labels(const std::string& name, int columns) {
  static const std::map<std::string, std::vector<std::string>> kNamed{
      {"eef_pos", {"x", "y", "z"}},
      {"eef_quat", {"w", "x", "y", "z"}},
      {"eef_pixel", {"u", "v"}},
      {"actions_abs", {"x", "y", "z", "r1x", "r1y", "r1z", "r2x", "r2y", "r2z", "gripper"}},
      {"pose", {"x", "y", "z", "qw", "qx", "qy", "qz"}},
      {"pixel", {"u", "v"}}};
  const auto slash = name.rfind('/');
  const auto found = kNamed.find(slash == std::string::npos ? name : name.substr(slash + 1));
  if (found != kNamed.end() && found->second.size() == static_cast<std::size_t>(columns)) return found->second;
  std::vector<std::string> labels;
  for (int i = 0; i < columns; ++i) labels.push_back(std::to_string(i + 1));
  return labels;
}

const char* Unit(const std::string& name) {
  if (name.ends_with("pixel")) return "px";
  if (name == "joint_pos") return "rad";
  if (name == "joint_vel") return "rad/s";
  return name == "eef_pos" || name == "actions_abs" || name.ends_with("/pose") ? "m" : "-";
}

OrderedJson Tracks(const Episode& episode) {
  OrderedJson tracks = OrderedJson::array();
  VisitTracks(episode, [&](const std::string& name, const Track& track, int) {
    tracks.push_back(
        {{"name", name}, {"columns", track.columns}, {"labels", Labels(name, track.columns)}, {"unit", Unit(name)}});
  });
  return tracks;
}

OrderedJson Cameras(const store::EpisodeRecord& record) {
  OrderedJson cameras = OrderedJson::array();
  for (std::size_t i = 0; i < record.episode.cameras.size(); ++i) {
    const Camera& camera = record.episode.cameras[i].camera;
    const auto& p = camera.X_WC.p;
    const auto& q = camera.X_WC.q;
    cameras.push_back({{"name", camera.name},
                       {"width_px", camera.width},
                       {"height_px", camera.height},
                       {"fovy_rad", camera.fovy},
                       {"frames", i < record.frames.size() ? record.frames[i].size() : 0},
                       {"position_m", {p.x(), p.y(), p.z()}},
                       {"quaternion_wxyz", {q.w(), q.x(), q.y(), q.z()}}});
  }
  return cameras;
}

// Its neighbours, and what only the list knows of it.
OrderedJson PlaceInList(const std::vector<sources::EpisodeRow>& rows, std::uint64_t index) {
  const auto at = std::ranges::lower_bound(rows, index, {}, &sources::EpisodeRow::index);
  const bool listed = at != rows.end() && at->index == index;
  const auto after = listed ? std::next(at) : at;
  return {{"previous", at == rows.begin() ? OrderedJson() : OrderedJson(std::prev(at)->index)},
          {"next", after == rows.end() ? OrderedJson() : OrderedJson(after->index)},
          {"worker", listed ? sources::TextOrNull(at->worker) : OrderedJson()},
          {"host", listed ? sources::TextOrNull(at->host) : OrderedJson()},
          {"t", listed ? sources::TimeJson(at->t) : OrderedJson()}};
}

Result<http::Answer> EpisodeAnswer(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const OpenedEpisode opened, OpenEpisode(context, request));
  ETUDE_ASSIGN_OR_RETURN(const auto view, opened.source->View());
  const Episode& episode = opened.record->episode;
  std::vector<std::string> objects;
  for (const auto& object : episode.objects) objects.push_back(object.name);
  std::error_code error;
  const auto bytes = std::filesystem::file_size(opened.record->path, error);
  OrderedJson json{{"dataset", opened.source->found().id},
                   {"index", episode.index},
                   {"attempt", episode.attempt},
                   {"seed", std::to_string(episode.seed)},
                   {"campaign", episode.campaign},
                   {"robot", episode.robot},
                   {"task", episode.task},
                   {"target", episode.target},
                   {"reference", episode.reference},
                   {"obstacle", episode.task.ends_with("+obstacle") ? OrderedJson(kObstacleObject) : OrderedJson()},
                   {"instruction", episode.instruction},
                   {"success", episode.success},
                   {"outcome", episode.outcome},
                   {"split", sources::SplitOrNone(view->info.spec, episode.index)},
                   {"spec_sha256", episode.spec_sha256},
                   {"scene_sha256", episode.scene_sha256},
                   {"version", episode.version},
                   {"steps", episode.steps()},
                   {"duration_s", episode.steps() / kControlRate},
                   {"control_rate_hz", kControlRate},
                   {"image_stride", episode.image_stride},
                   {"bytes", error ? 0 : bytes},
                   {"stages", Stages(episode)},
                   {"unsupervised", Unsupervised(episode)},
                   {"objects", objects},
                   {"tracks", Tracks(episode)},
                   {"cameras", Cameras(*opened.record)},
                   {"details", http::ForBrowsers(episode.details)}};
  json.update(PlaceInList(view->rows, episode.index));
  return http::JsonAnswer(json);
}

// ---- tracks -------------------------------------------------------------------------------------

constexpr int kMostPoints = 100'000;  // an episode's longest (rollout.max_steps)

struct PictureWindow {
  int from = 0, to = 0, points = 4000;
  int rows() const { return to - from; }
  bool bucketed() const { return rows() > points; }
  int buckets() const { return bucketed() ? points : rows(); }
  int Begin(int bucket) const {
    return from + static_cast<int>(static_cast<std::int64_t>(bucket) * rows() / std::max(1, buckets()));
  }
};

void AddTrack(const std::string& name, const Track& track, const PictureWindow& window, store::Safetensors& content) {
  const int columns = track.columns;
  const std::vector<std::int64_t> shape{window.buckets(), columns};
  std::vector<float> low, high, last;
  for (int bucket = 0; bucket < window.buckets(); ++bucket)
    for (int column = 0; column < columns; ++column) {
      float least = track.row(window.Begin(bucket))[column], most = least, end = least;
      for (int t = window.Begin(bucket) + 1; t < window.Begin(bucket + 1); ++t) {
        end = track.row(t)[column];
        least = std::fmin(least, end), most = std::fmax(most, end);  // a NaN (behind the camera) hides no number
      }
      low.push_back(least), high.push_back(most), last.push_back(end);
    }
  if (!window.bucketed()) {
    content.tensors[name] = TensorOf(store::DType::kF32, last, shape);
    return;
  }
  content.tensors[name + "/min"] = TensorOf(store::DType::kF32, low, shape);
  content.tensors[name + "/max"] = TensorOf(store::DType::kF32, high, shape);
  content.tensors[name + "/last"] = TensorOf(store::DType::kF32, last, shape);
}

void AddBytes(const std::string& name, const std::vector<std::uint8_t>& values, const PictureWindow& window,
              store::Safetensors& content) {
  std::vector<std::uint8_t> last;
  for (int bucket = 0; bucket < window.buckets(); ++bucket)
    last.push_back(values[static_cast<std::size_t>(window.Begin(bucket + 1) - 1)]);
  content.tensors[window.bucketed() ? name + "/last" : name] = TensorOf(store::DType::kU8, last);
}

std::set<std::string> Names(const http::Query& query) {
  std::set<std::string> names;
  std::string rest = query.Get("names").value_or("");
  for (std::size_t begin = 0; begin < rest.size();) {
    const auto comma = std::min(rest.find(',', begin), rest.size());
    if (comma > begin) names.insert(rest.substr(begin, comma - begin));
    begin = comma + 1;
  }
  return names;
}

Result<http::Answer> TracksAnswer(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const OpenedEpisode opened, OpenEpisode(context, request));
  const Episode& episode = opened.record->episode;
  const int steps = episode.steps();
  PictureWindow window;
  ETUDE_ASSIGN_OR_RETURN(const auto from, request.query.Integer("from", 0, 0, steps));
  ETUDE_ASSIGN_OR_RETURN(const auto to, request.query.Integer("to", steps, 0, 100'000'000));
  ETUDE_ASSIGN_OR_RETURN(const auto points, request.query.Integer("points", 4000, 2, kMostPoints));
  window.from = static_cast<int>(from);
  window.to = static_cast<int>(std::clamp<std::int64_t>(to, from, steps));
  window.points = static_cast<int>(points);
  auto names = Names(request.query);
  const auto wanted = [&](const std::string& name) { return names.erase(name) > 0; };
  const bool all = names.empty();
  store::Safetensors content;
  VisitTracks(episode, [&](const std::string& name, const Track& track, int) {
    if (all ? name != "states" : wanted(name)) AddTrack(name, track, window, content);
  });
  if (all || wanted("phase")) AddBytes("phase", episode.phase, window, content);
  if (all || wanted("supervise")) AddBytes("supervise", episode.supervise, window, content);
  if (!names.empty())
    return Fail(Code::kInvalidArgument, fmt::format("names: there is no track '{:.60}'", *names.begin()));
  std::vector<std::int32_t> begins;
  for (int bucket = 0; bucket < window.buckets(); ++bucket) begins.push_back(window.Begin(bucket));
  content.tensors["step"] = TensorOf(store::DType::kI32, begins);
  content.metadata = {{"rows", std::to_string(steps)},
                      {"from", std::to_string(window.from)},
                      {"to", std::to_string(window.to)},
                      {"bucketed", window.bucketed() ? "true" : "false"}};
  return ArraysAnswer(content);
}

// ---- pictures -----------------------------------------------------------------------------------

Result<std::size_t> CameraOf(const store::EpisodeRecord& record, const std::string& name) {
  for (std::size_t i = 0; i < record.episode.cameras.size() && i < record.frames.size(); ++i)
    if (record.episode.cameras[i].camera.name == name) return i;
  return Fail(Code::kNotFound,
              fmt::format("episode {} has no pictures of a camera '{:.60}'", record.episode.index, name));
}

struct Located {
  OpenedEpisode opened;
  std::size_t camera = 0, k = 0;
};

Result<Located> Locate(Context& context, const http::Request& request) {
  Located located;
  ETUDE_ASSIGN_OR_RETURN(located.opened, OpenEpisode(context, request));
  const auto& record = *located.opened.record;
  ETUDE_ASSIGN_OR_RETURN(located.camera, CameraOf(record, request.Parameter("camera")));
  ETUDE_ASSIGN_OR_RETURN(located.k, request.Index("k"));
  const std::size_t frames = record.frames[located.camera].size();
  if (located.k < frames) return located;
  return Fail(Code::kNotFound,
              fmt::format("episode {} has {} pictures, not {}", record.episode.index, frames, located.k + 1));
}

Result<video::Picture> PictureOf(store::FrameReader& frames, const Camera& camera, std::size_t k) {
  ETUDE_ASSIGN_OR_RETURN(const auto rgb, frames.Read(k));
  return video::Picture{camera.width, camera.height, {rgb.begin(), rgb.end()}};
}

Result<video::Picture> PictureAt(const Located& located) {
  const store::EpisodeRecord& record = *located.opened.record;
  store::FrameReader frames(record.path, record.frames[located.camera]);
  return PictureOf(frames, record.episode.cameras[located.camera].camera, located.k);
}

http::Answer Media(const std::vector<std::uint8_t>& bytes, const char* type) {
  return http::BytesAnswer(std::string(bytes.begin(), bytes.end()), type);
}

// Deflated anew: its streams in the file are shared with other frames.
Result<http::Answer> Rgb(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const Located located, Locate(context, request));
  ETUDE_ASSIGN_OR_RETURN(const auto picture, PictureAt(located));
  const auto stream = codec::Deflate(picture.rgb);
  http::Answer answer = http::BytesAnswer(std::string(stream.begin(), stream.end()), "application/octet-stream");
  answer.content_encoding = "deflate";
  return answer;
}

Result<http::Answer> Png(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const Located located, Locate(context, request));
  ETUDE_ASSIGN_OR_RETURN(const auto picture, PictureAt(located));
  ETUDE_ASSIGN_OR_RETURN(const auto bytes, video::EncodePng(picture));
  return Media(bytes, "image/png");
}

Result<http::Answer> Webp(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const Located located, Locate(context, request));
  ETUDE_ASSIGN_OR_RETURN(auto picture, PictureAt(located));
  ETUDE_ASSIGN_OR_RETURN(const auto width, request.query.Integer("w", picture.width, 16, 1024));
  if (width != picture.width) picture = video::Resized(picture, static_cast<int>(width));
  ETUDE_ASSIGN_OR_RETURN(const auto bytes, video::EncodeWebp(picture));
  return Media(bytes, "image/webp");
}

Result<http::Answer> Strip(Context& context, const http::Request& request) {
  constexpr std::size_t kStills = 6;
  constexpr int kHeight = 96;  // px
  ETUDE_ASSIGN_OR_RETURN(const OpenedEpisode opened, OpenEpisode(context, request));
  const auto& record = *opened.record;
  if (record.frames.empty() || record.frames[0].empty())
    return Fail(Code::kNotFound, fmt::format("episode {} has no pictures", record.episode.index));
  const std::size_t frames = record.frames[0].size(), stills = std::min(kStills, frames);
  std::vector<video::Picture> pictures;
  store::FrameReader reader(record.path, record.frames[0]);
  for (std::size_t i = 0; i < stills; ++i) {
    const std::size_t k = stills == 1 ? 0 : i * (frames - 1) / (stills - 1);
    ETUDE_ASSIGN_OR_RETURN(const auto picture, PictureOf(reader, record.episode.cameras[0].camera, k));
    pictures.push_back(video::Resized(picture, std::max(1, picture.width * kHeight / picture.height)));
  }
  ETUDE_ASSIGN_OR_RETURN(const auto bytes, video::EncodeWebp(video::Joined(pictures), 75));
  return Media(bytes, "image/webp");
}

Result<http::Answer> Video(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const OpenedEpisode opened, OpenEpisode(context, request));
  ETUDE_ASSIGN_OR_RETURN(const std::size_t camera, CameraOf(*opened.record, request.Parameter("camera")));
  ETUDE_ASSIGN_OR_RETURN(const Path file, CachedVideo(context.videos, *opened.record, camera));
  ETUDE_ASSIGN_OR_RETURN(auto open, sources::OpenBelow(file.parent_path(), file.filename()));
  http::Answer answer;
  answer.content_type = "video/mp4";
  answer.file = http::FileBody{std::make_shared<Descriptor>(std::move(open.file)), open.stamp.size};
  answer.etag = file.stem().string();
  return answer;
}

}  // namespace

void AddEpisodeRoutes(http::Router& router, Context& context) {
  const auto add = [&](const std::string& path, auto handler) {
    router.Add("GET", kPrefix + "/datasets/{id}/episodes/{n}" + path, http::Lane::kEpisodes,
               [&context, handler](const http::Request& request) { return handler(context, request); });
  };
  add("", EpisodeAnswer);
  add("/tracks", TracksAnswer);
  add("/pictures/{camera}/{k}.rgb", Rgb);
  add("/pictures/{camera}/{k}.png", Png);
  add("/pictures/{camera}/{k}.webp", Webp);
  add("/strip.webp", Strip);
  add("/video/{camera}.mp4", Video);
}

}  // namespace etude::api
