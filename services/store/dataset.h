// SPDX-License-Identifier: Apache-2.0
// A dataset on disk: robomimic's HDF5 layout, one file an episode. The file's existence is the commit.
//
//   DATASET/
//     dataset.json              campaign spec as resolved, schema version, statistics; by rename. "derived": true
//                               where it was made of other datasets (edit.h)
//     episodes/000/000123.hdf5  one episode: temporary name -> fsync -> rename -> fsync of the folder
//     dataset.hdf5              /data/demo_<i>: external links to the files above; /mask/{train,valid,test}
//     attempts.jsonl            every failed attempt: index, attempt, seed, outcome, details; attempts.<n>.jsonl those
//                               before files were mended, which nobody counts any more
//     commits.jsonl             every committed episode in a line (commit_journal.h): a cache of what the files hold
//     sampling.jsonl            from which index on which sampling weights hold (sampling_journal.h); most have none
//     filters.json              episodes that someone picked, by a name (filter_keys.h); most have none
//     quarantine/               what verify moved aside
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "services/codec/frames.h"
#include "services/core/file.h"
#include "services/core/result.h"
#include "services/episode/codec.h"
#include "services/episode/episode.h"
#include "services/spec/campaign_spec.h"
#include "services/store/commit_journal.h"

namespace etude::store {

/// What this program writes. It reads from kOldestSchema on: format.md says what changed.
inline constexpr int kSchemaVersion = 3;
inline constexpr int kOldestSchema = 1;

/// DATASET/episodes/000/000123.hdf5
Path EpisodePath(const Path& dataset, std::uint64_t index);

/// An episode as it came to who commits it: encoded and hashed elsewhere, its pictures where they lie.
struct ArrivedEpisode {
  const EpisodeView* view = nullptr;
  std::string content_sha256;  ///< hex, of EncodeEpisode's bytes
  CommitFacts facts;
};

/// The one writer of a dataset (a lock file keeps a second one out). Thread safety: all functions but committed() from
/// any thread, of different episodes at once.
class DatasetWriter {
 public:
  /// Makes the dataset, or opens it to resume. Temporary files of a crash are removed.
  /// @error kInvalidArgument when it was made from another spec (says which keys differ) or has an older schema,
  /// kUnavailable when another process writes it or the disk refuses.
  static Result<DatasetWriter> Open(const Path& dataset, const CampaignSpec& spec);
  DatasetWriter(DatasetWriter&&) noexcept;
  DatasetWriter& operator=(DatasetWriter&&) noexcept;
  ~DatasetWriter();

  /// While nobody commits.
  const std::set<std::uint64_t>& committed() const;
  bool Contains(std::uint64_t index) const;

  /// Durable when it returns. On error nothing of the episode is visible and the dataset is as
  /// before; kUnavailable (disk full) may be tried again.
  /// @param facts  for its line in commits.jsonl; nothing of them enters the episode's file
  Status Commit(const Episode& episode, const CommitFacts& facts = {});
  /// Several at once, of different indices: files are fsynced together and each folder once, nothing is hashed again,
  /// the bytes are made without HDF5. Of the streams every 64th is inflated, all begin as one of zlib; Verify looks
  /// at each. @returns for each what Commit would
  std::vector<Status> CommitGroup(std::span<const ArrivedEpisode> group);
  /// Appends to attempts.jsonl.
  Status RecordFailure(std::uint64_t index, std::uint32_t attempt, const std::string& outcome,
                       const std::string& details_json);
  /// Sets the failures until now aside, in a file of their own that is there for people: what comes back is recorded
  /// and counts anew. Durable when it returns. @error kUnavailable
  Status ForgetFailures();
  /// Rewrites dataset.hdf5 (links and masks) and dataset.json (statistics), each by rename, and adds to commits.jsonl
  /// the lines that it lacks. Call at the end: its time grows with the dataset, and commits go on meanwhile. Everything
  /// in it is derived from the episode files, of which only those are read that the journal lacks.
  Status WriteMaster();
  /// The same for a dataset that grows, to be called now and then: dataset.json and the journals, which cost the same
  /// however many episodes there are; dataset.hdf5 only when it is due (MasterIsDue: it lacks a fifth of the episodes
  /// at most, and costs each of them a bounded number of links in all).
  Status WriteProgress();
  /// Gives a filter key (filter_keys.h) these episodes, none: removes it, and rewrites the master file. Durable when it
  /// returns. @error kInvalidArgument: not a plain name, a name that splits or tasks have, an episode that is not
  /// there; kCorrupt, kUnavailable
  Status WriteFilterKey(const std::string& name, const std::set<std::uint64_t>& indices);

