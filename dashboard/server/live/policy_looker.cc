// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/live/policy_looker.h"

namespace etude::live {
namespace {

using namespace std::chrono_literals;

constexpr std::size_t kMostClients = 4;
// together less than a request may take
constexpr policy::InsightClientOptions kOptions{.server = 2s, .again = 150ms, .patience = 6s};

}  // namespace

Result<policy::InsightClient*> PolicyLooker::ClientOf(const std::string& run) {
  if (!participant_) {
    ETUDE_ASSIGN_OR_RETURN(auto participant, arguments_.Open());
    participant_ = std::make_unique<bus::Participant>(std::move(participant));
  }
  auto client = clients_.find(run);
  if (client == clients_.end()) {
    if (clients_.size() >= kMostClients) clients_.clear();
    ETUDE_ASSIGN_OR_RETURN(auto opened, policy::InsightClient::Open(*participant_, run, kOptions));
    client = clients_.emplace(run, std::move(opened)).first;
  }
  return &client->second;
}

Result<policy::Insight> PolicyLooker::Look(const std::string& run, const policy::Question& question,
                                           const std::string& what_if_json) {
  struct Turn {
    std::atomic<bool>& taken;
    const bool mine = !taken.exchange(true);
    ~Turn() {
      if (mine) taken = false;
    }
  } turn{taken_};
  // a server that does not answer must not hold the threads of those who play
  if (!turn.mine)
    return Fail(Code::kUnavailable, "look into a policy: another question is being asked; ask again in a moment");
  MutexLock lock(mutex_);
  ETUDE_ASSIGN_OR_RETURN(policy::InsightClient* const client, ClientOf(run));
  auto insight = client->Ask(question, what_if_json);
  // it asks nothing more after a failure; the next question begins anew
  if (!insight && insight.error().code == Code::kUnavailable) clients_.erase(run);
  return insight;
}

}  // namespace etude::live
