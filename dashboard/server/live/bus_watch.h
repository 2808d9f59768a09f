// SPDX-License-Identifier: Apache-2.0
// What is on the bus now: campaigns with their workers, runs, policy servers. Only topics of small messages are read;
// pictures, episodes and checkpoints pass by.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "services/bus/arguments.h"
#include "services/bus/messages.h"
#include "services/bus/participant.h"
#include "services/core/clock.h"
#include "services/core/thread_annotations.h"

namespace etude::live {

using TimePoint = MonotonicClock::time_point;

/// A worker as it was heard last.
struct LiveWorker {
  bus::WorkerStatus status;
  TimePoint heard{};
  std::string strip;                            ///< phases of the last 60 s, one letter each half second, oldest first
  std::deque<std::pair<TimePoint, std::uint64_t>> episodes;  ///< counts of the last 60 s, for a rate
  std::string last;                             ///< outcome of its last attempt; "": not heard
  /// Episodes a minute over the last 60 s; nullopt: not heard for long enough.
  std::optional<double> PerMinute() const;
};

/// A failed attempt that was heard.
struct LiveAttempt {
  bus::AttemptReport report;
  double t = 0;  ///< seconds since 1970
};

struct LiveCampaign {
  bus::Presence presence;
  bool present = false;  ///< its collector is there now
  std::optional<bus::CampaignStatus> status;
  TimePoint heard{};
  std::string spec_json;            ///< of its announcement; "": not heard
  bool complete = false;
  std::deque<double> per_minute;    ///< a value each 10 s, oldest first, at most 60
  TimePoint sampled{};
  std::uint64_t committed = 0;      ///< at the last change
  TimePoint changed{};              ///< of `committed`
  std::map<std::string, LiveWorker> workers;
  std::deque<LiveAttempt> attempts;  ///< newest first, at most 200
};

struct LiveRun {
  bus::Presence presence;
  bool present = false;
  std::optional<bus::TrainStatus> status;
  TimePoint heard{};
};

struct LivePolicy {
  bus::Presence presence;
};

/// By id. A copy for whoever reads; what went away stays for ten minutes, so that its end can be told.
struct LiveView {
  bool enabled = false;
  std::string error;  ///< why the bus is not read; "": it is
  std::map<std::string, LiveCampaign> campaigns;
  std::map<std::string, LiveRun> runs;
  std::vector<LivePolicy> policies;
};

/// How long ago, ms.
std::int64_t AgeMs(TimePoint heard);

/// What messages make of a view; pure, so that it is tested without a bus. Not thread-safe.
class LiveModel {
 public:
  LiveView& view() { return view_; }
  void Directory(const std::vector<bus::Presence>& present, TimePoint now);
  void On(const std::string& id, const bus::CampaignStatus& status, TimePoint now);
  void On(const std::string& id, const bus::CampaignAnnouncement& announcement, TimePoint now);
  void On(const std::string& id, const bus::WorkerStatus& status, TimePoint now);
  void On(const std::string& id, const bus::AttemptReport& report, TimePoint now, double wall);
  void On(const std::string& id, const bus::TrainStatus& status, TimePoint now);

 private:
  LiveView view_;
};

/// Reads the bus on a thread of its own from Start to its end. View is thread-safe.
class BusWatch {
 public:
  /// Never fails: where the bus cannot be had, the view says why.
  explicit BusWatch(const bus::Arguments& arguments);
  ~BusWatch();
  BusWatch(const BusWatch&) = delete;
  BusWatch& operator=(const BusWatch&) = delete;

  /// Renewed four times a second.
  std::shared_ptr<const LiveView> View() const;

 private:
  void Run(std::stop_token stop);
  void Publish(const LiveView& view);

  const bus::Arguments arguments_;
  mutable Mutex mutex_;
  std::shared_ptr<const LiveView> view_ ETUDE_GUARDED_BY(mutex_);
  std::jthread thread_;
};

}  // namespace etude::live
