// SPDX-License-Identifier: Apache-2.0
// Takes manifests off DDS in the thread that received them. Internal to services/bus.
#pragma once

#include <deque>
#include <memory>

#include "services/bus/serialized.h"
#include "services/core/thread_annotations.h"

namespace etude::bus {

struct TakenManifest {
  Serialized sample;
  ManifestView view;      ///< points into the sample
  bool is_sound = false;  ///< parsed, and its sizes fit together
};

class ManifestIntake {
 public:
  static Result<std::unique_ptr<ManifestIntake>> Open(const Participant& participant, const std::string& partition);
  /// Wakes `waiter` when there is something to take, or as much as WakeAfter said.
  Status Attach(Waiter& waiter) { return waiter.AddGuard(guard_); }
  /// From now on waits for `count` manifests (at least 1) before it wakes.
  void WakeAfter(std::size_t count);
  /// Everything received since the last call, oldest first.
  std::deque<TakenManifest> Take();

 private:
  ManifestIntake() = default;
  static void OnData(dds_entity_t reader, void* intake);
  void Drain();

  Mutex mutex_;
  std::deque<TakenManifest> taken_ ETUDE_GUARDED_BY(mutex_);
  std::size_t wake_after_ ETUDE_GUARDED_BY(mutex_) = 1;
  Entity guard_;
  Endpoint reader_;  // last: its end waits for the callback
};

}  // namespace etude::bus
