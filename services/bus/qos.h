// SPDX-License-Identifier: Apache-2.0
// The QoS of every topic. No policy is left to a default: defaults differ between versions and between
// topics, writers and readers. Internal to services/bus.
#pragma once

#include <chrono>
#include <string>
#include <vector>

#include "services/bus/entity.h"

namespace etude::bus {

struct TopicQos {
  bool transient_local = false;                  ///< late joiners get the last sample of each key
  int keep_last = 0;                             ///< samples kept per key by writer and reader; 0: all
  std::chrono::milliseconds max_blocking{1000};  ///< a reliable writer waits this long for room
  int late = 1;                                  ///< with transient_local: samples per key for late joiners
};

inline constexpr TopicQos kEvents{false, 0};  ///< requests, reports, chunks: none is lost
/// Leases and acknowledgements: events, but who asked asks again when no answer comes, so that its writer does not wait
/// for long. Where a reader's process was killed or stopped there is no room until its participant's lease is over, and
/// whoever waited for it would hold up all other hosts.
inline constexpr TopicQos kAnswers{false, 0, std::chrono::milliseconds{20}};
inline constexpr TopicQos kNewest{false, 1};  ///< telemetry, observations: the newest counts
/// Insights: who watches many sessions gets what was said of each, and not of the last one alone.
inline constexpr TopicQos kShown{false, 16};
inline constexpr TopicQos kState{true, 1};  ///< as kNewest, and late joiners get it too
inline constexpr TopicQos kRecent{true, 64, std::chrono::milliseconds{1000},
                                  64};  ///< the last ones, also for late joiners
/// Published blobs: the writer keeps everything until it is acknowledged (which throttles it), and
/// the last of each key for late joiners.
inline constexpr TopicQos kPublishedWriter{true, 0};
inline constexpr TopicQos kPublishedReader{true, 1};

/// For topics, writers and readers alike; each takes the policies that apply to it.
Qos MakeQos(const TopicQos& topic);
/// For publishers and subscribers.
Qos MakePartitionQos(const std::vector<std::string>& partitions);

/// @error kInvalidArgument unless `partition` is [A-Za-z0-9_./-]{1,200}: no wildcards.
Status CheckPartition(const std::string& partition);

}  // namespace etude::bus
