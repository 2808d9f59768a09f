// SPDX-License-Identifier: Apache-2.0
// Play sessions on the bus: their states, the newest picture of those that somebody looks at, what their policy sees in
// it where that is asked for, and commands to them.
#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "services/bus/arguments.h"
#include "services/core/thread_annotations.h"
#include "services/play/client.h"
#include "services/policy/insight_viewer.h"

namespace etude::live {

/// Reads on a thread of its own from the first call on, so that a gateway that nobody plays at costs nothing.
/// Thread-safe.
class PlayWatch {
 public:
  explicit PlayWatch(const bus::Arguments& arguments) : arguments_(arguments) {}
  ~PlayWatch();
  PlayWatch(const PlayWatch&) = delete;
  PlayWatch& operator=(const PlayWatch&) = delete;

  struct Session {
    bus::PlayState state;
    std::int64_t age_ms = 0;
    std::uint64_t frame = 0;  ///< number of the newest picture that came; 0: none
  };
  /// Those that are live, by name. @error kUnavailable: no bus
  Result<std::vector<Session>> Sessions();
  /// One of them, whose pictures are read from now on for as long as somebody asks. @error kNotFound, kUnavailable
  Result<Session> Look(const std::string& name);
  /// Its newest picture. @error kNotFound: there is none yet; as Look
  Result<bus::PlayFrame> Frame(const std::string& name);
  /// What its policy saw in its newest decision and said of it. Shown from now on for as long as somebody asks: looking
  /// costs the policy server time. Nothing: none came yet. @error as Look
  struct Insight {
    std::uint64_t number = 0;  ///< of the newest, since somebody asked
    std::optional<policy::Insight> newest;
  };
  Result<Insight> LookInto(const std::string& name);
  /// See play::Client::Command. @error kUnavailable, too: the session has not answered the command before it
  Result<bus::PlayState> Command(const std::string& name, bus::PlayAction action, const OrderedJson& arguments);

 private:
  struct Watched {
    std::optional<play::Frames> frames;
    std::optional<bus::PlayFrame> newest;
    MonotonicClock::time_point asked{};
    std::optional<policy::InsightViewer> viewer;  // while somebody asks for insights
    Insight insight;
    MonotonicClock::time_point asked_into{};
  };

  Status Start();
  void Run(std::stop_token stop, play::Client client);
  void TakeFrames() ETUDE_REQUIRES(mutex_);
  void TakeInsights() ETUDE_REQUIRES(mutex_);
  void TakeInsight(const std::string& name, Watched& watched) ETUDE_REQUIRES(mutex_);

  const bus::Arguments arguments_;
  Mutex start_mutex_;  // taken before the others
  std::optional<bus::Participant> participant_ ETUDE_GUARDED_BY(start_mutex_);
  // Each session has its own: one that does not answer keeps nobody else's commands.
  struct Commander {
    std::mutex mutex;                    // etude::Mutex cannot be tried
    std::optional<play::Client> client;  // of who holds it
  };
  mutable Mutex mutex_;
  std::map<std::string, std::shared_ptr<Commander>> commanders_ ETUDE_GUARDED_BY(mutex_);
  std::map<std::string, play::HeardState> sessions_ ETUDE_GUARDED_BY(mutex_);
  std::map<std::string, Watched> watched_ ETUDE_GUARDED_BY(mutex_);
  const bus::Participant* reading_ ETUDE_GUARDED_BY(mutex_) = nullptr;
  std::jthread thread_;
};

}  // namespace etude::live
