// SPDX-License-Identifier: Apache-2.0
#include "services/store/commit_journal.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <fstream>
#include <limits>
#include <vector>

#include "services/core/descriptor.h"
#include "services/core/growing_file.h"
#include "services/core/log.h"
#include "services/episode/action.h"
#include "services/episode/bounded_json.h"
#include "services/episode/codec.h"
#include "services/store/layout.h"

namespace etude::store {
namespace {

constexpr std::size_t kLongestLine = 64 << 10;  // a line that is longer is none of ours
constexpr int kDeepestLine = 4;                 // levels of JSON
constexpr int kJerkStride = 5;  // control steps: closer, the floats' last bits would be what is measured

double ToMilliseconds(double seconds) { return std::round(seconds * 1000) / 1000; }

double PathLength(const Track& position) {
  double sum = 0;
  for (int t = 1; t < position.rows(); ++t) {
    const auto a = position.row(t - 1), b = position.row(t);
    sum += std::hypot(double{b[0]} - a[0], double{b[1]} - a[1], double{b[2]} - a[2]);
  }
  return sum;
}

double Jerk(const Track& position) {
  const double h = kJerkStride / kControlRate;
  double sum = 0;
  int count = 0;
  for (int t = 0; t + 3 * kJerkStride < position.rows(); t += kJerkStride, ++count) {
    const auto a = position.row(t), b = position.row(t + kJerkStride), c = position.row(t + 2 * kJerkStride),
               d = position.row(t + 3 * kJerkStride);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double third = (double{d[axis]} - 3.0 * c[axis] + 3.0 * b[axis] - a[axis]) / (h * h * h);
      sum += third * third;
    }
  }
  return count == 0 ? 0 : std::sqrt(sum / count);
}

double LargestSpeed(const Track& joints) {
  double speed = 0;
  for (const float value : joints.values) speed = std::max(speed, std::abs(double{value}));
  return speed;
}

std::optional<std::array<double, 2>> PlaceOf(const Episode& episode) {
  const auto* target = episode.FindObject(episode.target);
  if (!target || target->pose.rows() == 0) return std::nullopt;
  const auto pose = target->pose.row(0);
  if (!std::isfinite(pose[0]) || !std::isfinite(pose[1])) return std::nullopt;  // JSON has no such numbers
  return {{double{pose[0]}, double{pose[1]}}};
}

std::uint64_t DrawsOf(const OrderedJson& details) {
  if (!details.is_object() || !details.contains("scene")) return 0;
  const OrderedJson& scene = details["scene"];
  if (!scene.is_object() || !scene.contains("draws") || !scene["draws"].is_number_unsigned()) return 0;
  return scene["draws"].get<std::uint64_t>();
}

// Reads keys of one object; remembers whether one was of another kind.
class Keys {
 public:
  explicit Keys(const OrderedJson& json) : json_(json) {}
  void Read(const char* key, std::string& value) {
    if (const auto* found = Find(key)) Take(found->is_string(), *found, value);
  }
  void Read(const char* key, std::uint64_t& value) {
    if (const auto* found = Find(key)) Take(found->is_number_unsigned(), *found, value);
  }
  void Read(const char* key, std::uint32_t& value) {
    std::uint64_t wide = value;
    Read(key, wide);
    ok_ = ok_ && wide <= std::numeric_limits<std::uint32_t>::max();
    value = static_cast<std::uint32_t>(wide);
  }
  void Read(const char* key, double& value) {
    if (const auto* found = Find(key)) Take(found->is_number(), *found, value);
    ok_ = ok_ && std::isfinite(value);
  }
  void Read(const char* key, std::optional<std::array<double, 2>>& value) {
    const auto* found = Find(key);
    if (!found) return;
    const bool fits = found->is_array() && found->size() == 2 && (*found)[0].is_number() && (*found)[1].is_number();
    ok_ = ok_ && fits;
    if (fits) value = {{(*found)[0].get<double>(), (*found)[1].get<double>()}};
  }
  bool ok() const { return ok_; }

