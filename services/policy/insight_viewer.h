// SPDX-License-Identifier: Apache-2.0
// Looks on while a policy answers somebody else: what it saw in the observations of one session and said of them.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "services/bus/participant.h"
#include "services/core/result.h"
#include "services/policy/insight.h"

namespace etude::policy {

/// Asks nothing, and whom it watches does not wait for it: its wish is for that session's observations, and the server
/// shows what it has time for, at most bus::kInsightsPerSecond of them. Not thread-safe.
class InsightViewer {
 public:
  /// @param run  NAME, or NAME@ID where several runs of a name are served. The server need not be there yet, and may
  /// come back.
  /// @param session  as its observations name it
  /// @param participant  must outlive the viewer
  /// @error kInvalidArgument: not a name; of the bus
  static Result<InsightViewer> Open(const bus::Participant& participant, const std::string& run,
                                    const std::string& session);
  InsightViewer(InsightViewer&&) noexcept;
  InsightViewer& operator=(InsightViewer&&) noexcept;
  /// Takes the wish back.
  ~InsightViewer();

  /// The newest since the last call; nothing: none came. Keeps the wish standing, so it has to be called within
  /// bus::kWishStands seconds again. Does not wait.
  /// @error kInvalidArgument: the run's name means several servers, or the server's refusal of the observation;
  /// kCorrupt: see ReadInsight; of the bus. The next call goes on.
  Result<std::optional<Insight>> Take();

 private:
  struct Impl;
  explicit InsightViewer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::policy
