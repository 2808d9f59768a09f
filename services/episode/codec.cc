// SPDX-License-Identifier: Apache-2.0
#include "services/episode/codec.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#include "services/core/hash.h"
#include "services/episode/bounded_json.h"
#include "services/episode/tracks.h"

namespace etude {
namespace {

static_assert(std::endian::native == std::endian::little, "blobs are copied as they lie in memory");

constexpr std::string_view kMagic = "ETUDEEP1";
constexpr std::size_t kPrefix = 12;  // magic and header size
constexpr std::uint32_t kMaxHeader = 8u << 20;
// 1: actions_abs had Euler angles; 2: a frame was a stream, and episodes that have them so are still written so
constexpr int kFormat = 3, kWholeFrames = 2;

using Bytes = std::span<const std::uint8_t>;

// ---------------------------------------------------------------------------------------- encode

// Collects arrays: their entries for the header and their bytes for later.
struct ArrayList {
  OrderedJson entries = OrderedJson::array();
  std::vector<Bytes> blobs;
  std::size_t size = 0;

  void Add(const std::string& name, const char* dtype, OrderedJson shape, Bytes bytes) {
    entries.push_back(
        {{"name", name}, {"dtype", dtype}, {"shape", std::move(shape)}, {"offset", size}, {"size", bytes.size()}});
    blobs.push_back(bytes);
    size += bytes.size();
  }
};

// Of what was not recorded no file keeps a shape.
codec::FrameLayout LayoutOf(const CameraTrack& track, const std::vector<Bytes>& streams) {
  return {track.camera.width, track.camera.height, streams.empty() ? codec::ChunkShape{} : track.chunk};
}

bool HasWholeFrames(const Episode& episode, const StreamSpans& streams) {
  for (std::size_t i = 0; i < episode.cameras.size(); ++i)
    if (!LayoutOf(episode.cameras[i], streams[i]).whole()) return false;
  return true;
}

OrderedJson CameraHeader(const CameraTrack& track, const std::vector<Bytes>& streams, bool whole_frames) {
  const Camera& camera = track.camera;
  const auto& p = camera.X_WC.p;
  const auto& q = camera.X_WC.q;
  OrderedJson json = {{"name", camera.name},
                      {"width", camera.width},
                      {"height", camera.height},
                      {"fovy", camera.fovy},
                      {"position", {p.x(), p.y(), p.z()}},
                      {"quaternion", {q.w(), q.x(), q.y(), q.z()}}};
  const codec::FrameLayout layout = LayoutOf(track, streams);
  if (!whole_frames) json["chunk"] = {layout.chunk.frames, layout.rows()};
  auto& sizes = json[whole_frames ? "frames" : "streams"] = OrderedJson::array();
  for (const Bytes stream : streams) sizes.push_back(stream.size());
  return json;
}

OrderedJson Header(const Episode& episode, const StreamSpans& streams) {
  const bool whole_frames = HasWholeFrames(episode, streams);
  OrderedJson json = {{"format", whole_frames ? kWholeFrames : kFormat},
                      {"campaign", episode.campaign},
                      {"index", episode.index},
                      {"attempt", episode.attempt},
                      {"seed", episode.seed},
                      {"spec_sha256", episode.spec_sha256},
                      {"scene_sha256", episode.scene_sha256},
                      {"version", episode.version},
                      {"robot", episode.robot},
                      {"task", episode.task},
                      {"target", episode.target},
                      {"reference", episode.reference},
                      {"instruction", episode.instruction},
                      {"success", episode.success},
                      {"outcome", episode.outcome},
                      {"details", episode.details},
                      {"stage_names", episode.stage_names},
                      {"image_stride", episode.image_stride}};
  json["objects"] = OrderedJson::array();
  for (const auto& object : episode.objects) json["objects"].push_back(object.name);
  json["cameras"] = OrderedJson::array();
  for (std::size_t i = 0; i < episode.cameras.size(); ++i)
    json["cameras"].push_back(CameraHeader(episode.cameras[i], streams[i], whole_frames));
  return json;
}

Bytes BytesOf(const std::vector<float>& values) {
  return {reinterpret_cast<const std::uint8_t*>(values.data()), values.size() * sizeof(float)};
}

ArrayList ArraysOf(const Episode& episode) {
  ArrayList arrays;
  VisitTracks(episode, [&](const std::string& name, const Track& track, int) {
    arrays.Add(name, "f32", {track.rows(), track.columns}, BytesOf(track.values));
  });
  arrays.Add("phase", "u8", {episode.phase.size()}, episode.phase);
  arrays.Add("supervise", "u8", {episode.supervise.size()}, episode.supervise);
  return arrays;
}

std::string HeaderText(const Episode& episode, const StreamSpans& streams, OrderedJson array_entries) {
  OrderedJson json = Header(episode, streams);
  json["arrays"] = std::move(array_entries);
  return JsonText(json);
}

// ---------------------------------------------------------------------------------------- decode

// Reads typed fields of a JSON map; the first problem stays in `error`, later reads give defaults.
class FieldReader {
 public:
  FieldReader(const OrderedJson& json, std::string& error) : json_(json), error_(error) {
    if (!json.is_object()) Complain("map");
  }

