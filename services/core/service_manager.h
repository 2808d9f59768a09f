// SPDX-License-Identifier: Apache-2.0
// What a process tells the service manager that started it (systemd: Type=notify): when it is ready, what it is at,
// that it moves, that it stops. The protocol is a datagram to $NOTIFY_SOCKET, see sd_notify(3); without that variable
// nothing is said, so that programs call these wherever they run.
//
//   WatchedLoop loop;
//   ServiceManager::Get().Ready("campaign quickstart");
//   while (!StopRequested()) { …; loop.Moved(); }
#pragma once

#include <chrono>
#include <map>
#include <memory>
#include <string>
#include <string_view>

#include "services/core/clock.h"
#include "services/core/thread_annotations.h"

namespace etude {

/// Thread-safe. Never fails: a manager that does not listen must not end a service.
class ServiceManager {
 public:
  struct Environment {
    std::string socket;  ///< $NOTIFY_SOCKET: a path, or "@name" of Linux's abstract ones; "": nobody listens
    std::chrono::microseconds
        watchdog{};  ///< $WATCHDOG_USEC; 0: no watchdog, or one of another process ($WATCHDOG_PID)
  };
  static Environment FromEnvironment();

  /// This process's, with the environment as it is at the first call.
  static ServiceManager& Get();
  explicit ServiceManager(const Environment& environment);
  ~ServiceManager();
  ServiceManager(const ServiceManager&) = delete;
  ServiceManager& operator=(const ServiceManager&) = delete;

  /// The service can be used from now on. `status`: a line for people. Only the first call says so.
  void Ready(std::string_view status);
  /// What it is at, a line for people; the same line again, and more than one a second, are not sent.
  void Say(std::string_view status);
  /// It drains; only the first call says so, and only what was ready stops. WatchedLoop calls it for a stop request.
  void Stopping();

  /// Whether one started this process, now: it starts it again, but not after an error of usage.
  static bool IsThere();

  /// Variables that a child process must not inherit: it would speak in this one's name.
  static constexpr const char* kVariables[] = {"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"};

 private:
  friend class WatchedLoop;
  void Join(const void* loop);
  void Leave(const void* loop);
  void Moved(const void* loop, MonotonicClock::time_point now);
  void Send(std::string_view message) ETUDE_REQUIRES(mutex_);

  const std::chrono::microseconds watchdog_;
  Mutex mutex_;
  struct Socket;
  const std::unique_ptr<Socket> socket_;
  bool ready_ ETUDE_GUARDED_BY(mutex_) = false;
  bool stopping_ ETUDE_GUARDED_BY(mutex_) = false;
  std::string status_ ETUDE_GUARDED_BY(mutex_);
  MonotonicClock::time_point said_ ETUDE_GUARDED_BY(mutex_) = {};
  MonotonicClock::time_point fed_ ETUDE_GUARDED_BY(mutex_) = {};
  std::map<const void*, MonotonicClock::time_point> loops_ ETUDE_GUARDED_BY(mutex_);  // when each moved last
};

/// A loop without which the process does not do its work. The watchdog is fed only while every one of them has gone
/// round within its interval: a process hangs when one of its loops does, whatever its other threads do.
/// Thread safety: one thread each, and the manager outlives it.
class WatchedLoop {
 public:
  explicit WatchedLoop(ServiceManager& manager = ServiceManager::Get());
  ~WatchedLoop();
  WatchedLoop(const WatchedLoop&) = delete;
  WatchedLoop& operator=(const WatchedLoop&) = delete;

  /// Once a round, also of waiting that is right (for work, for space on a disk). Costs two reads of a clock.
  void Moved(MonotonicClock::time_point now = MonotonicClock::now());

 private:
  ServiceManager& manager_;
  MonotonicClock::time_point told_ = {};
};

}  // namespace etude
