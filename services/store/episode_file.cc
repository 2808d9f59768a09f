// SPDX-License-Identifier: Apache-2.0
#include "services/store/episode_file.h"

#include <fmt/format.h>

#include <algorithm>

#include "services/codec/checksum.h"
#include "services/codec/deflate.h"
#include "services/core/check.h"
#include "services/core/hash.h"
#include "services/episode/action.h"
#include "services/episode/codec.h"
#include "services/episode/tracks.h"
#include "services/store/hdf.h"
#include "services/store/hdf_image.h"

namespace etude::store::internal {
namespace {

constexpr std::string_view kSealBegin = "\nETUDE-SEAL ";
constexpr std::size_t kSeal1Size = 113;

std::string Seal(std::uint32_t crc32, std::uint64_t size) {
  return fmt::format("\nETUDE-SEAL 2 crc32={:08x} bytes={:020}\n", crc32, size);
}

std::string SealOf(std::span<const std::uint8_t> bytes) { return Seal(codec::Crc32(0, bytes), bytes.size()); }

// What was written until a pass of SHA-256 over each file became too slow: still good.
std::string Seal1Of(std::span<const std::uint8_t> bytes) {
  return fmt::format("\nETUDE-SEAL 1 sha256={} bytes={:020}\n", Sha256Hex(bytes), bytes.size());
}

bool EndsWith(std::span<const std::uint8_t> bytes, std::string_view text) {
  return bytes.size() >= text.size() &&
         std::equal(text.begin(), text.end(), bytes.end() - static_cast<std::ptrdiff_t>(text.size()),
                    [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; });
}

// Rows `steps` of a track, each through `change`.
template <class Change>
std::vector<float> Rows(const Track& track, const std::vector<int>& steps, Change change) {
  std::vector<float> values;
  values.reserve(steps.size() * static_cast<std::size_t>(track.columns));
  for (const int t : steps) {
    std::vector<float> row(track.row(t).begin(), track.row(t).end());
    change(row);
    values.insert(values.end(), row.begin(), row.end());
  }
  return values;
}

void ScaleAction(std::vector<float>& row) {
  for (std::size_t i = 0; i < row.size(); ++i) {
    const double middle = 0.5 * (kActionLow[i] + kActionHigh[i]);
    const double half = 0.5 * (kActionHigh[i] - kActionLow[i]);
    row[i] = static_cast<float>(std::clamp((row[i] - middle) / half, -1.0, 1.0));
  }
}

// Writes one episode under its group into a file of either kind, HdfImage or HdfWriter.
template <class File>
class Writer {
 public:
  Writer(const Episode& episode, const StreamSpans& streams, const std::string& content_sha256, File& file)
      : episode_(episode),
        streams_(streams),
        content_sha256_(content_sha256),
        file_(file),
        demo_(DemoGroup(episode.index)) {
    for (int t = 0; t < episode.steps(); t += episode.image_stride) {
      image_steps_.push_back(t);
      action_steps_.push_back(std::min(t + episode.image_stride, episode.steps()) - 1);
    }
  }

  void Write() {
    file_.Group(demo_ + "/obs");
    file_.Group(demo_ + "/control/objects");
    file_.Group(demo_ + "/cameras");
    file_.Attribute("/data", "total", static_cast<std::int64_t>(image_steps_.size()));
    file_.Attribute("/data", "env_args", EnvArgs());
    WriteIdentity();
    WriteMeaning();
    WriteRobomimic();
    WriteObservations();
    WriteControl();
    for (std::size_t i = 0; i < episode_.cameras.size(); ++i) WriteCamera(episode_.cameras[i], streams_[i]);
  }

 private:
  template <class T>
  void Attribute(const char* name, const T& value) {
    file_.Attribute(demo_, name, value);
  }

  void WriteIdentity() {
    Attribute("num_samples", static_cast<std::int64_t>(image_steps_.size()));
    Attribute("schema_version", std::int64_t{kSchemaVersion});
    Attribute("campaign", episode_.campaign);
    Attribute("index", episode_.index);
    Attribute("attempt", std::uint64_t{episode_.attempt});
    Attribute("seed", episode_.seed);
    Attribute("spec_sha256", episode_.spec_sha256);
    Attribute("scene_sha256", episode_.scene_sha256);
    Attribute("content_sha256", content_sha256_);
    Attribute("version", episode_.version);
  }

  void WriteMeaning() {
    Attribute("robot", episode_.robot);
    Attribute("task", episode_.task);
    Attribute("target", episode_.target);
    Attribute("reference", episode_.reference);
    Attribute("instruction", episode_.instruction);
    Attribute("success", static_cast<std::uint8_t>(episode_.success ? 1 : 0));
    Attribute("outcome", episode_.outcome);
    Attribute("details", JsonText(episode_.details));
    Attribute("stage_names", JsonText(episode_.stage_names));
    Attribute("ep_meta", JsonText({{"lang", episode_.instruction}}));
    Attribute("image_stride", std::int64_t{episode_.image_stride});
    Attribute("control_rate_hz", kControlRate);
    OrderedJson objects = OrderedJson::array();
    for (const auto& object : episode_.objects) objects.push_back(object.name);
    Attribute("objects", JsonText(objects));
    OrderedJson cameras = OrderedJson::array();
    for (const auto& track : episode_.cameras) cameras.push_back(track.camera.name);
    Attribute("cameras", JsonText(cameras));
  }

