// SPDX-License-Identifier: Apache-2.0
// Where a trainer's checkpoints go: files first, then the bus.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "services/bus/blob_transfer.h"
#include "services/core/file.h"
#include "services/security/checkpoint_signature.h"
#include "trainer/checkpoint/checkpoint.h"
#include "trainer/checkpoint/names.h"

namespace etude::publish {

/// A run as its subscribers know it.
struct RunIdentity {
  std::string name, id;     ///< published in the partition NAME/ID
  std::uint64_t start = 1;  ///< grows with every start of the run (see NextStart): versions grow over restarts
  std::shared_ptr<const security::CheckpointSigner> signer = {};  ///< signs what is published; none: nobody does
};

/// One more than the starts that `run_folder` has seen (RUN/starts).
std::uint64_t NextStart(const Path& run_folder);

/// Before a run begins in a folder that has checkpoints of another one, whose state is gone: renames their folder to
/// checkpoints.before-1 (or -2, ...), with a warning.
/// @param from  the checkpoint that the run begins with; "": none
/// @error kInvalidArgument: that is one of them; kUnavailable of the disk
Status SetCheckpointsAside(const Path& run_folder, const Path& from = {});

/// A checkpoint as it lies in the run's folder.
struct Kept {
  std::string file;                   ///< name in RUN/checkpoints
  std::string sha256;                 ///< of its bytes
  std::vector<std::string> channels;  ///< that name it: latest, and best
};

/// RUN/checkpoints/00001500.safetensors, with links latest.safetensors and best.safetensors; each
/// by rename. The newest `keep` files and the best one stay. Not thread-safe.
class CheckpointSink {
 public:
  /// With a participant, checkpoints are published too, and those already in the folder at once,
  /// for subscribers that were there before a resumed run. What a killed run left half written is removed.
  /// @param waiting  called once a second while the disk has no room: that is waited for
  /// @error kUnavailable (disk, bus).
  static Result<CheckpointSink> Open(const Path& run_folder, const RunIdentity& run,
                                     const bus::Participant* participant, int keep = 3,
                                     const std::function<void()>& waiting = {});

  /// Under this run's name. Durable and named by `latest` (and `best`) when it returns. @error of the disk. A bus that
  /// does not take it is logged, not an error: the file is there and the next one will be tried.
  Result<Kept> Save(const checkpoint::Checkpoint& made);
  /// Whether the one of `step` is in the folder: files are the user's to remove.
  bool Has(std::uint64_t step) const;
  /// Whether the one that `best` names is.
  bool HasBest() const;
  /// Until those who follow the run have what was published, for half a minute at most; what they have not is logged.
  void AwaitSubscribers();
  std::uint64_t published() const { return published_; }

 private:
  CheckpointSink() = default;
  void Publish(const std::string& channel, std::span<const std::uint8_t> bytes, const checkpoint::Metadata& metadata);
  void PublishExisting();
  void PublishNamed(const std::string& channel);
  void PublishPromoted();
  Status Prune() const;

  Path folder_;
  Path best_;  // that `best` named when it was looked at last
  RunIdentity run_;
  std::unique_ptr<bus::BlobPublisher> publisher_;
  std::uint64_t published_ = 0;
  int keep_ = 3;
};

}  // namespace etude::publish
