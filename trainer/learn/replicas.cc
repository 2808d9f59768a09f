// SPDX-License-Identifier: Apache-2.0
#include "trainer/learn/replicas.h"

#include <dlfcn.h>
#include <pthread.h>

#include <exception>

#include "trainer/learn/tensors.h"
#include "trainer/policy/torch_error.h"

namespace etude::learn {

void SetBlasThreads(int threads) {
  using SetThreads = void (*)(int);
  if (const auto set = reinterpret_cast<SetThreads>(::dlsym(RTLD_DEFAULT, "openblas_set_num_threads"))) set(threads);
}

Replicas::Replicas(std::vector<std::shared_ptr<policy::Policy>> policies, int first, int parts)
    : policies_(std::move(policies)),
      first_(first),
      parts_(parts > 0 ? parts : static_cast<int>(policies_.size())),
      losses_(policies_.size()),
      errors_(policies_.size()) {
  for (std::size_t r = 1; r < policies_.size(); ++r) threads_.emplace_back([this, r] { Work(r); });
}

Replicas::~Replicas() {
  {
    const MutexLock lock(mutex_);
    stop_ = true;
  }
  start_.NotifyAll();
  for (auto& thread : threads_) thread.join();
}

void Replicas::RunPart(std::size_t replica) {
  const int part_number = first_ + static_cast<int>(replica);
  const int first = batch_->size * part_number / parts_, last = batch_->size * (part_number + 1) / parts_;
  errors_[replica] = {};
  losses_[replica] = {};
  if (first == last) return;
  try {
    auto& policy = *policies_[replica];
    const Part part = PartOf(*batch_, first, last, policy.device());
    const auto outputs = policy.Forward(part.inputs, level_);
    const auto loss = policy.Loss(part.inputs, outputs, part.labels, level_);
    // frozen parts alone, or modules whose labels this part of the batch lacks: nothing to learn from it
    if (loss.total.requires_grad()) loss.total.backward();
    losses_[replica] = {loss.total.item<double>(), loss.terms};
  } catch (const std::exception& error) {
    errors_[replica] = policy::TorchError("forward and backward", error);
  }
}

void Replicas::Work(std::size_t replica) {
  pthread_setname_np(pthread_self(), "replica");
  std::uint64_t seen = 0;
  while (const auto round = AwaitRound(seen)) {
    seen = *round;
    RunPart(replica);
    const MutexLock lock(mutex_);
    if (--running_ == 0) done_.NotifyOne();
  }
}

// The round after `seen`; none: it is over.
std::optional<std::uint64_t> Replicas::AwaitRound(std::uint64_t seen) {
  const MutexLock lock(mutex_);
  while (!stop_ && round_ == seen) start_.Wait(mutex_);
  return stop_ ? std::nullopt : std::optional(round_);
}

void Replicas::Begin() {
  {
    const MutexLock lock(mutex_);
    ++round_;
    running_ = threads_.size();
  }
  start_.NotifyAll();
}

void Replicas::AwaitOthers() {
  const MutexLock lock(mutex_);
  while (running_ > 0) done_.Wait(mutex_);
}

Result<BatchLoss> Replicas::Backward(data::Batch& batch, int level) {
  batch_ = &batch;
  level_ = level;
  Begin();
  RunPart(0);
  AwaitOthers();
  BatchLoss mean;
  for (std::size_t r = 0; r < policies_.size(); ++r) {
    if (!errors_[r].message.empty()) return Fail(errors_[r]);
    mean.total += losses_[r].total / size();
    for (const auto& [name, value] : losses_[r].terms) mean.terms[name] += value / size();
  }
  return mean;
}

}  // namespace etude::learn
