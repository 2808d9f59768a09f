// SPDX-License-Identifier: Apache-2.0
// The door to Cyclone DDS. Only services/bus includes dds/*.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "services/core/result.h"

namespace etude::bus {

struct ParticipantConfig {
  std::uint32_t domain = 0;  ///< DDS domain id, 0..230
  /// A Cyclone DDS XML file or inline XML. Empty: $CYCLONEDDS_URI if set, else the built-in local
  /// profile (loopback, no multicast, up to 120 processes; the same text as deploy/dds/local.xml).
  std::string profile;
};

/// One DDS participant. Thread-safe; must outlive every Writer and Reader made from it (they share it).
class Participant {
 public:
  /// The first one also tells malloc to keep up to 64 MB of freed memory (see participant.cc).
  /// @error kUnavailable: no interface, no free participant index, bad profile; says which and what to do.
  static Result<Participant> Open(const ParticipantConfig& config = {});
  Participant(Participant&&) noexcept;
  Participant& operator=(Participant&&) noexcept;
  ~Participant();

  std::uint32_t domain() const;
  struct State;
  const std::shared_ptr<State>& state() const { return state_; }

 private:
  explicit Participant(std::shared_ptr<State> state);
  std::shared_ptr<State> state_;
};

/// "host-pid-xxxx": unique for this process, a name for people and for keys.
std::string UniquePeerName();

}  // namespace etude::bus
