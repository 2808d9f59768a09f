// SPDX-License-Identifier: Apache-2.0
#include "trainer/data/loader.h"

#include <pthread.h>

#include <bit>

#include "services/core/log.h"

namespace etude::data {
namespace {
// unreadable pictures of one batch that are replaced before it is given up
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
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  room_.notify_all();
  for (auto& thread : threads_) thread.join();
}

Result<std::unique_ptr<Batch>> Loader::MakeStep(std::uint64_t step, FrameScratch& scratch,
                                                std::unique_ptr<Batch> batch) {
  const auto snapshot = dataset_->snapshot();
  auto samples = DrawBatch(*snapshot, Split::kTrain, seed_, step, config_.batch);
  for (int retry = 1;; ++retry) {
    std::size_t bad = 0;
    const Status status = maker_->Make(*snapshot, samples, step, Augment::kYes, scratch, *batch, &bad);
    if (status) return batch;
    if (samples.empty() || status.error().code == Code::kInvalidArgument || retry > kMaxReplacements)
      return Fail(status.error().Wrap(fmt::format("make batch {}", step)));
    samples[bad] = DrawBatch(*snapshot, Split::kTrain, seed_, step, config_.batch, retry)[bad];
    const std::lock_guard lock(mutex_);
    // 1, 2, 4, 8, ...: a bad file would otherwise be a line a batch
    if (std::has_single_bit(++replaced_))
      Log().warn("replaced a picture that cannot be read (count={}): {}", replaced_, status.error().message);
  }
}

void Loader::Work() {
  pthread_setname_np(pthread_self(), "loader");
  FrameScratch scratch;
  std::unique_lock lock(mutex_);
  while (true) {
    room_.wait(lock,
               [&] { return stop_ || next_to_make_ < next_to_give_ + static_cast<std::uint64_t>(config_.prefetch); });
    if (stop_) return;
    const std::uint64_t step = next_to_make_++;
    auto batch = spare_.empty() ? std::make_unique<Batch>() : std::move(spare_.back());
    if (!spare_.empty()) spare_.pop_back();
    lock.unlock();
    auto result = MakeStep(step, scratch, std::move(batch));
    lock.lock();
    ready_.emplace(step, std::move(result));
    made_.notify_all();
  }
}

Result<std::unique_ptr<Batch>> Loader::Next() {
  std::unique_lock lock(mutex_);
  made_.wait(lock, [&] { return ready_.contains(next_to_give_); });
  auto node = ready_.extract(next_to_give_);
  ++next_to_give_;
  room_.notify_one();
  return std::move(node.mapped());
}

void Loader::Recycle(std::unique_ptr<Batch> batch) {
  const std::lock_guard lock(mutex_);
  spare_.push_back(std::move(batch));
}

std::uint64_t Loader::replaced_frames() const {
  const std::lock_guard lock(mutex_);
  return replaced_;
}

}  // namespace etude::data
