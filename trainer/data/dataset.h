// SPDX-License-Identifier: Apache-2.0
// The episodes of one or several datasets in memory (tracks only; pictures stay on disk), also while they grow.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "services/core/thread_annotations.h"
#include "services/store/dataset.h"

namespace etude::data {

enum class Split { kTrain, kValid, kTest };

/// One episode as the trainer keeps it: `states` and velocities are dropped to save memory.
struct EpisodeEntry {
  std::uint64_t index = 0;   ///< in its folder
  std::uint32_t folder = 0;  ///< of a Dataset that reads several: which of them, from 0
  Split split = Split::kTrain;
  store::EpisodeRecord record;
  std::vector<std::uint32_t> usable;  ///< frames that something can be learned from, found once: UsableFrames

  const Episode& episode() const { return record.episode; }
  /// What tells it from every other one of the Dataset: its index in the first folder; those of the second begin at
  /// 2^48.
  std::uint64_t number() const { return NumberOf(folder, index); }
  static std::uint64_t NumberOf(std::uint32_t folder, std::uint64_t index) {
    return (static_cast<std::uint64_t>(folder) << kIndexBits) + index;
  }
  static constexpr int kIndexBits = 48;
  /// Control step of a frame of the first camera.
  int StepOf(std::uint32_t frame) const { return static_cast<int>(frame) * record.episode.image_stride; }
  /// Whether the frame is of the stage that ends a demonstration: the hand stays where it is (HoldSpec).
  bool AtRest(std::uint32_t frame) const;
};

/// Frame of an episode; `episode` counts in Snapshot::episodes.
struct FrameRef {
  std::uint32_t episode = 0;
  std::uint32_t frame = 0;
};

/// What was there at one moment. Immutable; episodes ascend by number (folder by folder, by index), so that two
/// snapshots with the same episodes are the same whatever order they arrived in.
class Snapshot {
 public:
  explicit Snapshot(std::vector<std::shared_ptr<const EpisodeEntry>> episodes);

  const std::vector<std::shared_ptr<const EpisodeEntry>>& episodes() const { return episodes_; }
  /// Frames something can be learned from, by task in alphabetical order; see UsableFrame.
  const std::map<std::string, std::vector<FrameRef>>& frames(Split split) const {
    return frames_[static_cast<int>(split)];
  }
  std::size_t frame_count(Split split) const;
  std::size_t episode_count(Split split) const { return counts_[static_cast<int>(split)]; }
  /// SHA-256 of the numbers and seeds of the training split: tells runs on different data apart.
  std::string Fingerprint() const;

 private:
  std::vector<std::shared_ptr<const EpisodeEntry>> episodes_;
  std::map<std::string, std::vector<FrameRef>> frames_[3];
  std::size_t counts_[3] = {0, 0, 0};
};

/// The episodes of one split that `numbers` name (all of it when there are none), as a snapshot that stays as it is
/// while the dataset grows. @error kInvalidArgument: numbers that are not there, which.
Result<std::shared_ptr<const Snapshot>> FixedSplit(const Snapshot& snapshot, Split split,
                                                   const std::vector<std::uint64_t>& numbers);

/// True when the picture shows the target at a finite pose: then at least its grounding can be
/// learned.
bool UsableFrame(const EpisodeEntry& entry, std::uint32_t frame);
/// All of them, for EpisodeEntry::usable.
std::vector<std::uint32_t> UsableFrames(const EpisodeEntry& entry);

/// One folder, or several that are read as one, each with the splits of its own spec. Whether they fit one policy
/// (robot, camera, rates) is for who trains on them to say. Thread-safe.
class Dataset {
 public:
  /// Opens without reading episodes; call Refresh. @error as store::DatasetReader::Open.
  static Result<std::shared_ptr<Dataset>> Open(const Path& path);
  /// Several, in this order. @error kInvalidArgument: none, or one of them twice.
  static Result<std::shared_ptr<Dataset>> Open(const std::vector<Path>& paths);

  std::size_t folders() const { return readers_.size(); }
  const CampaignSpec& spec(std::size_t folder = 0) const { return readers_[folder].spec(); }
  const std::string& spec_sha256(std::size_t folder = 0) const { return readers_[folder].spec_sha256(); }
  const Path& path(std::size_t folder = 0) const { return readers_[folder].path(); }
  /// For messages: "'data'", "'data/a', 'data/b'".
  std::string text() const;
  /// What the specs of all folders name, in the order in which the first of them does.
  const std::vector<std::string>& tasks() const { return tasks_; }
  const std::vector<std::string>& objects() const { return objects_; }

  /// Reads episode files that are new and returns how many there were. A file that cannot be read is tried
  /// again at later calls; one that is not merely out of reach is left out after kReadAttempts. It harms no other.
  /// @error of a folder that cannot be listed; kInvalidArgument: two folders of one spec have the same episode
  Result<int> Refresh();
  std::shared_ptr<const Snapshot> snapshot() const;
  /// Files that were left out.
  std::size_t bad_files() const;
  /// Episodes that are there and could not be read, so far.
  std::size_t unread() const;
  static constexpr int kReadAttempts = 5;

 private:
  explicit Dataset(std::vector<store::DatasetReader> readers);
  Status CheckFolders(const std::vector<std::vector<std::uint64_t>>& indices) const;
  std::shared_ptr<const EpisodeEntry> ReadEntry(std::uint32_t folder, std::uint64_t index)
      ETUDE_REQUIRES(refresh_mutex_);
  void Publish() ETUDE_REQUIRES(refresh_mutex_);

  std::vector<store::DatasetReader> readers_;
  std::vector<std::string> tasks_, objects_;
  mutable Mutex refresh_mutex_;
  mutable Mutex mutex_;
  // by number; null: a bad file
  std::map<std::uint64_t, std::shared_ptr<const EpisodeEntry>> entries_ ETUDE_GUARDED_BY(refresh_mutex_);
  std::map<std::uint64_t, int> failures_ ETUDE_GUARDED_BY(refresh_mutex_);  // reads, of files still tried, by number
  std::size_t bad_files_ ETUDE_GUARDED_BY(mutex_) = 0;
  std::shared_ptr<const Snapshot> snapshot_ ETUDE_GUARDED_BY(mutex_);
};

}  // namespace etude::data
