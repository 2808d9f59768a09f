// SPDX-License-Identifier: Apache-2.0
// Asks policy servers on the bus what they see in a picture and say of it.
#pragma once

#include <atomic>
#include <map>
#include <memory>
#include <string>

#include "services/bus/arguments.h"
#include "services/bus/participant.h"
#include "services/core/thread_annotations.h"
#include "services/policy/insight_client.h"

namespace etude::live {

/// One question at a time. Thread-safe. The bus is joined with the first question.
class PolicyLooker {
 public:
  explicit PolicyLooker(bus::Arguments arguments) : arguments_(std::move(arguments)) {}

  /// Each question is of a session of its own that no robot has: nothing drives by its answer.
  /// @param run  NAME@ID   @param what_if_json  see InsightClient::Ask
  /// @error kUnavailable: nobody answers within a few seconds, or another question is being asked; else as
  /// InsightClient::Ask
  Result<policy::Insight> Look(const std::string& run, const policy::Question& question,
                               const std::string& what_if_json);

 private:
  Result<policy::InsightClient*> ClientOf(const std::string& run) ETUDE_REQUIRES(mutex_);

  const bus::Arguments arguments_;
  std::atomic<bool> taken_{false};
  Mutex mutex_;
  std::unique_ptr<bus::Participant> participant_ ETUDE_GUARDED_BY(mutex_);
  std::map<std::string, policy::InsightClient> clients_ ETUDE_GUARDED_BY(mutex_);  // by run
};

}  // namespace etude::live
