// SPDX-License-Identifier: Apache-2.0
// Readers of topics that somebody looks at right now, and of no others.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "dashboard/server/live/bus_watch.h"
#include "services/bus/topology.h"

namespace etude::live {

/// One thread at a time.
class SampleTap {
 public:
  explicit SampleTap(const bus::Participant& participant) : participant_(participant) {}

  /// Reads these topics in the partitions in which they are written now; readers of others end.
  /// @returns the newest message of each partition, by topic. @error of a topic of which no partition can be read: of
  /// the bus, such as that a gateway's identity may not
  std::map<std::string, Result<std::vector<Sample>>> Read(const std::vector<std::string>& topics);

 private:
  struct Tapped {
    std::map<std::string, std::unique_ptr<bus::Echo>> readers;  // by partition
    std::map<std::string, Sample> newest;                       // by partition
    std::map<std::string, Error> refused;                       // by partition: said once, and not tried again
    int round = 0;
  };
  void Join(const std::string& topic, Tapped& tapped);

  const bus::Participant& participant_;
  std::map<std::string, Tapped> tapped_;  // by topic
};

}  // namespace etude::live
