// SPDX-License-Identifier: Apache-2.0
// What a Participant shares with the entities made from it. Internal to services/bus.
#pragma once

#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include "services/bus/entity.h"
#include "services/bus/participant.h"
#include "services/bus/qos.h"

namespace etude::bus {

struct Participant::State {
  std::shared_ptr<Entity> domain;  ///< outlives the participant
  Entity participant;
  std::uint32_t id = 0;
};

/// A topic with its writer or reader in a partition.
struct Endpoint {
  std::shared_ptr<Participant::State> state;
  Entity group;  ///< publisher or subscriber
  Entity topic;
  Entity endpoint;  ///< writer or reader
  bool is_writer = false;

  dds_entity_t get() const { return endpoint.get(); }
};

Result<Endpoint> OpenWriter(const Participant& participant, const std::string& partition,
                            const dds_topic_descriptor_t& type, const std::string& topic, const TopicQos& qos);
Result<Endpoint> OpenReader(const Participant& participant, const std::string& partition,
                            const dds_topic_descriptor_t& type, const std::string& topic, const TopicQos& qos);

int MatchedReaders(const Endpoint& writer);
int MatchedWriters(const Endpoint& reader);

/// Waits for data of readers and for writers being matched. Wakes up for a stop request.
class Waiter {
 public:
  Status Open(const Participant& participant);
  /// `reader` has samples, valid or not, that were not taken.
  Status AddReader(const Endpoint& reader);
  /// A reader of `writer` came or went. Stays so until the matched status is read.
  Status AddMatched(const Endpoint& writer_or_reader);
  /// True when one of them has news; false after `timeout` or on a stop request.
  bool Wait(std::chrono::nanoseconds timeout);

 private:
  Entity waitset_;
  std::vector<Entity> conditions_;
};

}  // namespace etude::bus
