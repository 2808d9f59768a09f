// SPDX-License-Identifier: Apache-2.0
#include "services/security/role.h"

#include <fmt/format.h>

#include "services/core/enum_name.h"

namespace etude::security {

std::string ToString(Role role) {
  return std::string(EnumName(role, {{Role::kCollector, "collector"},
                                     {Role::kWorker, "worker"},
                                     {Role::kTrainer, "trainer"},
                                     {Role::kPolicy, "policy"},
                                     {Role::kSubscriber, "subscriber"},
                                     {Role::kRobot, "robot"},
                                     {Role::kGateway, "gateway"},
                                     {Role::kRelay, "relay"}}));
}

std::string ListText(const std::vector<Role>& roles) {
  std::string text;
  for (const Role role : roles) text += (text.empty() ? "" : ", ") + ToString(role);
  return text;
}

Result<Role> ParseRole(const std::string& text) {
  for (const Role role : kRoles)
    if (ToString(role) == text) return role;
  return Fail(Code::kInvalidArgument, fmt::format("role '{}': expected one of {}", text,
                                                  ListText(std::vector<Role>(std::begin(kRoles), std::end(kRoles)))));
}

}  // namespace etude::security
