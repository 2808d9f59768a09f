// SPDX-License-Identifier: Apache-2.0
// What a Participant shares with the entities made from it. Internal to services/bus.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "services/bus/entity.h"
#include "services/bus/participant.h"
#include "services/bus/qos.h"
#include "services/core/thread_annotations.h"
#include "services/security/identity.h"

namespace etude::bus {

/// What went through the writers, or the readers, of one topic, since the participant was opened. Thread-safe.
struct Traffic {
  std::atomic<std::uint64_t> samples{0};
  std::atomic<std::uint64_t> bytes{0};  ///< of the fields, without what DDS adds

  void Add(std::uint64_t sample_bytes) {
    samples.fetch_add(1, std::memory_order_relaxed);
    bytes.fetch_add(sample_bytes, std::memory_order_relaxed);
  }
  /// An endpoint that is there, and may be gone later.
  void Join(dds_entity_t endpoint) ETUDE_EXCLUDES(mutex);
  /// The other side's endpoints, over all of this side's that are there.
  int Matched(bool is_writer) ETUDE_EXCLUDES(mutex);

  Mutex mutex;
  std::vector<dds_entity_t> endpoints ETUDE_GUARDED_BY(mutex);
};

/// What participants with an identity say in place of their process's name.
inline constexpr char kNoProcessName[] = "-";

class ParticipantWatch;

struct Participant::State {
  std::shared_ptr<Entity> domain;  ///< outlives the participant
  Entity participant;
  std::uint32_t id = 0;
  std::string address;
  std::optional<security::Identity> identity;

  Mutex mutex;
  /// By topic and whether it is of writers.
  std::map<std::pair<std::string, bool>, std::shared_ptr<Traffic>> traffic ETUDE_GUARDED_BY(mutex);
  std::shared_ptr<Traffic> TrafficOf(const std::string& topic, bool is_writer) ETUDE_EXCLUDES(mutex);

  struct Held {
    Entity group, topic, endpoint;
  };
  Held visible = {};  ///< with an identity; see StayVisible

  std::shared_ptr<ParticipantWatch> watch;  ///< ends before all that it looks at; none without an identity
};

/// A topic with its writer or reader in its partitions.
struct Endpoint {
  std::shared_ptr<Participant::State> state;
  Entity group;  ///< publisher or subscriber
  Entity topic;
  Entity endpoint;  ///< writer or reader
  bool is_writer = false;
  std::shared_ptr<Traffic> traffic;

  dds_entity_t get() const { return endpoint.get(); }
};

Result<Endpoint> OpenWriter(const Participant& participant, const std::string& partition,
                            const dds_topic_descriptor_t& type, const std::string& topic, const TopicQos& qos);
Result<Endpoint> OpenReader(const Participant& participant, const std::string& partition,
                            const dds_topic_descriptor_t& type, const std::string& topic, const TopicQos& qos);
/// One reader of what is written in any of several partitions.
Result<Endpoint> OpenReaderIn(const Participant& participant, const std::vector<std::string>& partitions,
                              const dds_topic_descriptor_t& type, const std::string& topic, const TopicQos& qos);

/// Warns that samples of `topic` were dropped because a field was out of its bounds, `count` of them by now: when that
/// is a power of two, since a peer that sends nothing else must not fill the log.
void TellMalformed(std::string_view topic, std::uint64_t count);

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
