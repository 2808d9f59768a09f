// SPDX-License-Identifier: Apache-2.0
// Forward and backward of one batch on several copies of the network, side by side.
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "services/core/thread_annotations.h"
#include "trainer/data/batch.h"
#include "trainer/policy/policy.h"

namespace etude::learn {

/// Threads of OpenBLAS, which are separate from torch's. With replicas side by side they must be as
/// few as the threads inside an operation: two callers otherwise spin for one pool (45 % of the
/// time with two replicas). No effect with another BLAS.
void SetBlasThreads(int threads);

/// Mean over the replicas.
struct BatchLoss {
  double total = 0;
  std::map<std::string, double> terms;
};

/// Owns the threads of replicas 1.. (replica 0 runs on the caller's). The result does not depend on
/// timing: every replica has its own part of the batch and its own gradients. Not thread-safe.
class Replicas {
 public:
  /// @param first, parts  these replicas take parts `first`, `first` + 1, ... of as many as every batch is cut into;
  ///                      0: there are no others
  explicit Replicas(std::vector<std::shared_ptr<policy::Policy>> policies, int first = 0, int parts = 0);
  ~Replicas();
  Replicas(const Replicas&) = delete;
  Replicas& operator=(const Replicas&) = delete;

  policy::Policy& front() { return *policies_.front(); }
  int size() const { return static_cast<int>(policies_.size()); }
  /// Loss of modules of level <= `level`, and its gradients.
  Result<BatchLoss> Backward(data::Batch& batch, int level);

 private:
  void RunPart(std::size_t replica);
  void Work(std::size_t replica);
  std::optional<std::uint64_t> AwaitRound(std::uint64_t seen) ETUDE_EXCLUDES(mutex_);
  void Begin() ETUDE_EXCLUDES(mutex_);
  void AwaitOthers() ETUDE_EXCLUDES(mutex_);

  std::vector<std::shared_ptr<policy::Policy>> policies_;
  const int first_, parts_;
  // written by the caller between rounds; in a round each replica writes its own loss and error alone
  data::Batch* batch_ = nullptr;
  int level_ = 0;
  std::vector<BatchLoss> losses_;
  std::vector<Error> errors_;  ///< without words: none

  Mutex mutex_;
  ConditionVariable start_, done_;
  std::uint64_t round_ ETUDE_GUARDED_BY(mutex_) = 0;
  std::size_t running_ ETUDE_GUARDED_BY(mutex_) = 0;
  bool stop_ ETUDE_GUARDED_BY(mutex_) = false;
  std::vector<std::thread> threads_;
};

}  // namespace etude::learn