  // one sample an image: what the robot was told until the next image
  void WriteRobomimic() {
    const std::uint64_t n = image_steps_.size();
    const auto keep = [](std::vector<float>&) {};
    file_.Array(demo_ + "/actions", Rows(episode_.actions_abs, action_steps_, ScaleAction), {n, kWaypointSize});
    file_.Array(demo_ + "/actions_abs", Rows(episode_.actions_abs, action_steps_, keep), {n, kWaypointSize});
    file_.Attribute(demo_ + "/actions", "low", std::vector<double>(std::begin(kActionLow), std::end(kActionLow)),
                    {kWaypointSize});
    file_.Attribute(demo_ + "/actions", "high", std::vector<double>(std::begin(kActionHigh), std::end(kActionHigh)),
                    {kWaypointSize});
    file_.Attribute(demo_ + "/actions_abs", "names", kWaypointNames);
    std::vector<float> rewards(n, 0.0f);
    rewards.back() = episode_.success ? 1.0f : 0.0f;
    std::vector<std::int64_t> dones(n, 0);
    dones.back() = 1;
    file_.Array(demo_ + "/rewards", rewards, {n});
    file_.Array(demo_ + "/dones", dones, {n});
    Subsample("/states", episode_.states, keep);
  }

  template <class Change>
  void Subsample(const std::string& name, const Track& track, Change change) {
    file_.Array(demo_ + name, Rows(track, image_steps_, change),
                {image_steps_.size(), static_cast<std::uint64_t>(track.columns)});
  }

  void WriteObservations() {
    const auto keep = [](std::vector<float>&) {};
    const auto to_xyzw = [](std::vector<float>& q) { std::rotate(q.begin(), q.begin() + 1, q.end()); };
    Subsample("/obs/robot0_eef_pos", episode_.eef_pos, keep);
    Subsample("/obs/robot0_eef_quat", episode_.eef_quat, to_xyzw);
    Subsample("/obs/robot0_joint_pos", episode_.joint_pos, keep);
    Subsample("/obs/robot0_joint_vel", episode_.joint_vel, keep);
    Subsample("/obs/robot0_gripper_qpos", episode_.gripper_qpos, keep);
    std::vector<float> objects;
    for (const int t : image_steps_)
      for (const auto& object : episode_.objects)
        objects.insert(objects.end(), object.pose.row(t).begin(), object.pose.row(t).end());
    file_.Array(demo_ + "/obs/object", objects, {image_steps_.size(), 7 * episode_.objects.size()});
  }

  void WriteControl() {
    const auto steps = static_cast<std::uint64_t>(episode_.steps());
    VisitTracks(episode_, [&](const std::string& name, const Track& track, int) {
      file_.Array(demo_ + "/control/" + name, track.values, {steps, static_cast<std::uint64_t>(track.columns)});
    });
    file_.Array(demo_ + "/control/phase", episode_.phase, {steps});
    file_.Array(demo_ + "/control/supervise", episode_.supervise, {steps});
  }

  void WriteCamera(const CameraTrack& track, const std::vector<std::span<const std::uint8_t>>& streams) {
    const Camera& camera = track.camera;
    const std::string group = demo_ + "/cameras/" + camera.name;
    const auto& p = camera.X_WC.p;
    const auto& q = camera.X_WC.q;
    file_.Group(group);
    file_.Attribute(group, "width", std::int64_t{camera.width});
    file_.Attribute(group, "height", std::int64_t{camera.height});
    file_.Attribute(group, "fovy", camera.fovy);
    file_.Attribute(group, "position", std::vector<double>{p.x(), p.y(), p.z()}, {3});
    file_.Attribute(group, "quaternion_wxyz", std::vector<double>{q.w(), q.x(), q.y(), q.z()}, {4});

    // for readers that want matrices: u = K p_C with C as OpenCV's (z forward, y down)
    const double f = camera.focal();
    const Eigen::Matrix3d R = q.toRotationMatrix();
    file_.Array(group + "/intrinsics",
                std::vector<double>{f, 0, 0.5 * camera.width, 0, f, 0.5 * camera.height, 0, 0, 1}, {3, 3});
    std::vector<double> X;
    for (int i = 0; i < 3; ++i) X.insert(X.end(), {R(i, 0), -R(i, 1), -R(i, 2), p[i]});
    X.insert(X.end(), {0, 0, 0, 1});
    file_.Array(group + "/pose", X, {4, 4});
    if (!streams.empty())
      file_.Frames(demo_ + "/obs/" + camera.name + "_image", track.layout(), image_steps_.size(), streams);
  }

