// SPDX-License-Identifier: Apache-2.0
// Who wants to look into the policy while it answers, and what they are shown.
//
// A viewer writes bus::InsightWish on the run's partition and says it again before it ends; while one stands, the
// server shows each observation of that session, at most kPerSecond of them, as bus::Insight; of a wish for all
// sessions so many of each. Insight::attention_json says where each module's attention lies in Insight::attention:
//   {"TAR2D": {"offset": 2880, "heads": 4, "image": [20, 36], "keys": ["language"], "scale": [0.41, ...]}, ...}
// for each head one byte a token of the picture's grid (row by row), then one a key; weight = byte / 255 * scale[head].
// Insight::worth_json, where the wish asks for it ("worth" in trainer/policy/what_if.h), says how far, in m, the
// planned waypoints move without each word of the sentence, and with each joint where it is on average in training:
//   {"words": [{"word": "push", "moves": 0.012}, ...], "joints": [0.001, ...]}
#pragma once

#include <atomic>
#include <map>
#include <memory>
#include <string>
#include <thread>

#include "services/bus/topic.h"
#include "services/core/clock.h"
#include "services/core/thread_annotations.h"
#include "trainer/serve/model.h"

namespace etude::serve {

/// Works on a thread of its own, of low priority: robots are answered first, and without a wish nothing is computed.
class InsightDesk {
 public:
  static constexpr int kPerSecond = bus::kInsightsPerSecond;  ///< of each session, for each viewer

  /// @param partition  of the run @param run_id  whose wishes count
  static Result<std::unique_ptr<InsightDesk>> Open(const bus::Participant& participant, const std::string& partition,
                                                   const std::string& run_id);
  ~InsightDesk();
  InsightDesk(const InsightDesk&) = delete;
  InsightDesk& operator=(const InsightDesk&) = delete;

  /// Of an observation that `model` answers. Copies it while a wish stands for its session. Never waits. Any thread.
  void Offer(const bus::Observation& observation, const std::shared_ptr<const Model>& model) ETUDE_EXCLUDES(mutex_);
  /// Whether a session is that of a viewer who looks at nothing but questions of his own (policy::InsightClient). Any
  /// thread.
  bool IsLookers(const std::string& session) ETUDE_EXCLUDES(mutex_);
  /// Insights that were sent.
  std::uint64_t shown() const { return shown_; }

 private:
  struct Wish {
    bus::InsightWish text;
    MonotonicClock::time_point until;
    std::map<std::string, MonotonicClock::time_point> next;  ///< by session, when it may be shown again
  };
  struct Offered {
    bus::Observation observation;
    std::shared_ptr<const Model> model;
  };

  InsightDesk(bus::Reader<bus::InsightWish> wishes, bus::Writer<bus::Insight> insights, std::string run_id);
  void Work() ETUDE_EXCLUDES(mutex_);
  void TakeWishes() ETUDE_EXCLUDES(mutex_);
  void Show(const Offered& offered) ETUDE_EXCLUDES(mutex_);

  bus::Reader<bus::InsightWish> reader_ ETUDE_GUARDED_BY(mutex_);
  bus::Writer<bus::Insight> writer_;
  const std::string run_id_;
  std::atomic<bool> stop_{false}, wanted_{false};
  std::atomic<std::uint64_t> shown_{0};
  Mutex mutex_;
  ConditionVariable offered_;
  std::map<std::string, Wish> wishes_ ETUDE_GUARDED_BY(mutex_);      // by viewer
  std::map<std::string, Offered> pending_ ETUDE_GUARDED_BY(mutex_);  // by session, the newest
  std::thread thread_;
};

}  // namespace etude::serve
