// SPDX-License-Identifier: Apache-2.0
// What the two that look into a policy share: the wish for its server. Internal to services/policy.
#pragma once

#include <cstdint>
#include <string>

#include "services/bus/messages.h"

namespace etude::policy {

/// Of one viewer, for the observations of one session. @param seconds  for which it stands; 0: it is taken back
inline bus::InsightWish WishFor(const bus::Presence& server, const std::string& viewer, const std::string& session,
                                std::uint32_t seconds) {
  bus::InsightWish wish;
  wish.run = server.name;
  wish.run_id = server.id;
  wish.viewer = viewer;
  wish.session = session;
  wish.seconds = seconds;
  return wish;
}

}  // namespace etude::policy
