// SPDX-License-Identifier: Apache-2.0
// The topics of a bus, for people: who writes and reads each, whether their QoS fits, and how much goes through it as
// the writers count it themselves, so that nobody has to read it.
#pragma once

#include <map>
#include <set>
#include <string>
#include <vector>

#include "services/bus/messages.h"
#include "services/bus/topology.h"
#include "services/core/config.h"
#include "services/monitor/heard.h"

namespace etude::monitor {

/// By ProcessStatus::process.
using Processes = std::map<std::string, Heard<bus::ProcessStatus>>;

struct TopicRow {
  std::set<std::string> types, qos;
  std::set<std::string> problems;  ///< bus::Mismatch of a writer and a reader
  std::vector<bus::PeerEndpoint> writers, readers;
};

/// By topic, without the endpoints of the participant `own`.
std::map<std::string, TopicRow> TopicRows(const std::vector<bus::PeerEndpoint>& endpoints, const std::string& own);

/// DDS participant -> "worker 4711@lab-7"
std::map<std::string, std::string> PeerNames(const Processes& processes);

/// {topic, types, qos, problems, writers, readers}, the last two as [{peer, participant, partitions}]; peer is "" where
/// the participant does not say who it is.
OrderedJson TopicJson(const std::string& topic, const TopicRow& row, const std::map<std::string, std::string>& names);

/// The partitions in which somebody writes the topic.
std::set<std::string> WrittenPartitions(const std::vector<bus::PeerEndpoint>& endpoints, const std::string& topic);

/// It carries episodes or checkpoints: their senders would send every byte to each reader, and wait for it.
bool IsBulk(const std::string& topic);

struct TopicCount {
  double samples = 0, bytes = 0;
};
/// What a process has written since its start, by topic. What does not parse is left out.
std::map<std::string, TopicCount> Written(const bus::ProcessStatus& status);

struct TopicRate {
  double samples_per_second = 0, bytes_per_second = 0;  ///< written
  int writers = 0;                                      ///< processes that write it
};

/// Of the time between Begin, of a process that was heard first later between that, and End.
class TopicRates {
 public:
  void Begin(const Processes& processes) { first_ = processes; }
  /// Now and then: those that are new begin to count.
  void Hear(const Processes& processes) { first_.insert(processes.begin(), processes.end()); }
  std::map<std::string, TopicRate> End(const Processes& processes) const;

 private:
  Processes first_;
};

}  // namespace etude::monitor
