// SPDX-License-Identifier: Apache-2.0
// What PolicyServer's threads share. `follower` takes checkpoints (server_checkpoints.cc); each domain's own answers
// observations (server_desk.cc). Internal to trainer/serve.
#pragma once

#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "services/bus/addressed_writers.h"
#include "services/bus/directory.h"
#include "services/bus/topic.h"
#include "services/core/clock.h"
#include "services/core/service_manager.h"
#include "services/core/stop.h"
#include "services/core/thread_annotations.h"
#include "trainer/serve/insight.h"
#include "trainer/serve/server.h"

namespace etude::serve {
namespace internal {

// What is served now, and under which run's id.
struct Served {
  std::string run_id;
  std::shared_ptr<const Model> model;
  std::uint64_t since = 0;  // seconds since 1970
};

// Where observations of one run come in and actions go out.
struct Desk {
  std::string run_id;
  bus::Announcement presence;
  bus::AddressedWriters<bus::Action> actions;
  bus::Reader<bus::Observation> observations;
  bus::Writer<bus::PolicyStatus> statuses;
  std::unique_ptr<InsightDesk> insights;  // null: nobody may look into the policy here
};

// Who asks: several hosts may name their sessions alike.
struct Asker {
  std::string session, host;
  auto operator<=>(const Asker&) const = default;
};
struct Asked {
  MonotonicClock::time_point last, answered;
};

// A DDS domain whose observations are answered, by one thread.
struct Front {
  const bus::Participant* participant = nullptr;
  bool insights = true;  // robots' domains take observations and nothing else
  std::optional<Desk> desk = {};
  std::map<Asker, Asked> sessions = {};
  MonotonicClock::time_point looked = MonotonicClock::now();  // until then all that had come was taken
  std::optional<Stopwatch> since_status = {};
  // Before there is a desk: who waits here is told by it that this is a server, and admits it.
  std::optional<bus::Writer<bus::Presence>> known = {};
};

}  // namespace internal

struct PolicyServer::Impl {
  ServerOptions options;
  internal::Front front;                  // where checkpoints come from, too
  std::optional<internal::Front> robots;  // a domain of their own
  std::thread follower;
  std::atomic<bool> stop{false};
  std::atomic<std::uint64_t> answered{0}, refused{0}, refused_observations{0};
  const std::string name = bus::UniquePeerName();

  LatencyMeter latency;
  mutable Mutex mutex;
  internal::Served served ETUDE_GUARDED_BY(mutex);
  Status follow_status ETUDE_GUARDED_BY(mutex);
  std::string last_refusal ETUDE_GUARDED_BY(mutex);

  ~Impl() {
    stop = true;
    if (follower.joinable()) follower.join();
  }
  internal::Served Current() const ETUDE_EXCLUDES(mutex) {
    const MutexLock lock(mutex);
    return served;
  }
  bool Stopping() const { return stop || StopRequested(); }

  Status FollowRuns();
  Status FollowRun(bus::Directory& directory, const std::string& run_id, const std::string& user, WatchedLoop& watched);
  Status Judge(const bus::PublishedBlob& blob);
  void TakeCheckpoint(const bus::PublishedBlob& blob);
  void Serve(const std::string& run_id, std::shared_ptr<const Model> fresh) ETUDE_EXCLUDES(mutex);
  void TryOut(const Model& fresh);
  void NoteRefusal(const std::string& reason) ETUDE_EXCLUDES(mutex);
  void CountCorrupt(std::uint64_t count);
  void PublishStatus(internal::Front& at);
  Status OpenDesk(internal::Front& at, const std::string& run_id);
  bool IsOurs(const internal::Desk& desk, const bus::Observation& observation);
  void NoteAlike(const internal::Front& at, const internal::Asker& asker);
  void AnswerAll(internal::Front& at, const std::vector<bus::Observation>& observations,
                 MonotonicClock::time_point arrived);
  void Send(internal::Desk& desk, bus::Action& action, const std::string& host, const Latency& measured);
  Status ServeAt(internal::Front& at);
};

}  // namespace etude::serve
