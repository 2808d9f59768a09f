// SPDX-License-Identifier: Apache-2.0
// Named places where a fault test may end the process, as a power failure or an OOM kill would: no destructor runs.
//
//   CrashPoint("collector.before_ack", index);
//
//   ETUDE_CRASH_AT=collector.before_ack      SIGKILL when it is reached first
//   ETUDE_CRASH_AT=collector.before_ack:3    the third time
//   ETUDE_CRASH_LOG=FILE                     appends a line "NAME NUMBER" each time that any of them is reached
//
// Compiled always, so that what is tested is what runs: without these variables a point costs one branch.
#pragma once

#include <cstdint>
#include <string_view>

namespace etude {

namespace internal {
extern const bool kCrashPointsArmed;  // one of the variables was set when the process began
void ReachCrashPoint(std::string_view name, std::uint64_t number);
}  // namespace internal

/// `number` is for the log only, e.g. which episode. Thread-safe.
inline void CrashPoint(std::string_view name, std::uint64_t number = 0) {
  if (internal::kCrashPointsArmed) internal::ReachCrashPoint(name, number);
}

}  // namespace etude
