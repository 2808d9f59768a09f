// SPDX-License-Identifier: Apache-2.0
// Watches over a participant with an identity, for what the library does not say: that its own time is up, that nobody
// admits it, and that a peer that was lost on one side only does not come back. Internal to services/bus.
#pragma once

#include <chrono>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "services/bus/participant_state.h"
#include "services/security/identity.h"

namespace etude::bus {

/// Who is on the domain, by DDS id.
struct PeersSeen {
  std::set<std::string> seen;      ///< participants whose discovery message came
  std::set<std::string> admitted;  ///< of which an endpoint is known: under security after the handshake only
};
PeersSeen LookAround(const Participant::State& state);

/// What is wrong with the peers, from one look to the next; apart from the bus so that it can be tested.
class PeerJudge {
 public:
  /// A peer that is seen but not admitted for so long is a stranger; longer than any handshake takes.
  static constexpr double kPatienceS = 30;

  struct Finding {
    std::vector<std::string> lost;  ///< once admitted, seen again, and not admitted any more
    bool alone = false;             ///< somebody is there, and nobody was ever admitted
  };
  /// @param now_s  of a clock that never goes back
  Finding Look(const PeersSeen& peers, double now_s);

 private:
  std::map<std::string, double> waiting_;  // since when it has been seen and not admitted
  std::set<std::string> ever_admitted_, told_;
};

class ParticipantWatch {
 public:
  /// `state` must outlive it.
  static std::unique_ptr<ParticipantWatch> Start(const Participant::State& state, security::Identity identity);
  ~ParticipantWatch();

 private:
  struct Impl;
  explicit ParticipantWatch(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::bus
