// SPDX-License-Identifier: Apache-2.0
#include "trainer/data/dataset.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "services/core/hash.h"
#include "services/core/log.h"
#include "services/core/stop.h"

namespace etude::data {
namespace {

// episodes a growing dataset may add before they are visible: a first look at a large one shows
// progress
constexpr std::size_t kPublishEvery = 200;

Split ParseSplit(const std::string& name) {
  if (name == "train") return Split::kTrain;
  return name == "valid" ? Split::kValid : Split::kTest;
}

bool Finite(std::span<const float> values) {
  return std::all_of(values.begin(), values.end(), [](float x) { return std::isfinite(x); });
}

}  // namespace

bool UsableFrame(const EpisodeEntry& entry, std::uint32_t frame) {
  const Episode& episode = entry.episode();
  const int step = entry.StepOf(frame);
  if (step >= episode.steps()) return false;
  const ObjectTrack* target = episode.FindObject(episode.target);
  if (!target || episode.cameras.empty()) return false;
  const auto pixel = target->pixel.row(step);
  const Camera& camera = episode.cameras[0].camera;
  return Finite(pixel) && Finite(target->pose.row(step)) && Finite(episode.eef_pos.row(step)) && pixel[0] >= 0 &&
         pixel[1] >= 0 && pixel[0] < camera.width && pixel[1] < camera.height;
}

std::vector<std::uint32_t> UsableFrames(const EpisodeEntry& entry) {
  std::vector<std::uint32_t> usable;
  if (entry.record.frames.empty()) return usable;
  for (std::uint32_t k = 0; k < entry.record.frames[0].size(); ++k)
    if (UsableFrame(entry, k)) usable.push_back(k);
  return usable;
}

Snapshot::Snapshot(std::vector<std::shared_ptr<const EpisodeEntry>> episodes) : episodes_(std::move(episodes)) {
  for (std::uint32_t i = 0; i < episodes_.size(); ++i) {
    const EpisodeEntry& entry = *episodes_[i];
    const int split = static_cast<int>(entry.split);
    ++counts_[split];
    auto& refs = frames_[split][entry.episode().task];
    for (const std::uint32_t k : entry.usable) refs.push_back({i, k});
  }
  for (auto& by_task : frames_) std::erase_if(by_task, [](const auto& item) { return item.second.empty(); });
}

std::size_t Snapshot::frame_count(Split split) const {
  std::size_t count = 0;
  for (const auto& [task, refs] : frames(split)) count += refs.size();
  return count;
}

std::string Snapshot::Fingerprint() const {
  std::string text;
  for (const auto& entry : episodes_)
    if (entry->split == Split::kTrain) text += fmt::format("{}:{};", entry->index, entry->episode().seed);
  return Sha256Hex(text);
}

Result<std::shared_ptr<const Snapshot>> FixedSplit(const Snapshot& snapshot, Split split,
                                                   const std::vector<std::uint64_t>& indices) {
  std::set<std::uint64_t> wanted(indices.begin(), indices.end());
  std::vector<std::shared_ptr<const EpisodeEntry>> episodes;
  for (const auto& entry : snapshot.episodes()) {
    if (entry->split != split || (!indices.empty() && !wanted.contains(entry->index))) continue;
    wanted.erase(entry->index);
    episodes.push_back(entry);
  }
  if (!wanted.empty())
    return Fail(Code::kInvalidArgument, fmt::format("validation episodes {} of the run are not in the dataset: is it "
                                                    "the one that the run was trained on?",
                                                    fmt::join(wanted, ", ")));
  return std::make_shared<const Snapshot>(std::move(episodes));
}

Dataset::Dataset(store::DatasetReader reader)
    : reader_(std::move(reader)),
      snapshot_(std::make_shared<Snapshot>(std::vector<std::shared_ptr<const EpisodeEntry>>())) {}

Result<std::shared_ptr<Dataset>> Dataset::Open(const Path& path) {
  ETUDE_ASSIGN_OR_RETURN(auto reader, store::DatasetReader::Open(path));
  return std::shared_ptr<Dataset>(new Dataset(std::move(reader)));
}

void Dataset::Publish() {
  std::vector<std::shared_ptr<const EpisodeEntry>> episodes;
  for (const auto& [index, entry] : entries_)
    if (entry) episodes.push_back(entry);
  auto fresh = std::make_shared<const Snapshot>(std::move(episodes));
  const std::lock_guard lock(mutex_);
  snapshot_ = std::move(fresh);
}

// nullptr: not this time
std::shared_ptr<const EpisodeEntry> Dataset::ReadEntry(std::uint64_t index) {
  auto record = reader_.Read(index);
  if (!record) {
    const int failures = ++failures_[index];
    if (failures == 1) Log().warn("an episode cannot be read, it is tried again: {}", record.error().message);
    // one that cannot be read now may be later, however long that takes
    if (failures < kReadAttempts || record.error().code == Code::kUnavailable) return nullptr;
    Log().warn("left out an episode that cannot be read: {}", record.error().message);
    failures_.erase(index);
    entries_[index] = nullptr;
    const std::lock_guard lock(mutex_);
    ++bad_files_;
    return nullptr;
  }
  failures_.erase(index);
  auto entry = std::make_shared<EpisodeEntry>();
  entry->index = index;
  entry->split = ParseSplit(SplitOf(reader_.spec(), index));
  entry->record = std::move(*record);
  entry->record.episode.states = {};
  entry->record.episode.joint_vel = {};
  entry->usable = UsableFrames(*entry);
  return entry;
}

Result<int> Dataset::Refresh() {
  const std::lock_guard only_one(refresh_mutex_);
  ETUDE_ASSIGN_OR_RETURN(const auto indices, reader_.List());
  int added = 0;
  for (const std::uint64_t index : indices) {
    if (entries_.contains(index)) continue;
    if (StopRequested()) break;
    auto entry = ReadEntry(index);
    // at once a second time: most errors that pass do so soon
    if (!entry && !entries_.contains(index)) entry = ReadEntry(index);
    if (!entry) continue;
    entries_[index] = std::move(entry);
    if (++added % kPublishEvery == 0) Publish();
  }
  if (added > 0) Publish();
  return added;
}

std::shared_ptr<const Snapshot> Dataset::snapshot() const {
  const std::lock_guard lock(mutex_);
  return snapshot_;
}

std::size_t Dataset::bad_files() const {
  const std::lock_guard lock(mutex_);
  return bad_files_;
}

}  // namespace etude::data
