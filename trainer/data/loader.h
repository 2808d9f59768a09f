// SPDX-License-Identifier: Apache-2.0
// Batches made ahead by threads and handed out in order.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

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
  Result<std::unique_ptr<Batch>> MakeStep(std::uint64_t step, FrameScratch& scratch, std::unique_ptr<Batch> batch);

  const std::shared_ptr<const Dataset> dataset_;
  const std::shared_ptr<const BatchMaker> maker_;
  const DataConfig config_;
  const std::uint64_t seed_;

  mutable std::mutex mutex_;
  std::condition_variable made_, room_;
  std::uint64_t next_to_make_, next_to_give_;
  std::map<std::uint64_t, Result<std::unique_ptr<Batch>>> ready_;
  std::vector<std::unique_ptr<Batch>> spare_;
  std::uint64_t replaced_ = 0;
  bool stop_ = false;
  std::vector<std::thread> threads_;  // last: they use all of the above
};

}  // namespace etude::data
