// SPDX-License-Identifier: Apache-2.0
// The episodes of a dataset in memory (tracks only; pictures stay on disk), also while it grows.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "services/store/dataset.h"

namespace etude::data {

enum class Split { kTrain, kValid, kTest };

/// One episode as the trainer keeps it: `states` and velocities are dropped to save memory.
struct EpisodeEntry {
  std::uint64_t index = 0;
  Split split = Split::kTrain;
  store::EpisodeRecord record;
  std::vector<std::uint32_t> usable;  ///< frames that something can be learned from, found once: UsableFrames

  const Episode& episode() const { return record.episode; }
  /// Control step of a frame of the first camera.
  int StepOf(std::uint32_t frame) const { return static_cast<int>(frame) * record.episode.image_stride; }
};

/// Frame of an episode; `episode` counts in Snapshot::episodes.
struct FrameRef {
  std::uint32_t episode = 0;
  std::uint32_t frame = 0;
};

/// What was there at one moment. Immutable; episodes ascend by index, so that two snapshots with
/// the same episodes are the same whatever order they arrived in.
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
  /// SHA-256 of the indices and seeds of the training split: tells runs on different data apart.
  std::string Fingerprint() const;

 private:
  std::vector<std::shared_ptr<const EpisodeEntry>> episodes_;
  std::map<std::string, std::vector<FrameRef>> frames_[3];
  std::size_t counts_[3] = {0, 0, 0};
};

/// The episodes of one split that `indices` name (all of it when there are none), as a snapshot that stays as it is
/// while the dataset grows. @error kInvalidArgument: indices that are not there, by number.
Result<std::shared_ptr<const Snapshot>> FixedSplit(const Snapshot& snapshot, Split split,
                                                   const std::vector<std::uint64_t>& indices);

/// True when the picture shows the target at a finite pose: then at least its grounding can be
/// learned.
bool UsableFrame(const EpisodeEntry& entry, std::uint32_t frame);
/// All of them, for EpisodeEntry::usable.
std::vector<std::uint32_t> UsableFrames(const EpisodeEntry& entry);

/// Thread-safe.
class Dataset {
 public:
  /// Opens without reading episodes; call Refresh. @error as store::DatasetReader::Open.
  static Result<std::shared_ptr<Dataset>> Open(const Path& path);

  const CampaignSpec& spec() const { return reader_.spec(); }
  const Path& path() const { return reader_.path(); }
  /// Reads episode files that are new and returns how many there were. A file that cannot be read is tried
  /// again at later calls; one that is not merely out of reach is left out after kReadAttempts. It harms no other.
  Result<int> Refresh();
  std::shared_ptr<const Snapshot> snapshot() const;
  /// Files that were left out.
  std::size_t bad_files() const;
  static constexpr int kReadAttempts = 5;

 private:
  explicit Dataset(store::DatasetReader reader);
  std::shared_ptr<const EpisodeEntry> ReadEntry(std::uint64_t index);
  void Publish();

  store::DatasetReader reader_;
  std::mutex refresh_mutex_;
  mutable std::mutex mutex_;
  std::map<std::uint64_t, std::shared_ptr<const EpisodeEntry>> entries_;  // null: a bad file
  std::map<std::uint64_t, int> failures_;                                 // reads that failed, of files still tried
  std::size_t bad_files_ = 0;
  std::shared_ptr<const Snapshot> snapshot_;
};

}  // namespace etude::data
