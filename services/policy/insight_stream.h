// SPDX-License-Identifier: Apache-2.0
// What the policy server of a run shows to one viewer, as it comes over the bus.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "services/bus/messages.h"
#include "services/bus/participant.h"
#include "services/core/identity.h"
#include "services/core/result.h"

namespace etude::policy {

/// Asks nothing, and whom it watches does not wait for it: the server shows what it has time for, at most
/// bus::kInsightsPerSecond. The server need not be there yet, may come back, and may be followed by another one that
/// the name means. Not thread-safe.
class InsightStream {
 public:
  /// @param run  that is served   @param wish  its viewer, session ("": anybody's) and what_if_json
  /// @param participant  must outlive the stream
  /// @error of the bus
  static Result<InsightStream> Open(const bus::Participant& participant, const Selector& run, bus::InsightWish wish);
  InsightStream(InsightStream&&) noexcept;
  InsightStream& operator=(InsightStream&&) noexcept;
  /// Takes the wish back.
  ~InsightStream();

  /// For this viewer, since the last call; none where there is no server. Keeps the wish standing, so it has to be
  /// called within bus::kWishStands seconds again. Does not wait.
  /// @error kInvalidArgument: the run's name means several servers; of the bus. The next call goes on.
  Result<std::vector<bus::Insight>> Take();

  /// As the last Take found it.
  std::optional<bus::Presence> server() const;

 private:
  struct Impl;
  explicit InsightStream(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::policy
