// SPDX-License-Identifier: Apache-2.0
// A slot of a host: one episode-making child, supervised.
#pragma once

#include <atomic>
#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "services/campaign/process.h"
#include "services/campaign/worker_client.h"
#include "services/core/descriptor.h"
#include "services/policy/policy_types.h"
#include "worker/host/frame.h"

namespace etude::host {

struct SlotOptions {
  std::vector<std::string> argv;  ///< of the child; its end of the socket pair is descriptor 3
  std::string name;               ///< for the log
  /// A child that says nothing new for so long while it works is ended; or for nine tenths of the campaign's
  /// stall_timeout_s, where that is longer.
  std::chrono::milliseconds stall{90'000};
  /// Of all slots together, since the last result: that many, and the host gives up.
  std::shared_ptr<std::atomic<int>> deaths = std::make_shared<std::atomic<int>>(0);
  int hopeless = 6;
};

/// Starts a child when there is work, replaces it when it dies, hangs or says what it should not. Use from one thread,
/// which the child does not outlive.
class Slot {
 public:
  explicit Slot(SlotOptions options);
  ~Slot();

  /// From now on attempts are of this campaign: the child is made ready, which builds its scene.
  /// @error of the child's factory; kUnavailable: children die (see Do)
  Status Begin(const campaign::JoinedCampaign& joined);
  /// One attempt. A child that dies or hangs meanwhile gives a result of outcome kReleased with details
  /// {"reason": "child_crashed" | "child_hung", "by_attempt", "ended_by", "last_words"}: the same attempt is anybody's
  /// again.
  /// A stop request ends the child and releases the attempt, too.
  /// @param ask  answers a rollout's questions; may be empty in mode demonstrate
  /// @error of the child's work function; kUnavailable: `hopeless` children died since the last result
  Result<campaign::WorkResult> Do(const campaign::WorkItem& item, const policy::AskFunction& ask);

  /// Of the child that is there now.
  std::optional<pid_t> pid() const;

 private:
  struct Loss {  // of a child
    std::string reason, ended_by;
    bool by_attempt = false;  // it crashed or hung by itself
  };
  Status Start();
  std::optional<Loss> Await(FrameKind wanted, const campaign::WorkItem* item, const policy::AskFunction& ask,
                            Result<Frame>& answer);
  Status Reply(const Frame& question, const policy::AskFunction& ask);
  void ReadWords();
  Loss End(const char* reason, const std::string& why);
  Result<campaign::WorkResult> Release(const Loss& loss);
  Status CountDeath(const Loss& loss);
  void Forget();

  SlotOptions options_;
  std::optional<campaign::JoinedCampaign> joined_;
  std::optional<campaign::Process> process_;
  std::optional<Channel> channel_;
  Descriptor words_;        // the child's stdout and stderr
  std::string last_words_;  // their end
};

}  // namespace etude::host
