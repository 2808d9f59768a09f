// SPDX-License-Identifier: Apache-2.0
// What a sender was told of its episodes, for fault tests: a log of its own, durable line by line, that a scanner holds
// against the dataset afterwards. A line: CAMPAIGN_ID INDEX ATTEMPT TOKEN VERDICT SHA256, where VERDICT is done,
// duplicate or refused and SHA256 is of the bytes that were sent. Internal to services/campaign.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "services/bus/blob_transfer.h"
#include "services/bus/messages.h"
#include "services/core/file.h"

namespace etude::campaign {

/// Not thread-safe.
class AckLog {
 public:
  /// Appends to the file that ETUDE_ACK_LOG names; without it notes nothing.
  static AckLog FromEnvironment();

  /// Durable when it returns. A log that cannot be written ends the process: a scanner would take it as whole.
  void Note(const std::string& campaign_id, const bus::Lease& lease, const bus::Verdict& verdict,
            std::span<const std::uint8_t> bytes);

 private:
  std::optional<LineAppender> file_;
};

}  // namespace etude::campaign
