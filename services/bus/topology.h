// SPDX-License-Identifier: Apache-2.0
// Who writes and reads which topic, as DDS itself has discovered it, and messages as JSON: for people who look at a
// bus, not for programs that work over it.
#pragma once

#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "services/bus/participant.h"

namespace etude::bus {

/// One writer or reader somewhere on the domain.
struct PeerEndpoint {
  std::string topic, type;
  bool is_writer = false;
  std::vector<std::string> partitions;
  std::string participant;  ///< as ProcessStatus::participant
  bool reliable = false, transient_local = false;
  int keep_last = 0;  ///< 0: all
};

/// All that are known now, those of this participant too, by topic. A participant that was just opened knows nobody
/// yet: discovery takes a moment.
Result<std::vector<PeerEndpoint>> Endpoints(const Participant& participant);

/// Its DDS id, 32 hexadecimal digits.
std::string ParticipantId(const Participant& participant);

/// "reliable, transient-local, last 1"
std::string QosText(const PeerEndpoint& endpoint);
/// Why the reader would not get what the writer writes, in words; "" when it does. @pre of one topic
std::string Mismatch(const PeerEndpoint& writer, const PeerEndpoint& reader);

/// The topics of messages.h, by name, in the order of proto/README.md.
std::vector<std::string> KnownTopics();

/// Reads one topic in one partition as JSON: names as in messages.h, fields of bytes as {"bytes": n}. It is a reader as
/// any other: reliable writers wait for it. One thread at a time.
class Echo {
 public:
  /// @error kNotFound: no topic of messages.h (says the nearest); of the bus
  static Result<std::unique_ptr<Echo>> Open(const Participant& participant, const std::string& topic,
                                            const std::string& partition);
  virtual ~Echo() = default;
  /// What came since; not waiting.
  virtual std::vector<nlohmann::ordered_json> Take() = 0;
};

}  // namespace etude::bus