  const Episode& episode_;
  const StreamSpans& streams_;
  const std::string& content_sha256_;
  File& file_;
  const std::string demo_;
  std::vector<int> image_steps_;   // control step of each image
  std::vector<int> action_steps_;  // last control step before the next image
};

}  // namespace

std::string DemoName(std::uint64_t index) { return fmt::format("demo_{}", index); }

std::string DemoGroup(std::uint64_t index) { return "/data/" + DemoName(index); }

std::string EnvArgs() {
  return OrderedJson(
             {{"env_name", "etude_tabletop"}, {"env_version", "1"}, {"type", 2}, {"env_kwargs", OrderedJson::object()}})
      .dump();
}

std::string ContentHash(const Episode& episode) { return EpisodeSha256(episode, StreamsOf(episode)); }

Status CheckStreams(const Episode& episode, const StreamSpans& streams, std::uint64_t every) {
  std::vector<std::uint8_t> pixels;
  for (std::size_t i = 0; i < episode.cameras.size(); ++i) {
    const CameraTrack& track = episode.cameras[i];
    pixels.resize(track.layout().stream_bytes());
    for (std::size_t k = 0; k < streams[i].size(); ++k) {
      const auto context = [&] { return fmt::format("camera {} stream {}", track.camera.name, k); };
      // RFC 1950: deflate, and a head that is divisible by 31
      const auto stream = streams[i][k];
      if (stream.size() < 6 || (stream[0] & 0x0F) != 8 || (256 * stream[0] + stream[1]) % 31 != 0)
        return Fail(Code::kCorrupt, context() + ": not a zlib stream");
      const bool asked = k % every == episode.index % every || (k + 1 == streams[i].size() && k < every);
      if (!asked) continue;
      if (Status inflated = codec::Inflate(stream, pixels); !inflated) return Fail(inflated.error().Wrap(context()));
    }
  }
  return {};
}

void AppendSeal(std::vector<std::uint8_t>& bytes) {
  const std::string seal = SealOf(bytes);
  ETUDE_CHECK(seal.size() == kSealSize, "{}", seal.size());
  bytes.insert(bytes.end(), seal.begin(), seal.end());
}

Result<std::span<const std::uint8_t>> CheckSeal(std::span<const std::uint8_t> bytes) {
  if (bytes.size() <= kSeal1Size) return Fail(Code::kCorrupt, fmt::format("only {} bytes", bytes.size()));
  bool sealed = false;
  for (const auto& [size, seal_of] : {std::pair{kSealSize, &SealOf}, {kSeal1Size, &Seal1Of}}) {
    if (!EndsWith(bytes.first(bytes.size() - size + kSealBegin.size()), kSealBegin)) continue;
    sealed = true;
    const auto content = bytes.first(bytes.size() - size);
    if (EndsWith(bytes, seal_of(content))) return content;
  }
  if (!sealed) return Fail(Code::kCorrupt, "no seal at its end: cut off, or not written by Etude");
  return Fail(Code::kCorrupt, "changed after it was written: checksum or size differ from the seal's");
}

std::vector<std::span<const std::uint8_t>> EpisodeFileParts::pieces() const {
  std::vector<std::span<const std::uint8_t>> pieces{head};
  pieces.insert(pieces.end(), streams.begin(), streams.end());
  pieces.emplace_back(reinterpret_cast<const std::uint8_t*>(seal.data()), seal.size());
  return pieces;
}

std::uint64_t EpisodeFileParts::size() const {
  std::uint64_t size = head.size() + seal.size();
  for (const auto stream : streams) size += stream.size();
  return size;
}

Result<EpisodeFileParts> LayOutEpisodeFile(const Episode& episode, const StreamSpans& streams,
                                           const std::string& content_sha256) {
  HdfImage file;
  Writer(episode, streams, content_sha256, file).Write();
  ETUDE_ASSIGN_OR_RETURN(auto image, file.Finish());
  EpisodeFileParts parts{std::move(image.head), std::move(image.streams), ""};
  const std::uint64_t size = parts.size();
  std::uint32_t crc32 = codec::Crc32(0, parts.head);
  for (const auto stream : parts.streams) crc32 = codec::Crc32(crc32, stream);
  parts.seal = Seal(crc32, size);
  return parts;
}

Result<std::vector<std::uint8_t>> EncodeEpisodeFile(const Episode& episode) {
  ETUDE_RETURN_IF_ERROR(ValidateEpisode(episode));
  const StreamSpans streams = StreamsOf(episode);
  if (Status good = CheckStreams(episode, streams); !good) return Fail(Code::kInvalidArgument, good.error().message);
  ETUDE_ASSIGN_OR_RETURN(const auto parts, LayOutEpisodeFile(episode, streams, ContentHash(episode)));
  std::vector<std::uint8_t> bytes;
  bytes.reserve(parts.size());
  for (const auto piece : parts.pieces()) bytes.insert(bytes.end(), piece.begin(), piece.end());
  return bytes;
}

Result<std::vector<std::uint8_t>> EncodeByLibrary(const Episode& episode) {
  const StreamSpans streams = StreamsOf(episode);
  const std::string content_sha256 = ContentHash(episode);
  HdfWriter file;  // HDF5 is locked from here on
  Writer(episode, streams, content_sha256, file).Write();
  return file.Finish();
}

}  // namespace etude::store::internal
