// SPDX-License-Identifier: Apache-2.0
// Batches made ahead by threads and handed out in order.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <thread>
#include <vector>

#include "services/core/thread_annotations.h"
#include "trainer/data/batch.h"

namespace etude::data {

/// Makes training batches `first_step`, `first_step` + 1, ... of `dataset`. Next is called from one
/// thread. A picture that cannot be read is counted, logged and replaced by another draw.
class Loader {
 public:
  Loader(std::shared_ptr<const Dataset> dataset, std::shared_ptr<const BatchMaker> maker, const DataConfig& config,
         std::uint64_t seed, std::uint64_t first_step);
  ~Loader();
  Loader(const Loader&) = delete;
  Loader& operator=(const Loader&) = delete;

  /// The next batch in order; waits for it. Give it back with Recycle.
  /// @error what kept the batch from being made (all pictures unreadable, no frames).
  Result<std::unique_ptr<Batch>> Next();
  /// Lets the batch's buffers be used again.
  void Recycle(std::unique_ptr<Batch> batch);

  std::uint64_t replaced_frames() const;

 private:
  void Work();
  std::unique_ptr<Batch> TakeSpare() ETUDE_REQUIRES(mutex_);
  Result<std::unique_ptr<Batch>> MakeStep(std::uint64_t step, FrameScratch& scratch, std::unique_ptr<Batch> batch);

  const std::shared_ptr<const Dataset> dataset_;
  const std::shared_ptr<const BatchMaker> maker_;
  const DataConfig config_;
  const std::uint64_t seed_;

  mutable Mutex mutex_;
  ConditionVariable made_, room_;
  std::uint64_t next_to_make_ ETUDE_GUARDED_BY(mutex_), next_to_give_ ETUDE_GUARDED_BY(mutex_);
  std::map<std::uint64_t, Result<std::unique_ptr<Batch>>> ready_ ETUDE_GUARDED_BY(mutex_);
  std::vector<std::unique_ptr<Batch>> spare_ ETUDE_GUARDED_BY(mutex_);
  std::uint64_t replaced_ ETUDE_GUARDED_BY(mutex_) = 0;
  bool stop_ ETUDE_GUARDED_BY(mutex_) = false;
  std::vector<std::thread> threads_;  // last: they use all of the above
};

}  // namespace etude::data
