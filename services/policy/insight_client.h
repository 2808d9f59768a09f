// SPDX-License-Identifier: Apache-2.0
// Looks into a policy: an observation of one's own out, what the policy sees in it and says of it back.
#pragma once

#include <chrono>
#include <memory>
#include <string>

#include "services/bus/participant.h"
#include "services/core/result.h"
#include "services/policy/insight.h"
#include "services/policy/policy_types.h"

namespace etude::policy {

struct InsightClientOptions {
  std::chrono::milliseconds server{60'000};    ///< for the server to appear; it may still load its checkpoint
  std::chrono::milliseconds again{500};        ///< without an insight the observation is sent again after this
  std::chrono::milliseconds patience{10'000};  ///< for one insight, over all tries
};

/// One viewer of the policy server of a run. Its wish is for its own session alone: nobody else's observations are
/// shown, and no robot waits for it. Not thread-safe.
class InsightClient {
 public:
  /// @param run  NAME, or NAME@ID where several runs of a name are served. The server need not be there yet.
  /// @param participant  must outlive the client
  /// @error kInvalidArgument: not a name; of the bus.
  static Result<InsightClient> Open(const bus::Participant& participant, const std::string& run,
                                    const InsightClientOptions& options = {});
  InsightClient(InsightClient&&) noexcept;
  InsightClient& operator=(InsightClient&&) noexcept;
  /// Takes the wish back.
  ~InsightClient();

  /// Waits for its turn: a server shows bus::kInsightsPerSecond to a viewer.
  /// @error kUnavailable: no server, or no insight within the patience. It is remembered: nothing more is asked then,
  /// so that whoever has hundreds of questions waits once. kInvalidArgument: the server's refusal of this question, or
  /// a name that means several servers; kCorrupt: see ReadInsight; kTimeout: a stop was requested meanwhile.
  /// @param what_if_json  to be answered as well, see trainer/policy/what_if.h; "": nothing. It is answered for this
  /// question alone: each different one has a wish and a session of its own.
  Result<Insight> Ask(const Question& question, const std::string& what_if_json = "");

 private:
  struct Impl;
  explicit InsightClient(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::policy
