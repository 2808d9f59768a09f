// SPDX-License-Identifier: Apache-2.0
// What a process is for. An identity names the roles it may take; what each may write and read stands with the topics
// (services/bus/access.h).
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "services/core/result.h"

namespace etude::security {

enum class Role : std::uint8_t { kCollector, kWorker, kTrainer, kPolicy, kSubscriber, kRobot, kGateway, kRelay };

inline constexpr Role kRoles[] = {Role::kCollector,  Role::kWorker, Role::kTrainer, Role::kPolicy,
                                  Role::kSubscriber, Role::kRobot,  Role::kGateway, Role::kRelay};

/// "collector", "worker" ...
std::string ToString(Role role);
/// @error kInvalidArgument: none of them (says which there are)
Result<Role> ParseRole(const std::string& text);
/// "collector, gateway"
std::string ListText(const std::vector<Role>& roles);

/// What an identity is allowed, as DDS Security understands it: patterns of fnmatch, where * crosses "/".
struct Grant {
  bool publish = false;  ///< else: subscribe
  std::string topic;
  std::string partition;
};

}  // namespace etude::security
