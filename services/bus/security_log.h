// SPDX-License-Identifier: Apache-2.0
// What DDS Security writes into its log, in words that say what to do, once for each peer and reason: a peer that is
// refused is refused twice a second. Internal to services/bus.
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <string_view>

#include "services/core/thread_annotations.h"

namespace etude::bus {

struct SecurityLine {
  std::string reason;  ///< one word or two, constant: "unknown authority"
  std::string peer;    ///< name of its certificate, else its DDS id, else ""
  std::string text;    ///< for the log; empty: harmless, say nothing
};

/// None when `text` is not about security.
std::optional<SecurityLine> TranslateSecurity(std::string_view text);

/// Which lines were said already. Thread-safe.
class SecurityLines {
 public:
  /// The line to log, or nothing: it is harmless, or was said before.
  std::optional<std::string> Take(const SecurityLine& line);

 private:
  static constexpr std::size_t kMostPeers = 4096;  // peers and reasons, then each is said once more
  Mutex mutex_;
  std::set<std::string> said_ ETUDE_GUARDED_BY(mutex_);
};

}  // namespace etude::bus
