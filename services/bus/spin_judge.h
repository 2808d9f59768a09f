// SPDX-License-Identifier: Apache-2.0
// Finds threads of the library that turn without an end. Peers of a foreign authority that time out in the same
// millisecond can make two of them do so for ever (eclipse-cyclonedds/cyclonedds#1548): nobody is admitted any more,
// and nothing says so. Internal to services/bus.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace etude::bus {

struct ThreadTime {
  std::uint64_t id = 0;
  std::string name;  ///< at most 15 bytes, as the kernel has it
  double cpu_s = 0;  ///< that it has taken since its start
};

/// One line of /proc/PID/task/ID/stat. Nothing when it is none.
std::optional<ThreadTime> ParseThreadStat(const std::string& line);
/// The threads of this process; none without /proc.
std::vector<ThreadTime> ThreadTimes();

/// Apart from the kernel, so that it can be tested. Not thread-safe.
class SpinJudge {
 public:
  static constexpr double kSpinningS = 30;  ///< for so long
  /// Share of a core that is one that turns: on a busy machine others take some of it. At work these threads need less
  /// than a hundredth.
  static constexpr double kBusy = 0.8;

  /// @param now_s  of a clock that never goes back
  /// @param admitted  peers that were ever admitted: while that grows the threads are at work (handshakes of many who
  ///                  join at once), however long it takes
  /// @returns the first one of the library's `fsm` and `gc` that has been turning for kSpinningS
  std::optional<ThreadTime> Look(const std::vector<ThreadTime>& threads, double now_s, std::uint64_t admitted = 0);

 private:
  struct Seen {
    double at_s = 0, cpu_s = 0;
    double busy_since_s = 0;
  };
  std::map<std::uint64_t, Seen> seen_;  // by thread
  std::uint64_t admitted_ = 0;
};

}  // namespace etude::bus
