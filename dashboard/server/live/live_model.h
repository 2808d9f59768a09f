// SPDX-License-Identifier: Apache-2.0
// What messages on the bus make of a picture of it: campaigns with their workers, runs, policy servers, processes,
// events and topics. Pure, so that it is tested without a bus.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "services/bus/messages.h"
#include "services/bus/topology.h"
#include "services/core/clock.h"
#include "services/monitor/topics.h"

namespace etude::live {

using TimePoint = MonotonicClock::time_point;

/// A worker as it was heard last.
struct LiveWorker {
  bus::WorkerStatus status;
  TimePoint heard{};
  std::string strip;  ///< phases of the last 60 s, one letter each half second, oldest first
  std::deque<std::pair<TimePoint, std::uint64_t>> episodes;  ///< counts of the last 60 s, for a rate
  std::string last;                                          ///< outcome of its last attempt; "": not heard
  bool silence_told = false;                                 ///< that it fell silent is among the events
  /// Not heard for ten seconds: it speaks twice a second.
  bool Silent(TimePoint now) const;
  /// Episodes a minute over the 60 s before it was heard last; nullopt: not heard for long enough, or silent.
  std::optional<double> PerMinute(TimePoint now) const;
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
  std::string spec_json;  ///< of its announcement; "": not heard
  bool complete = false;
  std::deque<double> per_minute;  ///< a value each 10 s, oldest first, at most 60
  TimePoint sampled{};
  std::uint64_t committed = 0;  ///< at the last change
  TimePoint changed{};          ///< of `committed`
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

/// A policy server that says how it does; by itself, where `policies` has who announced a run's policy.
struct LiveServer {
  bus::PolicyStatus status;
  TimePoint heard{};
  TimePoint refused{};  ///< when it was heard that it refused once more; what it said last stays in `status`
  std::deque<std::pair<TimePoint, std::uint64_t>> answered;  ///< counts of the last 10 s, for a rate
  /// nullopt: not heard for long enough.
  std::optional<double> AnswersPerSecond() const;
};

/// What a process logged at warn and above, and that workers fell silent, which those cannot say themselves.
struct LiveEvent {
  bus::ProcessEvent event;
  /// Since 1970, that it is sorted by: when it was heard at the latest, so that of a clock that is ahead none is the
  /// newest for hours.
  std::uint64_t order_ms = 0;
};

/// Of what a worker makes, as short hashes.
struct WorkerPrint {
  std::string work;  ///< content number, spec and files
  std::string host;  ///< what its host's bytes depend on, as commits.jsonl has it; "": not said
};

/// By id. A copy for whoever reads; what went away stays for ten minutes, so that its end can be told.
struct LiveView {
  bool enabled = false;
  std::string error;  ///< why the bus is not read; "": it is
  std::map<std::string, LiveCampaign> campaigns;
  std::map<std::string, LiveRun> runs;
  std::vector<LivePolicy> policies;
  std::map<std::string, LiveServer> servers;  ///< by PolicyStatus::server, those heard within 10 s
  std::map<std::string, WorkerPrint> prints;  ///< by worker
  /// Those heard within a minute, less those that have ended: they took their endpoints with them at once. One that was
  /// killed stays, and is silent.
  monitor::Processes processes;
  std::shared_ptr<const std::deque<LiveEvent>> events = std::make_shared<std::deque<LiveEvent>>();  ///< newest first
  std::map<std::string, monitor::TopicRate> rates;  ///< by topic, over the last seconds
  /// What DDS has discovered; empty until it was looked at.
  std::shared_ptr<const std::vector<bus::PeerEndpoint>> endpoints = std::make_shared<std::vector<bus::PeerEndpoint>>();
  std::string participant;  ///< of who looks, as PeerEndpoint::participant
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
  void On(const std::string& id, const bus::WorkRequest& request);
  void On(const bus::PolicyStatus& status, TimePoint now);
  void On(const bus::ProcessStatus& status, TimePoint now);
  /// Several at once: the list is copied.
  void On(std::vector<bus::ProcessEvent> events);
  void Topics(std::vector<bus::PeerEndpoint> endpoints, const std::string& own, TimePoint now);

 private:
  void TellSilences(TimePoint now);

  LiveView view_;
  std::uint64_t silences_ = 0;  // number of the newest event of one
  monitor::TopicRates rates_;
  TimePoint rated_{};
};

}  // namespace etude::live
