// SPDX-License-Identifier: Apache-2.0
// Where a trainer's checkpoints go: files first, then the bus.
#pragma once

#include <memory>
#include <string>

#include "services/bus/object_channel.h"
#include "services/core/file.h"
#include "trainer/learn/trainer.h"

namespace etude::publish {

inline constexpr char kLatest[] = "latest";
inline constexpr char kBest[] = "best";

/// RUN/checkpoints/00001500.safetensors, with links latest.safetensors and best.safetensors; each
/// by rename. The newest `checkpoint.keep` files and the best one stay. Not thread-safe.
class CheckpointSink {
 public:
  /// With a participant, checkpoints are published too, and those already in the folder at once,
  /// for subscribers that were there before a resumed run. @error kUnavailable (disk, bus).
  static Result<CheckpointSink> Open(const Path& run_folder, const std::string& run_name,
                                     const bus::Participant* participant);

  /// Durable and named by `latest` (and `best`) when it returns. @error of the disk. A bus that
  /// does not take it is logged, not an error: the file is there and the next one will be tried.
  Status Save(const learn::CheckpointRequest& request);
  std::uint64_t published() const { return published_; }

 private:
  CheckpointSink() = default;
  void Publish(const std::string& channel, std::span<const std::uint8_t> bytes, const OrderedJson& meta);
  void PublishExisting();
  Status Prune(int keep) const;

  Path folder_;
  std::string run_;
  std::unique_ptr<bus::ObjectPublisher> publisher_;
  std::uint64_t start_ = 0;  ///< starts of this run: versions grow over restarts
  std::uint64_t published_ = 0;
};

/// "Out/My Run" -> "my-run": a plain name for a folder.
std::string RunNameOf(const Path& folder);

}  // namespace etude::publish
