// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>

#include "services/episode/bounded_json.h"
#include "services/episode/codec.h"
#include "services/episode/tracks.h"
#include "services/store/episode_file.h"
#include "services/store/hdf_view.h"

namespace etude::store::internal {
namespace {

constexpr std::size_t kMaxJson = 8u << 20;

// Schema 1 had x, y, z, roll, pitch, yaw (rxyz), gripper. Rows of another width are left for ValidateEpisode.
void ConvertEulerActions(Track& actions) {
  if (actions.columns != 7) return;
  Track converted{.columns = kWaypointSize};
  for (int t = 0; t < actions.rows(); ++t) {
    const auto row = actions.row(t);
    converted.Push(ToVector({{{row[0], row[1], row[2]}, FromEuler({row[3], row[4], row[5]})}, row[6]}));
  }
  actions = std::move(converted);
}

// Reads what Writer wrote; the file's own problems stay in the HdfView, those of content in
// `error_`.
class Reader {
 public:
  explicit Reader(HdfView& file) : file_(file) {}

  EpisodeFile Read() {
    const auto demos = file_.Children("/data");
    if (demos.size() != 1) Complain("not one episode under /data");
    demo_ = demos.size() == 1 ? "/data/" + demos[0] : "/data";
    ReadIdentity();
    ReadMeaning();
    ReadControl();
    for (const auto& name : Names("cameras", kMaxCameras)) ReadCamera(name);
    if (error_.empty() && demo_ != DemoGroup(result_.episode.index)) Complain("index and group differ");
    return std::move(result_);
  }

  const std::string& error() const { return error_; }

 private:
  void Complain(std::string what) {
    if (error_.empty()) error_ = std::move(what);
  }
  std::string Text(const char* name) { return file_.Text(demo_, name); }

  OrderedJson JsonText(const char* name) {
    const std::string text = Text(name);
    auto json = text.size() <= kMaxJson ? ParseBoundedJson(text) : std::nullopt;
    if (!json) Complain(fmt::format("attribute {}: not JSON", name));
    return json.value_or(OrderedJson());
  }

  std::vector<std::string> Names(const char* name, std::size_t max_size) {
    const OrderedJson json = JsonText(name);
    std::vector<std::string> names;
    if (!json.is_array() || json.size() > max_size)
      Complain(fmt::format("attribute {}: not a list", name));
    else
      for (const auto& item : json) {
        if (item.is_string())
          names.push_back(item.get<std::string>());
        else
          Complain(fmt::format("attribute {}: not texts", name));
      }
    return names;
  }

  void ReadIdentity() {
    Episode& episode = result_.episode;
    const auto schema = file_.Scalar<std::int64_t>(demo_, "schema_version");
    if (schema < kOldestSchema || schema > kSchemaVersion)
      Complain(fmt::format("schema version {}, not {} to {}", schema, kOldestSchema, kSchemaVersion));
    result_.schema_version = static_cast<int>(schema);
    const auto attempt = file_.Scalar<std::uint64_t>(demo_, "attempt");
    if (attempt > UINT32_MAX) Complain("attribute attempt: too large");
    episode.campaign = Text("campaign");
    episode.index = file_.Scalar<std::uint64_t>(demo_, "index");
    episode.attempt = static_cast<std::uint32_t>(attempt);
    episode.seed = file_.Scalar<std::uint64_t>(demo_, "seed");
    episode.spec_sha256 = Text("spec_sha256");
    episode.scene_sha256 = Text("scene_sha256");
    result_.content_sha256 = Text("content_sha256");
    episode.version = Text("version");
  }

  void ReadMeaning() {
    Episode& episode = result_.episode;
    episode.robot = Text("robot");
    episode.task = Text("task");
    episode.target = Text("target");
    episode.reference = Text("reference");
    episode.instruction = Text("instruction");
    episode.success = file_.Scalar<std::uint8_t>(demo_, "success") != 0;
    episode.outcome = Text("outcome");
    episode.details = JsonText("details");
    episode.stage_names = Names("stage_names", 255);
    const auto stride = file_.Scalar<std::int64_t>(demo_, "image_stride");
    if (stride < 1 || stride > 1000) Complain("attribute image_stride: not in 1..1000");
    episode.image_stride = static_cast<int>(stride);
    for (const auto& name : Names("objects", kMaxObjects)) {
      if (!IsPlainName(name)) Complain("attribute objects: a name is not plain");
      episode.objects.emplace_back().name = name;
    }
  }

