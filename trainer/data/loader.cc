// SPDX-License-Identifier: Apache-2.0
#include "trainer/data/loader.h"

#include <pthread.h>

#include <algorithm>
#include <bit>

#include "services/core/log.h"

namespace etude::data {
namespace {
// unreadable pictures of one batch that are replaced before it is given up; of a larger one as many as it has
constexpr int kMaxReplacements = 100;
}  // namespace

Loader::Loader(std::shared_ptr<const Dataset> dataset, std::shared_ptr<const BatchMaker> maker,
               const DataConfig& config, std::uint64_t seed, std::uint64_t first_step)
    : dataset_(std::move(dataset)),
      maker_(std::move(maker)),
      config_(config),
      seed_(seed),
      next_to_make_(first_step),
      next_to_give_(first_step) {
  for (int i = 0; i < config_.threads; ++i) threads_.emplace_back([this] { Work(); });
}

Loader::~Loader() {
  {
    const MutexLock lock(mutex_);
    stop_ = true;
  }
  room_.NotifyAll();
  for (auto& thread : threads_) thread.join();
}

Result<std::unique_ptr<Batch>> Loader::MakeStep(std::uint64_t step, FrameScratch& scratch,
                                                std::unique_ptr<Batch> batch) {
  const auto snapshot = dataset_->snapshot();
  auto samples = DrawBatch(*snapshot, Split::kTrain, seed_, step, config_.batch, 0, config_.rest);
  for (int retry = 1;; ++retry) {
    std::size_t bad = 0;
    const Status status = maker_->Make(*snapshot, samples, step, Augment::kYes, scratch, *batch, &bad);
    if (status) return batch;
    if (samples.empty() || status.error().code == Code::kInvalidArgument ||
        retry > std::max(kMaxReplacements, config_.batch))
      return Fail(status.error().Wrap(fmt::format("make batch {}", step)));
    samples[bad] = DrawBatch(*snapshot, Split::kTrain, seed_, step, config_.batch, retry, config_.rest)[bad];
    const MutexLock lock(mutex_);
    // 1, 2, 4, 8, ...: a bad file would otherwise be a line a batch
    if (std::has_single_bit(++replaced_))
      Log().warn("replaced a picture that cannot be read (count={}): {}", replaced_, status.error().message);
  }
}

std::unique_ptr<Batch> Loader::TakeSpare() {
  if (spare_.empty()) return std::make_unique<Batch>();
  auto batch = std::move(spare_.back());
  spare_.pop_back();
  return batch;
}

void Loader::Work() {
  pthread_setname_np(pthread_self(), "loader");
  const auto ahead = static_cast<std::uint64_t>(config_.prefetch);
  FrameScratch scratch;
  while (true) {
    std::uint64_t step = 0;
    std::unique_ptr<Batch> batch;
    {
      const MutexLock lock(mutex_);
      while (!stop_ && next_to_make_ >= next_to_give_ + ahead) room_.Wait(mutex_);
      if (stop_) return;
      step = next_to_make_++;
      batch = TakeSpare();
    }
    auto result = MakeStep(step, scratch, std::move(batch));
    {
      const MutexLock lock(mutex_);
      ready_.emplace(step, std::move(result));
    }
    made_.NotifyAll();
  }
}

Result<std::unique_ptr<Batch>> Loader::Next() {
  const MutexLock lock(mutex_);
  while (!ready_.contains(next_to_give_)) made_.Wait(mutex_);
  auto node = ready_.extract(next_to_give_);
  ++next_to_give_;
  room_.NotifyOne();
  return std::move(node.mapped());
}

void Loader::Recycle(std::unique_ptr<Batch> batch) {
  const MutexLock lock(mutex_);
  spare_.push_back(std::move(batch));
}

std::uint64_t Loader::replaced_frames() const {
  const MutexLock lock(mutex_);
  return replaced_;
}

}  // namespace etude::data
