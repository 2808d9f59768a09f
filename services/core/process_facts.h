// SPDX-License-Identifier: Apache-2.0
// What a process takes of its host.
#pragma once

#include <cstdint>

#include "services/core/clock.h"
#include "services/core/file.h"

namespace etude {

struct ProcessFacts {
  std::uint64_t rss_bytes = 0;                              ///< resident memory; 0: not known
  double cpu = 0;                                           ///< cores in use, mean since the last call: 1 is one core
  std::uint64_t disk_free_bytes = 0, disk_total_bytes = 0;  ///< of the folder's disk, as a user has it; 0: not known
};

/// Measures this process. One thread at a time.
class ProcessMeter {
 public:
  /// @param folder  whose disk counts; "": the working one's. It need not be there yet: then the nearest one above it
  explicit ProcessMeter(const Path& folder = {});
  ProcessFacts Measure();

 private:
  Path folder_;
  Stopwatch since_last_;
  double cpu_s_ = 0;
};

}  // namespace etude
