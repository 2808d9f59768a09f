// SPDX-License-Identifier: Apache-2.0
// Reads what is on the bus now. Only topics of small messages are read; pictures, episodes and checkpoints pass by.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "dashboard/server/live/live_model.h"
#include "services/bus/arguments.h"
#include "services/bus/participant.h"
#include "services/core/result.h"
#include "services/core/thread_annotations.h"

namespace etude::live {

/// The newest message of a topic in one partition.
struct Sample {
  std::string partition;
  OrderedJson message;
  TimePoint heard{};
};

/// Reads the bus on a thread of its own from Start to its end. View and Newest are thread-safe.
class BusWatch {
 public:
  /// Never fails: while the bus cannot be had, the view says why, and it is tried again.
  explicit BusWatch(const bus::Arguments& arguments);
  ~BusWatch();
  BusWatch(const BusWatch&) = delete;
  BusWatch& operator=(const BusWatch&) = delete;

  /// Renewed four times a second.
  std::shared_ptr<const LiveView> View() const;
  /// The newest messages of a topic, by partition. It is read from the first call on, until nobody has asked for a few
  /// seconds: the first answer has what was heard before, that is, nothing. @error kNotFound: no topic of messages.h;
  /// kInvalidArgument: one that carries episodes; as SampleTap::Read
  Result<std::vector<Sample>> Newest(const std::string& topic);

 private:
  struct Wish {
    TimePoint until{};
    Result<std::vector<Sample>> samples;
  };
  Status Read(LiveModel& model, const std::stop_token& stop);
  void Run(std::stop_token stop);
  void Publish(const LiveView& view);
  void Serve(class SampleTap& tap);

  const bus::Arguments arguments_;
  mutable Mutex mutex_;
  std::shared_ptr<const LiveView> view_ ETUDE_GUARDED_BY(mutex_);
  std::map<std::string, Wish> wishes_ ETUDE_GUARDED_BY(mutex_);  // by topic
  std::jthread thread_;
};

}  // namespace etude::live
