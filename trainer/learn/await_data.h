// SPDX-License-Identifier: Apache-2.0
// A dataset that is still being collected: waiting for enough of it, and looking at it again.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <thread>

#include "services/core/thread_annotations.h"
#include "trainer/data/dataset.h"
#include "trainer/learn/config.h"

namespace etude::learn {

struct AwaitOptions {
  bool follow = false;                         ///< the dataset still grows
  std::chrono::milliseconds patience{60'000};  ///< a collector that is silent for this long brings nothing more
  std::function<Status()> source;              ///< how the collector is; an error ends the wait. Empty: unknown
  std::function<bool()> over;                  ///< whether it has ended, so that nothing more comes. Empty: unknown
  bool alone = true;                           ///< then less than was asked for will do; ranks have to agree
};

/// Reads `dataset` until there is enough to fix normalisation and the validation set: frames in both splits and, when
/// it grows, data.min_episodes training and data.min_valid validation episodes (fewer when the campaign has fewer),
/// with every task that the campaign plans among them (or
/// twice as many without).
/// @error kInvalidArgument: a campaign that plans no episode of one of the splits; kNotFound: a finished dataset
/// without frames, or one whose collector has ended with less than was asked for; kExhausted: silence, with less than
/// was asked for; kUnavailable: a stop was requested; of the source.
Status AwaitData(data::Dataset& dataset, const TrainConfig& config, const AwaitOptions& options);

/// Looks at a growing dataset now and then, on a thread of its own, until it is destroyed.
class Follower {
 public:
  Follower(std::shared_ptr<data::Dataset> dataset, double every_s);
  ~Follower();
  Follower(const Follower&) = delete;
  Follower& operator=(const Follower&) = delete;

 private:
  void Work();

  const std::shared_ptr<data::Dataset> dataset_;
  const std::chrono::duration<double> every_;
  Mutex mutex_;
  ConditionVariable wake_;
  bool stop_ ETUDE_GUARDED_BY(mutex_) = false;
  std::thread thread_;  // last: it uses all of the above
};

}  // namespace etude::learn
