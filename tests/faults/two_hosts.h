// SPDX-License-Identifier: Apache-2.0
// Two hosts with a cable between them that can be cut: network namespaces. Needs root and `ip netns`; run in the root
// of the sources.
#pragma once

#include <chrono>
#include <string>

#include "tests/faults/campaign_run.h"

namespace etude::faults {

inline constexpr char kNoNamespaces[] = "needs `ip netns`, as root: two hosts are two network namespaces";

/// deploy/dds/local.xml on another interface, with peers and with more in its Internal section.
std::string ProfileOn(const std::string& address, const std::string& peers, const std::string& internal = "");

/// A host for the collector and one for the workers.
class TwoHosts {
 public:
  TwoHosts();
  ~TwoHosts();
  TwoHosts(const TwoHosts&) = delete;
  TwoHosts& operator=(const TwoHosts&) = delete;

  /// False where they could not be made.
  bool up() const { return up_; }
  /// The cable, in both directions.
  void Link(bool on) const;
  enum class Side { kCollector, kWorkers };
  /// What the host of one side sends does not leave it; what it is sent arrives.
  void Mute(Side side, bool mute) const;
  /// A run with its collector on the one and its workers on the other; leases of 3 s.
  RunOptions Options(const std::string& name, std::uint64_t episodes, int ms_per_attempt) const;

 private:
  const std::string a_, b_;
  bool up_ = false;
};

/// Waits while a fault lasts, which is what is tested.
void Last(std::chrono::milliseconds duration);

/// What the environment's variable says, else `otherwise`.
int SecondsOf(const char* variable, int otherwise);

}  // namespace etude::faults
