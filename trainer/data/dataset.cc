// SPDX-License-Identifier: Apache-2.0
#include "trainer/data/dataset.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <set>

#include "services/core/hash.h"
#include "services/core/log.h"
#include "services/core/stop.h"
#include "services/spec/object_names.h"
#include "services/spec/task_spec.h"

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

// "7", "7 of dataset 2"
std::string NumberText(std::uint64_t number) {
  const auto folder = number >> EpisodeEntry::kIndexBits;
  const auto index = number - (folder << EpisodeEntry::kIndexBits);
  return folder == 0 ? fmt::format("{}", index) : fmt::format("{} of dataset {}", index, folder + 1);
}

template <class T>
void AddNew(const std::vector<T>& more, std::vector<T>& all) {
  for (const T& item : more)
    if (std::ranges::find(all, item) == all.end()) all.push_back(item);
}

// Of one seed, an index draws the same target and places in campaigns that differ in other things.
void WarnOfSharedScenes(const std::vector<store::DatasetReader>& readers) {
  for (std::size_t second = 1; second < readers.size(); ++second)
    for (std::size_t first = 0; first < second; ++first) {
      const CampaignSpec &a = readers[first].spec(), &b = readers[second].spec();
      const bool one_spec =
          readers[first].spec_sha256() == readers[second].spec_sha256();  // CheckFolders looks at those
      if (a.seed != b.seed || one_spec || ToJson(a.split) == ToJson(b.split)) continue;
      std::uint64_t index = 0;
      const std::uint64_t end = std::min(a.episodes, b.episodes);
      while (index < end && (SplitOf(a, index) == "train") == (SplitOf(b, index) == "train")) ++index;
      if (index < end)
        Log().warn(
            "'{}' and '{}' have one seed, {}: scenes of one number are alike, and number {} is one that one "
            "trains on and the other does not; what is validated is better than it would be on new scenes. Collect one "
            "of "
            "them with another --seed",
            readers[first].path().string(), readers[second].path().string(), a.seed, index);
    }
}

}  // namespace

bool EpisodeEntry::AtRest(std::uint32_t frame) const {
  const Episode& episode = record.episode;
  const auto step = static_cast<std::size_t>(StepOf(frame));
  // a task may hold still before it goes on, too
  return step < episode.phase.size() && episode.phase[step] + std::size_t{1} == episode.stage_names.size() &&
         episode.stage_names.back() == HoldSpec::kName;
}

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
    if (entry->split == Split::kTrain) text += fmt::format("{}:{};", entry->number(), entry->episode().seed);
  return Sha256Hex(text);
}

Result<std::shared_ptr<const Snapshot>> FixedSplit(const Snapshot& snapshot, Split split,
                                                   const std::vector<std::uint64_t>& numbers) {
  std::set<std::uint64_t> wanted(numbers.begin(), numbers.end());
  std::vector<std::shared_ptr<const EpisodeEntry>> episodes;
  for (const auto& entry : snapshot.episodes()) {
    if (entry->split != split || (!numbers.empty() && !wanted.contains(entry->number()))) continue;
    wanted.erase(entry->number());
    episodes.push_back(entry);
  }
  if (!wanted.empty()) {
    std::vector<std::string> missing;
    std::ranges::transform(wanted, std::back_inserter(missing), NumberText);
    if (episodes.empty())
      return Fail(
          Code::kInvalidArgument,
          fmt::format("validation episodes {} of the run are not in the dataset: is it the one that the run was "
                      "trained on (several: in the same order)?",
                      fmt::join(missing, ", ")));
    Log().warn(
        "validation episodes {} of the run are not in the dataset any more: the {} that are left are validated "
        "on",
        fmt::join(missing, ", "), episodes.size());
  }
  return std::make_shared<const Snapshot>(std::move(episodes));
}

Dataset::Dataset(std::vector<store::DatasetReader> readers)
    : readers_(std::move(readers)),
      tasks_(readers_.front().spec().tasks),
      objects_(SceneNames(readers_.front().spec().objects)),
      snapshot_(std::make_shared<Snapshot>(std::vector<std::shared_ptr<const EpisodeEntry>>())) {
  for (std::size_t folder = 1; folder < readers_.size(); ++folder) {
    AddNew(spec(folder).tasks, tasks_);
    AddNew(SceneNames(spec(folder).objects), objects_);
  }
}

Result<std::shared_ptr<Dataset>> Dataset::Open(const Path& path) { return Open(std::vector<Path>{path}); }

Result<std::shared_ptr<Dataset>> Dataset::Open(const std::vector<Path>& paths) {
  if (paths.empty()) return Fail(Code::kInvalidArgument, "open a dataset: no folder is given");
  std::vector<store::DatasetReader> readers;
  std::set<Path> known;
  for (const Path& path : paths) {
    std::error_code error;
    if (!known.insert(std::filesystem::weakly_canonical(path, error)).second)
      return Fail(Code::kInvalidArgument, fmt::format("dataset '{}' is given twice", path.string()));
    ETUDE_ASSIGN_OR_RETURN(auto reader, store::DatasetReader::Open(path));
    if (reader.spec().mode != "demonstrate")
      return Fail(Code::kInvalidArgument,
                  fmt::format("train on '{}': it has rollouts of a policy, failures among them, in an evaluation's "
                              "scenes; name a dataset of demonstrations",
                              path.string()));
    readers.push_back(std::move(reader));
  }
  WarnOfSharedScenes(readers);
  return std::shared_ptr<Dataset>(new Dataset(std::move(readers)));
}