 private:
  struct Impl;
  explicit DatasetWriter(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// Where one zlib stream lies in its episode file.
struct StreamLocation {
  std::uint64_t offset = 0;
  std::uint32_t size = 0;
};

/// Where the frames of one camera lie in their episode file.
struct StoredFrames {
  codec::FrameLayout layout{1, 1, {}};
  std::size_t count = 0;                ///< frames; 0: recorded without
  std::vector<StreamLocation> streams;  ///< layout.streams(count) of them

  std::size_t size() const { return count; }
  bool empty() const { return count == 0; }
};

/// An episode without its pictures, plus where they are: what a trainer keeps in memory.
struct EpisodeRecord {
  Path path;
  Episode episode;                   ///< cameras have no streams
  std::vector<StoredFrames> frames;  ///< of each camera
};

/// Reads a dataset, also while it grows. Const methods are thread-safe.
class DatasetReader {
 public:
  /// Older schemas are read, too (format.md). @error kNotFound, kCorrupt (dataset.json), kInvalidArgument
  /// for a schema that this program does not know.
  static Result<DatasetReader> Open(const Path& dataset);

  const Path& path() const { return path_; }
  const CampaignSpec& spec() const { return spec_; }
  /// Hash of the spec as its writer saw it; defaults that came later are not in it.
  const std::string& spec_sha256() const { return spec_sha256_; }
  /// Of the dataset on disk.
  int schema_version() const { return schema_version_; }
  /// Of the program that made it (kContentVersion): another makes other episodes of the same spec. 0: it does not say.
  std::int64_t content_version() const { return content_version_; }
  /// Indices of the episode files there now, ascending (reads the folders).
  Result<std::vector<std::uint64_t>> List() const;
  /// @error kCorrupt with the file and what is wrong; kUnavailable: it cannot be read now and may be whole, so ask
  /// again later. Other files are not affected.
  Result<EpisodeRecord> Read(std::uint64_t index) const;
  /// The whole episode, with pictures (still deflated).
  Result<Episode> ReadWhole(std::uint64_t index) const;

 private:
  Path path_;
  CampaignSpec spec_;
  std::string spec_sha256_;
  int schema_version_ = kSchemaVersion;
  std::int64_t content_version_ = 0;
};

/// Reads frames by file offset, with no HDF5 and no lock: pread + inflate. In any order; those of the block that was
/// read last are there already. Not thread-safe; any number of them work at once.
class FrameReader {
 public:
  /// `frames` must outlive it.
  FrameReader(Path file, const StoredFrames& frames)
      : file_(std::move(file)), frames_(frames), cursor_(frames.layout) {}
  FrameReader(Path file, StoredFrames&& frames) = delete;

  /// RGB (height, width, 3); valid until the next call. @pre k < frames.size(). @error kCorrupt, kNotFound
  Result<std::span<const std::uint8_t>> Read(std::size_t k);
  /// All frames of one block, one after the other, into `pixels`, which gets its size; what is beyond the last frame is
  /// not defined. Thread-safe. @pre block < frames.layout.blocks(frames.size()). @error kCorrupt, kNotFound
  static Status ReadBlock(const Path& file, const StoredFrames& frames, std::size_t block,
                          std::vector<std::uint8_t>& pixels);

 private:
  const Path file_;
  const StoredFrames& frames_;
  codec::BlockCursor cursor_;
};

struct VerifyReport {
  std::uint64_t good = 0;
  struct Bad {
    Path path;
    std::string reason;
  };
  std::vector<Bad> bad;     ///< their content is wrong
  std::vector<Bad> unread;  ///< could not be read this time; never moved
  Status moved;             ///< why the first of the bad that could not be moved stays, and with it those that follow
  Status refreshed;         ///< why the master file may still link what was moved
};

enum class Quarantine { kNo, kYes };

/// Reads every byte of every episode (checksums, every frame inflated, row counts), and whether it was made with the
/// weights that the sampling journal has for its index. With kYes bad
/// files are moved to quarantine/, so that a collector that resumes makes them again; where that fails the report says
/// so.
Result<VerifyReport> Verify(const Path& dataset, Quarantine quarantine);

/// SHA-256 over (index, content) of every episode in order, and over its sampling journal where it has one: independent
/// of who made it and when.
Result<std::string> HashDataset(const Path& dataset);

/// Counts per task, target, split; steps, frames, bytes; failures by reason; sampling weights; feature table.
Result<OrderedJson> DatasetInfo(const Path& dataset);

}  // namespace etude::store
