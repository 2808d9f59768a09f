// SPDX-License-Identifier: Apache-2.0
// How much goes through each topic, from what processes count themselves: nobody has to read it.
#pragma once

#include <map>
#include <string>
#include <utility>

#include "services/cli/bus_watch.h"

namespace etude::cli {

struct TopicRate {
  double samples_per_second = 0, bytes_per_second = 0;  ///< written
  int writers = 0;                                      ///< processes that write it
};

/// Of the time between Begin and End. A process that was not there at the beginning does not count.
class TopicRates {
 public:
  void Begin(const BusView& view);
  std::map<std::string, TopicRate> End(const BusView& view) const;

 private:
  std::map<std::string, Heard<bus::ProcessStatus>> first_;  // by process
};

}  // namespace etude::cli
