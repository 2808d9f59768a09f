// SPDX-License-Identifier: Apache-2.0
// An authority of a secured bus, and processes that have identities of it.
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "services/bus/access.h"
#include "services/core/clock.h"
#include "services/security/authority.h"
#include "tests/support/temporary_folder.h"

namespace etude {

class Authority {
 public:
  Authority() { EXPECT_TRUE(security::InitAuthority(folder_.path(), security::Protection::kEncrypt)); }

  /// @param valid_s  seconds from now until it expires
  Path Issue(const std::string& name, security::Role role, std::int64_t valid_s = 86'400) const {
    const auto now = static_cast<std::int64_t>(WallSeconds());
    const auto issued = security::Issue(folder_.path(), {.name = name,
                                                         .roles = {role},
                                                         .grants = bus::GrantsFor({role}, name, {}, {}),
                                                         .not_before = now - 60,
                                                         .not_after = now + valid_s});
    EXPECT_TRUE(issued) << issued.error().message;
    return issued.value_or(Path());
  }
  Path Worker(const std::string& name) const { return Issue(name, security::Role::kWorker); }
  /// Copied away before it is revoked: its holder does not know of that.
  Path Revoked(const std::string& name) const {
    std::filesystem::copy(Worker(name), elsewhere_ / name, std::filesystem::copy_options::recursive);
    EXPECT_TRUE(security::Revoke(folder_.path(), name));
    return elsewhere_ / name;
  }
  /// The arguments of a collector that is of it.
  std::vector<std::string> CollectorFlags() const {
    return {"--security", Issue("hub", security::Role::kCollector).string()};
  }

 private:
  TemporaryFolder folder_, elsewhere_;
};

}  // namespace etude