 private:
  const OrderedJson* Find(const char* key) const {
    const auto found = json_.find(key);
    return found == json_.end() || found->is_null() ? nullptr : &*found;
  }
  template <class T>
  void Take(bool fits, const OrderedJson& found, T& value) {
    if (fits)
      value = found.get<T>();
    else
      ok_ = false;
  }
  const OrderedJson& json_;
  bool ok_ = true;
};

// Cuts blocks into lines. One that is too long for ours is passed over without being kept.
class LineCutter {
 public:
  // fn(line, bytes of the block behind it) for each line that is whole; null: it was too long
  template <class Function>
  void Add(std::string_view block, const Function& fn) {
    for (auto end = block.find('\n'); end != std::string_view::npos; end = block.find('\n')) {
      Keep(block.substr(0, end));
      block.remove_prefix(end + 1);
      fn(too_long_ ? nullptr : &line_, block.size());
      line_.clear();
      too_long_ = false;
    }
    Keep(block);
  }

 private:
  void Keep(std::string_view part) {
    too_long_ = too_long_ || line_.size() + part.size() > kLongestLine;
    if (too_long_)
      line_.clear();
    else
      line_.append(part);
  }
  std::string line_;
  bool too_long_ = false;
};

}  // namespace

CommitRow RowOf(const Episode& episode, std::uint64_t frames, std::uint64_t bytes) {
  CommitRow row;
  row.index = episode.index;
  row.attempt = episode.attempt;
  row.bytes = bytes;
  row.steps = static_cast<std::uint64_t>(episode.steps());
  row.frames = frames;
  row.outcome = episode.outcome;
  row.robot = episode.robot;
  row.task = episode.task;
  row.target = episode.target;
  row.reference = episode.reference;
  row.instruction = episode.instruction;
  row.path_m = PathLength(episode.eef_pos);
  row.jerk = Jerk(episode.eef_pos);
  row.joint_speed = LargestSpeed(episode.joint_vel);
  row.place_m = PlaceOf(episode);
  row.draws = DrawsOf(episode.details);
  row.counted = true;
  row.success = episode.success;
  row.samples = static_cast<std::uint64_t>(FrameCount(episode.steps(), episode.image_stride));
  row.scene.Add(episode.details);
  row.planned.Add(episode.details);
  return row;
}

namespace {

OrderedJson SceneJson(const SceneTally& scene) {
  return {
      {"scenes", scene.scenes}, {"first_draw", scene.first_draw}, {"draws", scene.draws}, {"rejected", scene.rejected}};
}

void ReadCounts(const OrderedJson& json, Counts& counts, bool& good) {
  good = good && json.is_object();
  if (!json.is_object()) return;
  for (const auto& [key, value] : json.items()) {
    good = good && value.is_number_unsigned();
    if (value.is_number_unsigned()) counts[key] = value.get<std::uint64_t>();
  }
}

// False when a part is missing or of another kind: then the episode's file is asked.
bool ReadCounted(const OrderedJson& json, CommitRow& row) {
  for (const char* key : {"success", "samples", "scene", "planned"})
    if (!json.contains(key)) return false;
  const OrderedJson &scene = json["scene"], &planned = json["planned"];
  bool good = json["success"].is_boolean() && scene.is_object() && planned.is_object() && scene.contains("rejected");
  if (!good) return false;
  row.success = json["success"].get<bool>();
  Keys line(json), of_scene(scene);
  line.Read("samples", row.samples);
  of_scene.Read("scenes", row.scene.scenes);
  of_scene.Read("first_draw", row.scene.first_draw);
  of_scene.Read("draws", row.scene.draws);
  ReadCounts(scene["rejected"], row.scene.rejected, good);
  for (const auto& [stage, ways] : planned.items()) ReadCounts(ways, row.planned.ways[stage], good);
  return good && line.ok() && of_scene.ok();
}

}  // namespace

