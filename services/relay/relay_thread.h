// SPDX-License-Identifier: Apache-2.0
// A relay beside whatever else a process does.
#pragma once

#include <atomic>
#include <thread>

#include "services/relay/relay.h"

namespace etude::relay {

/// RelayRuns on a thread of its own until it is destroyed or a stop is requested. What ends it before is logged, and it
/// is tried again every few seconds: the process that it is beside goes on meanwhile. The participant must outlive it.
class RelayThread {
 public:
  RelayThread(const bus::Participant& participant, const Selector& selector, const RelayOptions& options);
  ~RelayThread();
  RelayThread(const RelayThread&) = delete;
  RelayThread& operator=(const RelayThread&) = delete;

 private:
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace etude::relay
