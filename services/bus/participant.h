// SPDX-License-Identifier: Apache-2.0
// The door to Cyclone DDS. Only services/bus includes dds/*.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "services/core/result.h"
#include "services/security/role.h"

namespace etude::bus {

struct ParticipantConfig {
  std::uint32_t domain = 0;  ///< DDS domain id, 0..230
  /// A Cyclone DDS XML file or inline XML. Empty: $CYCLONEDDS_URI if set, else the built-in local
  /// profile (loopback, no multicast, up to 120 processes; the same text as deploy/dds/local.xml).
  std::string profile;
  /// Folder of this process's identity (`etude security issue`). Empty: without security, unless the profile has a
  /// Security section of its own.
  std::string security;
  std::vector<security::Role> roles;  ///< that the identity must have
  std::string address;                ///< see Participant::address; empty: the identity's name, else one of its own
  bool joins_another = false;         ///< it answers in another domain, too: to be alone in this one does not end it
};

/// One DDS participant. Thread-safe; must outlive every Writer and Reader made from it (they share it).
class Participant {
 public:
  /// The first one also tells malloc to keep up to 64 MB of freed memory (see participant.cc).
  /// With an identity it is watched: that it is about to expire is warned of in time and ends the process before the
  /// library falls silent, and so does being admitted by nobody; a peer that was lost on this side only makes the
  /// process start again (see participant_watch.h).
  /// @error kUnavailable: no interface, no free participant index, bad profile, an identity that cannot work; says
  /// which and what to do.
  static Result<Participant> Open(const ParticipantConfig& config = {});
  Participant(Participant&&) noexcept;
  Participant& operator=(Participant&&) noexcept;
  ~Participant();

  std::uint32_t domain() const;
  bool secured() const;  ///< with an identity
  /// Where what is meant for this one comes (owner.h): a plain name. With an identity it is that one's, whose
  /// permissions name no other; else a name of this participant alone, so that a hundred of them on one host do not
  /// each read what one of them is told.
  const std::string& address() const;
  /// True when every participant that was seen on the domain has been heard, too. Under security that takes a
  /// handshake each (0.2 to 0.7 s); strangers never are.
  bool AllAdmitted() const;
  /// Another handle of the same participant, for what opens writers later.
  Participant Share() const;
  struct State;
  const std::shared_ptr<State>& state() const { return state_; }

 private:
  explicit Participant(std::shared_ptr<State> state);
  std::shared_ptr<State> state_;
};

/// "host-pid-xxxx": unique for this process, a name for people and for keys.
std::string UniquePeerName();

}  // namespace etude::bus