  const OrderedJson& Get(const char* key) const {
    static const OrderedJson missing;
    if (!json_.is_object()) return missing;
    const auto it = json_.find(key);
    return it == json_.end() ? missing : *it;
  }
  std::string Text(const char* key) {
    const auto& value = Get(key);
    if (value.is_string()) return value.get<std::string>();
    Complain(key);
    return {};
  }
  std::uint64_t Unsigned(const char* key, std::uint64_t max = UINT64_MAX) {
    const auto& value = Get(key);
    if (value.is_number_unsigned() && value.get<std::uint64_t>() <= max) return value.get<std::uint64_t>();
    Complain(key);
    return 0;
  }
  double Number(const OrderedJson& value, const char* key) {
    if (value.is_number() && std::isfinite(value.get<double>())) return value.get<double>();
    Complain(key);
    return 0;
  }
  bool Flag(const char* key) {
    const auto& value = Get(key);
    if (value.is_boolean()) return value.get<bool>();
    Complain(key);
    return false;
  }
  const OrderedJson& List(const char* key, std::size_t max_items) {
    static const OrderedJson empty = OrderedJson::array();
    const auto& value = Get(key);
    if (value.is_array() && value.size() <= max_items) return value;
    Complain(key);
    return empty;
  }
  std::vector<std::string> Texts(const char* key, std::size_t max_items) {
    std::vector<std::string> texts;
    for (const auto& item : List(key, max_items)) {
      if (!item.is_string())
        Complain(key);
      else
        texts.push_back(item.get<std::string>());
    }
    return texts;
  }
  template <std::size_t N>
  std::array<double, N> Numbers(const char* key) {
    std::array<double, N> numbers{};
    const auto& list = List(key, N);
    if (list.size() != N)
      Complain(key);
    else
      for (std::size_t i = 0; i < N; ++i) numbers[i] = Number(list[i], key);
    return numbers;
  }
  void Complain(const char* key) {
    if (error_.empty()) error_ = fmt::format("header: '{}' is missing or not as it should be", key);
  }

 private:
  const OrderedJson& json_;
  std::string& error_;
};

// Takes blobs from the front of what is left; nothing is allocated before its size is known to fit.
class BlobReader {
 public:
  BlobReader(const OrderedJson& entries, Bytes blobs, std::string& error)
      : entries_(entries), left_(blobs), total_(blobs.size()), error_(error) {}