  void ReadControl() {
    Episode& episode = result_.episode;
    if (!error_.empty()) return;
    Shape shape;
    VisitTracks(episode, [&](const std::string& name, Track& track, int) {
      track.values = file_.Array<float>(demo_ + "/control/" + name, 2, shape);
      track.columns = static_cast<int>(std::min<std::uint64_t>(shape[1], INT32_MAX));
    });
    if (result_.schema_version == 1) ConvertEulerActions(episode.actions_abs);
    episode.phase = file_.Array<std::uint8_t>(demo_ + "/control/phase", 1, shape);
    episode.supervise = file_.Array<std::uint8_t>(demo_ + "/control/supervise", 1, shape);
  }

  void ReadCamera(const std::string& name) {
    if (!IsPlainName(name)) Complain("attribute cameras: a name is not plain");
    if (!error_.empty()) return;
    CameraTrack& track = result_.episode.cameras.emplace_back();
    Camera& camera = track.camera;
    const std::string group = demo_ + "/cameras/" + name;
    const auto side = [&](const char* attribute) {
      return static_cast<int>(std::clamp<std::int64_t>(file_.Scalar<std::int64_t>(group, attribute), 0, INT32_MAX));
    };
    camera.name = name;
    camera.width = side("width");
    camera.height = side("height");
    camera.fovy = file_.Scalar<double>(group, "fovy");
    const auto p = file_.Vector<double>(group, "position", 3);
    const auto q = file_.Vector<double>(group, "quaternion_wxyz", 4);
    camera.X_WC.p = {p[0], p[1], p[2]};
    camera.X_WC.q = Eigen::Quaterniond(q[0], q[1], q[2], q[3]);
    ReadFrames(track);
  }

  void ReadFrames(CameraTrack& track) {
    auto& frames = result_.frames.emplace_back();
    const std::string image = track.camera.name + "_image";
    const auto names = file_.Children(demo_ + "/obs");
    if (std::find(names.begin(), names.end(), image) == names.end()) return;  // recorded without pictures
    frames = file_.Frames(demo_ + "/obs/" + image);
    track.chunk = frames.layout.chunk;
    const auto count = FrameCount(result_.episode.steps(), result_.episode.image_stride);
    if (frames.count != static_cast<std::size_t>(count) || frames.layout.width != track.camera.width ||
        frames.layout.height != track.camera.height)
      Complain(fmt::format("frames {}: shape does not fit steps and camera", image));
  }

  HdfView& file_;
  std::string demo_;
  std::string error_;
  EpisodeFile result_;
};

}  // namespace

Result<EpisodeFile> DecodeEpisodeFile(std::span<const std::uint8_t> bytes) {
  ETUDE_ASSIGN_OR_RETURN(const auto content, CheckSeal(bytes));
  HdfView file(content);
  Reader reader(file);
  EpisodeFile result = reader.Read();
  ETUDE_RETURN_IF_ERROR(file.Finish());
  if (!reader.error().empty()) return Fail(Code::kCorrupt, reader.error());
  if (Status valid = ValidateEpisode(result.episode); !valid) return Fail(Code::kCorrupt, valid.error().message);
  return result;
}

StreamSpans StreamsIn(const EpisodeFile& file, std::span<const std::uint8_t> bytes) {
  StreamSpans streams(file.frames.size());
  for (std::size_t c = 0; c < file.frames.size(); ++c)
    for (const auto& location : file.frames[c].streams)
      streams[c].push_back(bytes.subspan(location.offset, location.size));
  return streams;
}

Episode WithStreams(EpisodeFile file, std::span<const std::uint8_t> bytes) {
  const StreamSpans streams = StreamsIn(file, bytes);
  for (std::size_t c = 0; c < streams.size(); ++c)
    for (const auto stream : streams[c]) file.episode.cameras[c].streams.emplace_back(stream.begin(), stream.end());
  return std::move(file.episode);
}

}  // namespace etude::store::internal
