// SPDX-License-Identifier: Apache-2.0
// A worker's sign of life, on a thread of its own: an attempt takes seconds and must not cost its lease.
// Internal to services/campaign.
#pragma once

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <stop_token>
#include <thread>
#include <utility>

#include "services/bus/topic.h"
#include "services/campaign/worker_client.h"
#include "services/core/log.h"
#include "services/core/thread_annotations.h"

namespace etude::campaign {

/// Writes the status now and then until it ends. Thread-safe.
class Heartbeat {
 public:
  Heartbeat(bus::Writer<bus::WorkerStatus> writer, bus::WorkerStatus status, std::chrono::milliseconds period)
      : writer_(std::move(writer)), status_(std::move(status)), period_(period) {
    thread_ = std::jthread([this](const std::stop_token& stop) { Beat(stop); });
  }
  ~Heartbeat() {
    thread_.request_stop();
    thread_.join();
    // the collector need not wait for it
    SetPhase(bus::kGonePhase);
    (void)writer_.Write(Current());
    // the worker is gone for good: late joiners need not see it
    (void)writer_.Dispose(status_);
  }
  Heartbeat(const Heartbeat&) = delete;
  Heartbeat& operator=(const Heartbeat&) = delete;

  template <class Change>
  void Set(const Change& change) {
    const MutexLock lock(mutex_);
    change(status_);
  }
  void SetPhase(const char* phase) {
    Set([&](bus::WorkerStatus& status) { status.phase = phase; });
  }

 private:
  bus::WorkerStatus Current() {
    const MutexLock lock(mutex_);
    return status_;
  }
  void Beat(const std::stop_token& stop) {
    std::unique_lock lock(sleep_mutex_);
    while (!stop.stop_requested()) {
      if (const Status written = writer_.Write(Current()); !written)
        Log().debug("heartbeat: {}", written.error().message);
      wake_.wait_for(lock, stop, period_, [] { return false; });
    }
  }

  bus::Writer<bus::WorkerStatus> writer_;
  Mutex mutex_;
  bus::WorkerStatus status_ ETUDE_GUARDED_BY(mutex_);
  std::chrono::milliseconds period_;
  std::mutex sleep_mutex_;
  std::condition_variable_any wake_;
  std::jthread thread_;
};

}  // namespace etude::campaign
