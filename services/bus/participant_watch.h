// SPDX-License-Identifier: Apache-2.0
// Watches over a participant with an identity, for what the library does not say: that its own time is up, that nobody
// admits it, that a peer that was lost on one side only does not come back, and that the library's threads turn without
// an end. Internal to services/bus.
//
// Only another participant is admitted by a peer that still believes in the old one. Writers and readers of all of a
// process hang on its participant, so that the process makes it anew by starting again (RestartBecause), at most once
// in kLeastLifeS: what it holds is drained as after a signal, and collectors, trainers and evaluations resume.
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
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
  /// Of these: in the directory, or looking on. What workers and robots wait for.
  std::set<std::string> hubs = {};
};
PeersSeen LookAround(const Participant::State& state);

/// What is wrong with the peers, from one look to the next; apart from the bus so that it can be tested.
class PeerJudge {
 public:
  /// A peer that is seen but not admitted for so long is a stranger; longer than any handshake takes.
  static constexpr double kPatienceS = 30;
  /// A hub that is started again is there by then.
  static constexpr double kRestartS = 300;

  /// @param lost_patience_s  the same of peers that were admitted before: at most one lease, so that a cut in one
  ///                         direction is over within two. A handshake of a hundred at once takes 5 s: while others
  ///                         that wait are admitted, one after the other, nobody is lost before kPatienceS.
  explicit PeerJudge(double lost_patience_s = 10) : lost_patience_s_(lost_patience_s) {}

  struct Finding {
    std::set<std::string> lost;  ///< once admitted, seen again, and not admitted any more; until they are gone or are
    bool alone = false;          ///< somebody came for whom this is a stranger, and no hub is admitted
  };
  /// @param now_s  of a clock that never goes back
  Finding Look(const PeersSeen& peers, double now_s);
  /// How many were ever admitted.
  std::uint64_t admitted() const { return admitted_; }

 private:
  bool CameWithTheHub(double since_s) const;

  double lost_patience_s_;
  double moved_s_ = -1e9;        // when one that waited was admitted last
  bool had_hub_ = false;         // one was ever admitted
  std::optional<double> hub_s_;  // when a hub was admitted last; before that: when the first look was
  std::uint64_t admitted_ = 0;
  std::map<std::string, double> waiting_;  // since when it has been seen and not admitted
  std::set<std::string> ever_admitted_;
};

/// Whether others depend on a process, which then waits for those of its authority. `roles`: what it does; none: it did
/// not say, and what its identity may do counts.
bool IsHub(const std::vector<security::Role>& roles, const security::Identity& identity);

/// What the dates of an identity ask for at `now` (seconds since 1970).
struct DatesFinding {
  std::optional<Error> over;        ///< the process ends, before the library ends its participant without a word
  std::optional<std::string> soon;  ///< to be said once
};
DatesFinding LookAtDates(const security::Identity& identity, std::int64_t now);

class ParticipantWatch {
 public:
  /// What becomes of a process whom nobody on the domain admits.
  enum class Alone {
    kEnds,   ///< it would go on knocking
    kWaits,  ///< a hub, or it will have another domain: it does not end, and makes itself anew as others do
    kStays   ///< it has another domain, where others wait for it
  };

  /// `state` must outlive it. @param lease_s  of the participant (LeaseSeconds)
  static std::unique_ptr<ParticipantWatch> Start(const Participant::State& state, security::Identity identity,
                                                 double lease_s, Alone alone);
  ~ParticipantWatch();

 private:
  struct Impl;
  explicit ParticipantWatch(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::bus