std::string LineOf(const CommitRow& row) {
  OrderedJson line{{"index", row.index},
                   {"attempt", row.attempt},
                   {"t", ToMilliseconds(row.t)},
                   {"worker", row.facts.worker},
                   {"host", row.facts.host},
                   {"fingerprint", row.facts.fingerprint},
                   {"bytes", row.bytes},
                   {"steps", row.steps},
                   {"frames", row.frames},
                   {"outcome", row.outcome},
                   {"robot", row.robot},
                   {"task", row.task},
                   {"target", row.target},
                   {"reference", row.reference},
                   {"instruction", row.instruction},
                   {"timings", TimesJson(row.facts.timings)},
                   {"path_m", row.path_m},
                   {"jerk", row.jerk},
                   {"joint_speed", row.joint_speed},
                   {"draws", row.draws}};
  if (row.place_m) line["place_m"] = *row.place_m;
  if (row.counted) {
    line["success"] = row.success;
    line["samples"] = row.samples;
    line["scene"] = SceneJson(row.scene);
    line["planned"] = row.planned.ways;
  }
  return JsonText(line);
}

Result<CommitRow> ParseCommitLine(std::string_view line) {
  const auto json = line.size() > kLongestLine ? std::nullopt : ParseBoundedJson(line, kDeepestLine);
  if (!json || !json->is_object() || !json->contains("index"))
    return Fail(Code::kCorrupt, fmt::format("a line of {}: no JSON object with an index", internal::kCommits));
  CommitRow row;
  Keys keys(*json);
  keys.Read("index", row.index);
  keys.Read("attempt", row.attempt);
  keys.Read("t", row.t);
  keys.Read("worker", row.facts.worker);
  keys.Read("host", row.facts.host);
  keys.Read("fingerprint", row.facts.fingerprint);
  keys.Read("bytes", row.bytes);
  keys.Read("steps", row.steps);
  keys.Read("frames", row.frames);
  keys.Read("outcome", row.outcome);
  keys.Read("robot", row.robot);
  keys.Read("task", row.task);
  keys.Read("target", row.target);
  keys.Read("reference", row.reference);
  keys.Read("instruction", row.instruction);
  keys.Read("path_m", row.path_m);
  keys.Read("jerk", row.jerk);
  keys.Read("joint_speed", row.joint_speed);
  keys.Read("place_m", row.place_m);
  keys.Read("draws", row.draws);
  if (json->contains("timings")) row.facts.timings = TimesOf((*json)["timings"]);
  row.counted = ReadCounted(*json, row);
  if (keys.ok()) return row;
  return Fail(Code::kCorrupt,
              fmt::format("a line of {}: a value is of another kind than expected", internal::kCommits));
}

namespace {

// What of the journal stands, line by line; little of it is in memory, for a million lines are half a gigabyte.
struct JournalLines {
  std::unordered_set<std::uint64_t> indices;  // of those that stand
  std::vector<bool> stands;                   // by line
};

JournalLines ReadJournal(const Path& path, const std::map<std::uint64_t, std::uint64_t>& bytes_of,
                         const std::function<void(const CommitRow&)>& found_row) {
  JournalLines lines;
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);) {
    const auto row = file.eof() ? Result<CommitRow>(Fail(Code::kCorrupt, "torn")) : ParseCommitLine(line);
    const auto found = row ? bytes_of.find(row->index) : bytes_of.end();
    const bool stands =
        found != bytes_of.end() && found->second == row->bytes && lines.indices.insert(row->index).second;
    lines.stands.push_back(stands);
    if (stands && found_row) found_row(*row);
  }
  return lines;
}

Status RewriteJournal(const Path& path, const std::vector<bool>& stands) {
  constexpr std::size_t kAtOnce = 1 << 20;
  return WriteFileAtomically(path, [&](int fd) -> Status {
    std::ifstream file(path);
    std::string line, text;
    for (std::size_t number = 0; number < stands.size() && std::getline(file, line); ++number) {
      if (stands[number]) text += line + "\n";
      if (text.size() < kAtOnce) continue;
      ETUDE_RETURN_IF_ERROR(WriteAll(fd, path, text));
      text.clear();
    }
    return WriteAll(fd, path, text);
  });
}

}  // namespace

