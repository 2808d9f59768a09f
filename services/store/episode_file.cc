// SPDX-License-Identifier: Apache-2.0
#include "services/store/episode_file.h"

#include <fmt/format.h>

#include <algorithm>

#include "services/codec/frame.h"
#include "services/core/check.h"
#include "services/core/hash.h"
#include "services/episode/action.h"
#include "services/episode/codec.h"
#include "services/episode/tracks.h"
#include "services/store/hdf.h"

namespace etude::store::internal {
namespace {

constexpr std::size_t kSealSize = 113;

std::string Seal(std::span<const std::uint8_t> bytes) {
  return fmt::format("\nETUDE-SEAL 1 sha256={} bytes={:020}\n", Sha256Hex(bytes), bytes.size());
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

// Writes one episode under its group.
class Writer {
 public:
  Writer(const Episode& episode, const std::string& content_sha256, HdfWriter& file)
      : episode_(episode), content_sha256_(content_sha256), file_(file), demo_(DemoGroup(episode.index)) {
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
    for (const auto& camera : episode_.cameras) WriteCamera(camera);
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
    Attribute("details", Text(episode_.details));
    Attribute("stage_names", Text(episode_.stage_names));
    Attribute("ep_meta", Text({{"lang", episode_.instruction}}));
    Attribute("image_stride", std::int64_t{episode_.image_stride});
    Attribute("control_rate_hz", kControlRate);
    OrderedJson objects = OrderedJson::array();
    for (const auto& object : episode_.objects) objects.push_back(object.name);
    Attribute("objects", Text(objects));
    OrderedJson cameras = OrderedJson::array();
    for (const auto& track : episode_.cameras) cameras.push_back(track.camera.name);
    Attribute("cameras", Text(cameras));
  }

  static std::string Text(const OrderedJson& json) {
    return json.dump(-1, ' ', false, OrderedJson::error_handler_t::replace);
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

  void WriteCamera(const CameraTrack& track) {
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
    if (!track.frames.empty())
      file_.Frames(demo_ + "/obs/" + camera.name + "_image", camera.height, camera.width, track.frames);
  }

  const Episode& episode_;
  const std::string& content_sha256_;
  HdfWriter& file_;
  const std::string demo_;
  std::vector<int> image_steps_;   // control step of each image
  std::vector<int> action_steps_;  // last control step before the next image
};

}  // namespace

std::string DemoGroup(std::uint64_t index) { return fmt::format("/data/demo_{}", index); }

std::string EnvArgs() {
  return OrderedJson(
             {{"env_name", "etude_tabletop"}, {"env_version", "1"}, {"type", 2}, {"env_kwargs", OrderedJson::object()}})
      .dump();
}

std::string ContentHash(const Episode& episode) { return Sha256Hex(EncodeEpisode(episode)); }

Status CheckFrames(const Episode& episode) {
  std::vector<std::uint8_t> pixels;
  for (const auto& track : episode.cameras) {
    pixels.resize(3ull * track.camera.width * track.camera.height);
    for (std::size_t k = 0; k < track.frames.size(); ++k)
      if (Status inflated = codec::InflateFrame(track.frames[k], pixels); !inflated)
        return Fail(inflated.error().Wrap(fmt::format("camera {} frame {}", track.camera.name, k)));
  }
  return {};
}

void AppendSeal(std::vector<std::uint8_t>& bytes) {
  const std::string seal = Seal(bytes);
  ETUDE_CHECK(seal.size() == kSealSize, "{}", seal.size());
  bytes.insert(bytes.end(), seal.begin(), seal.end());
}

Result<std::span<const std::uint8_t>> CheckSeal(std::span<const std::uint8_t> bytes) {
  if (bytes.size() <= kSealSize) return Fail(Code::kCorrupt, fmt::format("only {} bytes", bytes.size()));
  const auto content = bytes.first(bytes.size() - kSealSize);
  const auto seal = bytes.last(kSealSize);
  if (!std::equal(seal.begin(), seal.begin() + 12, "\nETUDE-SEAL "))
    return Fail(Code::kCorrupt, "no seal at its end: cut off, or not written by Etude");
  const std::string expected = Seal(content);
  if (!std::equal(seal.begin(), seal.end(), expected.begin(), expected.end()))
    return Fail(Code::kCorrupt, "changed after it was written: SHA-256 or size differ from the seal's");
  return content;
}

Result<std::vector<std::uint8_t>> EncodeEpisodeFile(const Episode& episode) {
  ETUDE_RETURN_IF_ERROR(ValidateEpisode(episode));
  if (Status frames = CheckFrames(episode); !frames) return Fail(Code::kInvalidArgument, frames.error().message);
  const std::string content_sha256 = ContentHash(episode);
  const auto build = [&] {  // HDF5 is locked in here only
    HdfWriter file;
    Writer(episode, content_sha256, file).Write();
    return file.Finish();
  };
  ETUDE_ASSIGN_OR_RETURN(auto bytes, build());
  AppendSeal(bytes);
  return bytes;
}

}  // namespace etude::store::internal