  // The next entry, which must be called `name` and lie where the one before ended. `rank` 2 gives
  // its number of columns.
  Bytes Next(const std::string& name, const char* dtype, std::size_t rank, std::uint64_t& columns) {
    if (!error_.empty()) return {};
    static const OrderedJson none;
    FieldReader entry(next_ < entries_.size() ? entries_[next_] : none, error_);
    ++next_;
    const std::string entry_name = entry.Text("name");
    const std::string entry_dtype = entry.Text("dtype");
    const std::uint64_t offset = entry.Unsigned("offset");
    const std::uint64_t size = entry.Unsigned("size");
    const auto& shape = entry.List("shape", rank);
    if (!error_.empty()) return {};
    std::uint64_t expected = dtype == std::string_view("f32") ? 4 : 1;
    bool good = entry_name == name && entry_dtype == dtype && offset == total_ - left_.size() && shape.size() == rank;
    for (const auto& extent : shape) {
      good = good && extent.is_number_unsigned() &&
             !__builtin_mul_overflow(expected, extent.get<std::uint64_t>(), &expected);
      if (good) columns = extent.get<std::uint64_t>();
    }
    if (!good || expected != size || size > left_.size()) {
      error_ = fmt::format("array '{}': entry '{}' does not fit", name, entry_name);
      return {};
    }
    return Take(size);
  }

  Bytes Take(std::uint64_t size) {
    if (!error_.empty()) return {};
    if (size > left_.size()) {
      error_ = fmt::format("a stream of {} bytes, {} are left", size, left_.size());
      return {};
    }
    const Bytes blob = left_.first(size);
    left_ = left_.subspan(size);
    return blob;
  }

  void Finish() {
    if (!error_.empty()) return;
    if (next_ != entries_.size())
      error_ = "more arrays than expected";
    else if (!left_.empty())
      error_ = fmt::format("{} bytes after the last blob", left_.size());
  }

