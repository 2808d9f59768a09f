// SPDX-License-Identifier: Apache-2.0
#include "services/bus/participant_watch.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <condition_variable>
#include <mutex>
#include <thread>

#include "services/bus/builtin_topic.h"
#include "services/core/clock.h"
#include "services/core/log.h"
#include "services/core/stop_reason.h"

namespace etude::bus {
namespace {

using security::Role;

// A process that others depend on goes on for those that it has; the others end and are started again.
bool IsHub(const security::Identity& identity) {
  return identity.Has(Role::kCollector) || identity.Has(Role::kTrainer) || identity.Has(Role::kGateway) ||
         identity.Has(Role::kRelay);
}

}  // namespace

PeersSeen LookAround(const Participant::State& state) {
  PeersSeen peers;
  const dds_entity_t participant = state.participant.get();
  dds_guid_t own{};
  dds_get_guid(participant, &own);
  const std::string self = GuidText(own);
  const auto admit = [&](const dds_builtintopic_endpoint_t& found) {
    peers.admitted.insert(GuidText(found.participant_key));
  };
  for (const Status& looked :
       {ForEachLive<dds_builtintopic_participant_t>(
            participant, DDS_BUILTIN_TOPIC_DCPSPARTICIPANT,
            [&](const dds_builtintopic_participant_t& found) { peers.seen.insert(GuidText(found.key)); }),
        ForEachLive<dds_builtintopic_endpoint_t>(participant, DDS_BUILTIN_TOPIC_DCPSPUBLICATION, admit),
        ForEachLive<dds_builtintopic_endpoint_t>(participant, DDS_BUILTIN_TOPIC_DCPSSUBSCRIPTION, admit)})
    if (!looked) Log().warn("{}", looked.error().message);
  peers.seen.erase(self);
  peers.admitted.erase(self);
  return peers;
}

PeerJudge::Finding PeerJudge::Look(const PeersSeen& peers, double now_s) {
  Finding finding;
  ever_admitted_.insert(peers.admitted.begin(), peers.admitted.end());
  std::erase_if(waiting_, [&](const auto& item) {
    return !peers.seen.contains(item.first) || peers.admitted.contains(item.first);
  });
  for (const auto& id : peers.admitted) told_.erase(id);
  for (const auto& id : peers.seen) {
    if (peers.admitted.contains(id)) continue;
    const double since = waiting_.try_emplace(id, now_s).first->second;
    if (now_s - since < kPatienceS) continue;
    if (ever_admitted_.contains(id)) {
      if (told_.insert(id).second) finding.lost.push_back(id);
    } else if (ever_admitted_.empty()) {
      finding.alone = true;
    }
  }
  return finding;
}

struct ParticipantWatch::Impl {
  const Participant::State* state = nullptr;
  security::Identity identity;
  std::mutex mutex;
  std::condition_variable changed;
  bool ending = false;
  bool warned = false;
  PeerJudge judge;
  Stopwatch since_start;
  std::thread thread;

  void Run();
  void CheckDates();
  void CheckPeers();
};

void ParticipantWatch::Impl::CheckDates() {
  const auto now = static_cast<std::int64_t>(WallSeconds());
  if (now >= security::EndAt(identity)) {
    StopBecause({Code::kUnavailable,
                 fmt::format("identity '{}' expires on {}: this process ends before the bus falls silent; issue it "
                             "again (etude security issue DIR --name {}) and start it again",
                             identity.name, security::UtcText(identity.not_after), identity.name)});
  } else if (now >= security::WarnAt(identity) && !warned) {
    warned = true;
    Log().warn("identity expires soon name={} on={}: issue it again and restart this process before", identity.name,
               security::UtcText(identity.not_after));
  }
}

void ParticipantWatch::Impl::CheckPeers() {
  const auto finding = judge.Look(LookAround(*state), since_start.Seconds());
  if (!finding.lost.empty()) {
    const std::string text = fmt::format("{} peers were lost on this side only and are not admitted again: {}",
                                         finding.lost.size(), fmt::join(finding.lost, ", "));
    if (IsHub(identity))
      Log().error("{}; they come back when they are started again, or this process is", text);
    else
      StopBecause({Code::kTimeout, text + "; this process ends, to be started again"});
  }
  if (finding.alone && !IsHub(identity))
    StopBecause({Code::kUnavailable,
                 fmt::format("identity '{}': somebody is on the domain, but nobody admitted this process within {} s: "
                             "is its authority (identity-ca.pem, permissions-ca.pem) theirs, and is it revoked there?",
                             identity.name, PeerJudge::kPatienceS)});
}

void ParticipantWatch::Impl::Run() {
  using namespace std::chrono_literals;
  int round = 0;
  std::unique_lock lock(mutex);
  while (!ending) {
    lock.unlock();
    CheckDates();
    if (round++ % 4 == 3) CheckPeers();
    lock.lock();
    changed.wait_for(lock, 500ms, [this] { return ending; });
  }
}

ParticipantWatch::ParticipantWatch(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

std::unique_ptr<ParticipantWatch> ParticipantWatch::Start(const Participant::State& state,
                                                          security::Identity identity) {
  auto impl = std::make_unique<Impl>();
  impl->state = &state;
  impl->identity = std::move(identity);
  impl->thread = std::thread([raw = impl.get()] { raw->Run(); });
  return std::unique_ptr<ParticipantWatch>(new ParticipantWatch(std::move(impl)));
}

ParticipantWatch::~ParticipantWatch() {
  {
    const std::scoped_lock lock(impl_->mutex);
    impl_->ending = true;
  }
  impl_->changed.notify_all();
  impl_->thread.join();
}

}  // namespace etude::bus