std::string Dataset::text() const {
  std::vector<std::string> names;
  for (const auto& reader : readers_) names.push_back(fmt::format("'{}'", reader.path().string()));
  return fmt::format("{}", fmt::join(names, ", "));
}

void Dataset::Publish() {
  std::vector<std::shared_ptr<const EpisodeEntry>> episodes;
  for (const auto& [number, entry] : entries_)
    if (entry) episodes.push_back(entry);
  auto fresh = std::make_shared<const Snapshot>(std::move(episodes));
  const MutexLock lock(mutex_);
  snapshot_ = std::move(fresh);
}

// nullptr: not this time
std::shared_ptr<const EpisodeEntry> Dataset::ReadEntry(std::uint32_t folder, std::uint64_t index) {
  const std::uint64_t number = EpisodeEntry::NumberOf(folder, index);
  auto record = readers_[folder].Read(index);
  if (!record) {
    const int failures = ++failures_[number];
    if (failures == 1) Log().warn("an episode cannot be read, it is tried again: {}", record.error().message);
    // one that cannot be read now may be later, however long that takes
    if (failures < kReadAttempts || record.error().code == Code::kUnavailable) return nullptr;
    Log().warn("left out an episode that cannot be read: {}", record.error().message);
    failures_.erase(number);
    entries_[number] = nullptr;
    const MutexLock lock(mutex_);
    ++bad_files_;
    return nullptr;
  }
  failures_.erase(number);
  auto entry = std::make_shared<EpisodeEntry>();
  entry->index = index;
  entry->folder = folder;
  entry->split = ParseSplit(SplitOf(spec(folder), index));
  entry->record = std::move(*record);
  entry->record.episode.states = {};
  entry->record.episode.joint_vel = {};
  entry->usable = UsableFrames(*entry);
  return entry;
}

// An episode that two folders have would count twice, and might be trained on here and validated on there.
Status Dataset::CheckFolders(const std::vector<std::vector<std::uint64_t>>& indices) const {
  for (std::size_t second = 1; second < readers_.size(); ++second)
    for (std::size_t first = 0; first < second; ++first) {
      if (spec_sha256(first) != spec_sha256(second)) continue;
      std::vector<std::uint64_t> both;
      std::ranges::set_intersection(indices[first], indices[second], std::back_inserter(both));
      if (!both.empty())
        return Fail(
            Code::kInvalidArgument,
            fmt::format("train on '{}' and '{}': they are of one spec, and both have episode {}{}; give one of "
                        "them{}",
                        path(first).string(), path(second).string(), both.front(),
                        both.size() > 1 ? fmt::format(" and {} more", both.size() - 1) : "",
                        spec(first).name == spec(second).name && ToJson(spec(first).split) == ToJson(spec(second).split)
                            ? ", or make one of both (`etude dataset merge`)"
                            : ""));
    }
  for (std::size_t folder = 0; folder < readers_.size() && readers_.size() > 1; ++folder)
    if (!indices[folder].empty() && indices[folder].back() >> EpisodeEntry::kIndexBits)
      return Fail(Code::kInvalidArgument,
                  fmt::format("train on {}: '{}' has episode {}, and several are read together only up to 2^{}", text(),
                              path(folder).string(), indices[folder].back(), EpisodeEntry::kIndexBits));
  return {};
}

Result<int> Dataset::Refresh() {
  const MutexLock only_one(refresh_mutex_);
  std::vector<std::vector<std::uint64_t>> indices;
  for (const auto& reader : readers_) {
    ETUDE_ASSIGN_OR_RETURN(auto listed, reader.List());
    indices.push_back(std::move(listed));
  }
  ETUDE_RETURN_IF_ERROR(CheckFolders(indices));
  int added = 0;
  for (std::uint32_t folder = 0; folder < indices.size(); ++folder)
    for (const std::uint64_t index : indices[folder]) {
      const std::uint64_t number = EpisodeEntry::NumberOf(folder, index);
      if (entries_.contains(number)) continue;
      if (StopRequested()) break;
      auto entry = ReadEntry(folder, index);
      // at once a second time: most errors that pass do so soon
      if (!entry && !entries_.contains(number)) entry = ReadEntry(folder, index);
      if (!entry) continue;
      entries_[number] = std::move(entry);
      if (++added % kPublishEvery == 0) Publish();
    }
  if (added > 0) Publish();
  return added;
}

std::shared_ptr<const Snapshot> Dataset::snapshot() const {
  const MutexLock lock(mutex_);
  return snapshot_;
}

std::size_t Dataset::unread() const {
  const MutexLock only_one(refresh_mutex_);
  return failures_.size() + bad_files();
}

std::size_t Dataset::bad_files() const {
  const MutexLock lock(mutex_);
  return bad_files_;
}

}  // namespace etude::data