void ForEachCommit(const Path& dataset, const std::map<std::uint64_t, std::uint64_t>& bytes_of,
                   const std::function<void(const CommitRow&)>& take) {
  ReadJournal(dataset / internal::kCommits, bytes_of, take);
}

Result<CommitJournal> CommitJournal::Open(const Path& dataset, const std::map<std::uint64_t, std::uint64_t>& bytes_of,
                                          const std::function<void(const CommitRow&)>& found_row) {
  const Path path = dataset / internal::kCommits;
  JournalLines found = ReadJournal(path, bytes_of, found_row);
  if (const auto dropped = std::ranges::count(found.stands, false); dropped > 0) {
    Log().info("{}: lines without their episode are dropped count={}", path.string(), dropped);
    // readers pass such lines over, and the next start drops them
    if (const Status cleaned = RewriteJournal(path, found.stands); !cleaned) Log().warn("{}", cleaned.error().message);
  }
  ETUDE_ASSIGN_OR_RETURN(auto lines, LineAppender::Open(path));
  CommitJournal journal(std::move(lines));
  journal.rows_ = std::move(found.indices);
  return journal;
}

Status CommitJournal::Append(const CommitRow& row) {
  ETUDE_RETURN_IF_ERROR(lines_.Append(LineOf(row)));
  rows_.insert(row.index);
  return {};
}

namespace {

void BoundTexts(CommitRow& row) {
  for (auto* text : {&row.facts.worker, &row.facts.host, &row.facts.fingerprint, &row.outcome, &row.robot, &row.task,
                     &row.target, &row.reference, &row.instruction})
    if (text->size() > CommitTail::kLongestText) *text = "…";
}

}  // namespace

CommitTail::CommitTail(const Path& dataset) : file_(dataset / internal::kCommits) {}

Result<bool> CommitTail::Refresh(const std::function<void()>& reset,
                                 const std::function<void(const CommitRow&)>& take) {
  const Descriptor file(::open(file_.c_str(), O_RDONLY | O_CLOEXEC));
  if (file.get() < 0 && errno == ENOENT) {
    const bool had = offset_ > 0;
    if (had) reset();
    device_ = inode_ = offset_ = 0;
    before_.clear();
    return had;
  }
  struct stat info {};
  if (file.get() < 0 || ::fstat(file.get(), &info) != 0) return Fail(ErrnoError("read", file_, errno));
  const auto length = static_cast<std::uint64_t>(info.st_size);
  const bool replaced = info.st_dev != device_ || info.st_ino != inode_ || BytesBefore(file.get(), offset_) != before_;
  if (replaced) {
    reset();
    offset_ = 0;
    before_.clear();
  }
  device_ = info.st_dev;
  inode_ = info.st_ino;
  const std::uint64_t before = offset_;
  const Status taken = TakeLines(file.get(), length, take);
  before_ = BytesBefore(file.get(), offset_);
  if (!taken) return Fail(taken.error());
  return replaced || offset_ != before;
}

Status CommitTail::TakeLines(int file, std::uint64_t length, const std::function<void(const CommitRow&)>& take) {
  LineCutter cutter;
  std::vector<char> block(1 << 18);
  for (std::uint64_t at = offset_; at < length;) {
    const auto want = static_cast<std::size_t>(std::min<std::uint64_t>(block.size(), length - at));
    const ssize_t got = ::pread(file, block.data(), want, static_cast<off_t>(at));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return Fail(ErrnoError("read", file_, errno));
    if (got == 0) break;
    at += static_cast<std::uint64_t>(got);
    cutter.Add({block.data(), static_cast<std::size_t>(got)}, [&](const std::string* line, std::size_t left) {
      offset_ = at - left;
      if (!line) return;
      auto row = ParseCommitLine(*line);
      if (!row) return;
      BoundTexts(*row);
      take(*row);
    });
  }
  return {};
}

}  // namespace etude::store