 private:
  const OrderedJson& entries_;
  Bytes left_;
  std::size_t total_;
  std::size_t next_ = 0;
  std::string& error_;
};

void ReadScalars(FieldReader& header, Episode& episode) {
  episode.campaign = header.Text("campaign");
  episode.index = header.Unsigned("index");
  episode.attempt = static_cast<std::uint32_t>(header.Unsigned("attempt", UINT32_MAX));
  episode.seed = header.Unsigned("seed");
  episode.spec_sha256 = header.Text("spec_sha256");
  episode.scene_sha256 = header.Text("scene_sha256");
  episode.version = header.Text("version");
  episode.robot = header.Text("robot");
  episode.task = header.Text("task");
  episode.target = header.Text("target");
  episode.reference = header.Text("reference");
  episode.instruction = header.Text("instruction");
  episode.success = header.Flag("success");
  episode.outcome = header.Text("outcome");
  episode.details = header.Get("details");
  episode.stage_names = header.Texts("stage_names", 255);
  episode.image_stride = static_cast<int>(header.Unsigned("image_stride", 1000));
  for (auto& name : header.Texts("objects", kMaxObjects)) episode.objects.emplace_back().name = std::move(name);
}

void ReadCamera(const OrderedJson& json, bool whole_frames, CameraTrack& track, std::string& error) {
  FieldReader fields(json, error);
  Camera& camera = track.camera;
  camera.name = fields.Text("name");
  camera.width = static_cast<int>(fields.Unsigned("width", kMaxImageSide));
  camera.height = static_cast<int>(fields.Unsigned("height", kMaxImageSide));
  camera.fovy = fields.Number(fields.Get("fovy"), "fovy");
  const auto p = fields.Numbers<3>("position");
  const auto q = fields.Numbers<4>("quaternion");
  camera.X_WC.p = {p[0], p[1], p[2]};
  camera.X_WC.q = Eigen::Quaterniond(q[0], q[1], q[2], q[3]);
  if (whole_frames) return;
  const auto chunk = fields.Numbers<2>("chunk");
  for (const double extent : chunk)
    if (!(extent >= 1 && extent <= kMaxImageSide && extent == std::floor(extent))) fields.Complain("chunk");
  if (error.empty()) track.chunk = {static_cast<int>(chunk[0]), static_cast<int>(chunk[1])};
}

void ReadTracks(BlobReader& blobs, Episode& episode) {
  VisitTracks(episode, [&](const std::string& name, Track& track, int) {
    std::uint64_t columns = 0;
    const Bytes bytes = blobs.Next(name, "f32", 2, columns);
    track.columns = static_cast<int>(std::min<std::uint64_t>(columns, INT32_MAX));
    track.values.resize(bytes.size() / sizeof(float));
    if (!bytes.empty()) std::memcpy(track.values.data(), bytes.data(), bytes.size());
  });
  std::uint64_t ignored = 0;
  const Bytes phase = blobs.Next("phase", "u8", 1, ignored);
  episode.phase.assign(phase.begin(), phase.end());
  const Bytes supervise = blobs.Next("supervise", "u8", 1, ignored);
  episode.supervise.assign(supervise.begin(), supervise.end());
}

void ReadStreams(const OrderedJson& camera, bool whole_frames, BlobReader& blobs, std::vector<Bytes>& streams,
                 std::string& error) {
  const char* const key = whole_frames ? "frames" : "streams";
  FieldReader fields(camera, error);
  for (const auto& size : fields.List(key, kMaxStreams)) {
    if (!size.is_number_unsigned()) fields.Complain(key);
    const Bytes stream = error.empty() ? blobs.Take(size.get<std::uint64_t>()) : Bytes{};
    if (!error.empty()) return;
    streams.push_back(stream);
  }
}

Result<OrderedJson> ReadHeader(Bytes bytes, std::size_t& header_end) {
  std::uint32_t header_size = 0;
  if (bytes.size() < kPrefix || std::memcmp(bytes.data(), kMagic.data(), kMagic.size()) != 0)
    return Fail(Code::kCorrupt, "episode: these bytes do not start as an episode does");
  std::memcpy(&header_size, bytes.data() + kMagic.size(), sizeof(header_size));
  if (header_size > kMaxHeader || header_size > bytes.size() - kPrefix)
    return Fail(Code::kCorrupt, fmt::format("episode: header of {} bytes in {}", header_size, bytes.size()));
  header_end = kPrefix + header_size;
  auto json = ParseBoundedJson({reinterpret_cast<const char*>(bytes.data()) + kPrefix, header_size});
  if (!json || !json->is_object()) return Fail(Code::kCorrupt, "episode: the header is not a JSON map");
  return std::move(*json);
}

}  // namespace

StreamSpans StreamsOf(const Episode& episode) {
  StreamSpans streams;
  for (const auto& track : episode.cameras) streams.emplace_back(track.streams.begin(), track.streams.end());
  return streams;
}

std::vector<std::uint8_t> EncodeEpisode(const Episode& episode) {
  ArrayList arrays = ArraysOf(episode);
  const std::string header = HeaderText(episode, StreamsOf(episode), std::move(arrays.entries));
  const auto header_size = static_cast<std::uint32_t>(header.size());

  std::size_t total = kPrefix + header.size() + arrays.size;
  for (const auto& track : episode.cameras)
    for (const auto& stream : track.streams) total += stream.size();
  std::vector<std::uint8_t> bytes(total);
  std::uint8_t* cursor = bytes.data();
  const auto append = [&](const void* data, std::size_t size) {
    if (size > 0) std::memcpy(cursor, data, size);
    cursor += size;
  };
  append(kMagic.data(), kMagic.size());
  append(&header_size, sizeof(header_size));
  append(header.data(), header.size());
  for (const Bytes blob : arrays.blobs) append(blob.data(), blob.size());
  for (const auto& track : episode.cameras)
    for (const auto& stream : track.streams) append(stream.data(), stream.size());
  return bytes;
}

// As EncodeEpisode lays them out.
std::string EpisodeSha256(const Episode& episode, const StreamSpans& streams) {
  ArrayList arrays = ArraysOf(episode);
  const std::string header = HeaderText(episode, streams, std::move(arrays.entries));
  const auto header_size = static_cast<std::uint32_t>(header.size());
  Sha256 hash;
  hash.Update(kMagic);
  hash.Update(Bytes(reinterpret_cast<const std::uint8_t*>(&header_size), sizeof(header_size)));
  hash.Update(header);
  for (const Bytes blob : arrays.blobs) hash.Update(blob);
  for (const auto& camera : streams)
    for (const Bytes stream : camera) hash.Update(stream);
  return ToHex(hash.Finish());
}

namespace {

// The streams stay in `bytes`; nothing is validated beyond what the bytes themselves say.
Result<EpisodeView> ReadView(Bytes bytes, std::size_t& header_end) {
  ETUDE_ASSIGN_OR_RETURN(const OrderedJson json, ReadHeader(bytes, header_end));
  std::string error;
  EpisodeView view;
  Episode& episode = view.episode;
  FieldReader header(json, error);
  const std::uint64_t format = header.Unsigned("format");
  if (format != kFormat && format != kWholeFrames) header.Complain("format");
  const bool whole_frames = format == kWholeFrames;
  ReadScalars(header, episode);
  const auto& cameras = header.List("cameras", kMaxCameras);
  for (const auto& camera : cameras) ReadCamera(camera, whole_frames, episode.cameras.emplace_back(), error);

  BlobReader blobs(header.List("arrays", 16 + 2 * kMaxObjects), bytes.subspan(header_end), error);
  ReadTracks(blobs, episode);
  view.streams.resize(episode.cameras.size());
  for (std::size_t i = 0; i < episode.cameras.size(); ++i)
    ReadStreams(cameras[i], whole_frames, blobs, view.streams[i], error);
  blobs.Finish();
  if (!error.empty()) return Fail(Code::kCorrupt, "episode: " + error);
  return view;
}

Status Corrupt(const Status& invalid) { return Fail(Code::kCorrupt, "episode: " + invalid.error().message); }

}  // namespace

Result<Episode> DecodeEpisode(std::span<const std::uint8_t> bytes) {
  std::size_t header_end = 0;
  ETUDE_ASSIGN_OR_RETURN(EpisodeView view, ReadView(bytes, header_end));
  for (std::size_t i = 0; i < view.streams.size(); ++i)
    for (const Bytes stream : view.streams[i])
      view.episode.cameras[i].streams.emplace_back(stream.begin(), stream.end());
  if (Status valid = ValidateEpisode(view.episode); !valid) return Fail(Corrupt(valid).error());
  return std::move(view.episode);
}

Result<EpisodeView> ViewEpisode(std::span<const std::uint8_t> bytes) {
  std::size_t header_end = 0;
  ETUDE_ASSIGN_OR_RETURN(EpisodeView view, ReadView(bytes, header_end));
  if (Status valid = ValidateEpisode(view.episode); !valid) return Fail(Corrupt(valid).error());
  for (std::size_t i = 0; i < view.streams.size(); ++i)
    if (Status valid = ValidateStreams(view.episode, i, view.streams[i]); !valid) return Fail(Corrupt(valid).error());
  // arrays and streams lie as they must, or reading them had failed: what is left free is the header's text
  const std::string text = HeaderText(view.episode, view.streams, ArraysOf(view.episode).entries);
  const auto header = bytes.subspan(kPrefix, header_end - kPrefix);
  if (!std::equal(header.begin(), header.end(), text.begin(), text.end(),
                  [](std::uint8_t a, char b) { return a == static_cast<std::uint8_t>(b); }))
    return Fail(Code::kCorrupt, "episode: its header is not written as this program writes it");
  return view;
}

}  // namespace etude
