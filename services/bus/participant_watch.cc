// SPDX-License-Identifier: Apache-2.0
#include "services/bus/participant_watch.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cstdlib>
#include <string_view>
#include <thread>
#include <utility>

#include "services/bus/builtin_topic.h"
#include "services/bus/spin_judge.h"
#include "services/bus/wire.h"
#include "services/core/clock.h"
#include "services/core/command.h"
#include "services/core/log.h"
#include "services/core/stop.h"
#include "services/core/stop_reason.h"
#include "services/core/thread_annotations.h"

namespace etude::bus {
namespace {

// One without an identity, which says its process's name: nobody knocks there, and it is no hub that forgot us.
bool IsOpen(const dds_builtintopic_participant_t& found) {
  const std::string name = PropertyOf(found.qos, "__ProcessName");
  return !name.empty() && name != kNoProcessName;
}

}  // namespace

PeersSeen LookAround(const Participant::State& state) {
  PeersSeen peers;
  const dds_entity_t participant = state.participant.get();
  dds_guid_t own{};
  dds_get_guid(participant, &own);
  const std::string self = GuidText(own);
  // Workers of one authority admit each other, and wait for the same: a hub is told by what it alone opens.
  const auto admit = [&peers](std::string_view of_hubs) {
    return [&peers, of_hubs](const dds_builtintopic_endpoint_t& found) {
      const std::string id = GuidText(found.participant_key);
      peers.admitted.insert(id);
      if (found.topic_name != nullptr && found.topic_name == of_hubs) peers.hubs.insert(id);
    };
  };
  for (const Status& looked :
       {ForEachLive<dds_builtintopic_participant_t>(participant, DDS_BUILTIN_TOPIC_DCPSPARTICIPANT,
                                                    [&](const dds_builtintopic_participant_t& found) {
                                                      if (!IsOpen(found)) peers.seen.insert(GuidText(found.key));
                                                    }),
        ForEachLive<dds_builtintopic_endpoint_t>(participant, DDS_BUILTIN_TOPIC_DCPSPUBLICATION,
                                                 admit(Traits<Presence>::kTopic)),
        ForEachLive<dds_builtintopic_endpoint_t>(participant, DDS_BUILTIN_TOPIC_DCPSSUBSCRIPTION,
                                                 admit(Traits<ProcessStatus>::kTopic))})
    if (!looked) Log().warn("{}", looked.error().message);
  peers.seen.erase(self);
  peers.admitted.erase(self);
  peers.hubs.erase(self);
  return peers;
}

// Who was there all along, or came long after, is a stranger; who came when the hub went may be the hub, which does not
// know us any more.
bool PeerJudge::CameWithTheHub(double since_s) const {
  return since_s >= *hub_s_ - kPatienceS && since_s <= *hub_s_ + kRestartS;
}

PeerJudge::Finding PeerJudge::Look(const PeersSeen& peers, double now_s) {
  Finding finding;
  if (!hub_s_ || !peers.hubs.empty()) hub_s_ = now_s;
  had_hub_ = had_hub_ || !peers.hubs.empty();
  for (const auto& id : peers.admitted) admitted_ += ever_admitted_.insert(id).second;
  bool moves = false;
  std::erase_if(waiting_, [&](const auto& item) {
    const bool admitted = peers.admitted.contains(item.first);
    moves = moves || admitted;
    return admitted || !peers.seen.contains(item.first);
  });
  if (moves) moved_s_ = now_s;
  for (const auto& id : peers.seen) {
    if (peers.admitted.contains(id)) continue;
    const double since_s = waiting_.try_emplace(id, now_s).first->second, waits_s = now_s - since_s;
    if (ever_admitted_.contains(id)) {
      const bool in_turn = now_s - moved_s_ < lost_patience_s_ && waits_s < kPatienceS;
      if (waits_s >= lost_patience_s_ && !in_turn) finding.lost.insert(id);
    } else if (std::min({waits_s, now_s - *hub_s_, now_s - moved_s_}) >= kPatienceS &&
               (!had_hub_ || CameWithTheHub(since_s))) {
      finding.alone = true;
    }
  }
  return finding;
}

bool IsHub(const std::vector<security::Role>& roles, const security::Identity& identity) {
  using security::Role;
  return std::ranges::any_of(roles.empty() ? identity.roles : roles, [](Role role) {
    return role == Role::kCollector || role == Role::kTrainer || role == Role::kGateway || role == Role::kRelay;
  });
}

DatesFinding LookAtDates(const security::Identity& identity, std::int64_t now) {
  DatesFinding finding;
  if (now >= security::EndAt(identity)) {
    finding.over =
        Error{Code::kUnavailable,
              fmt::format("identity '{}' expires on {}: this process ends before the bus falls silent; "
                          "issue another one ({}) and start it again",
                          identity.name, security::UtcText(identity.not_after), security::HowToRenew(identity))};
  } else if (now >= security::WarnAt(identity)) {
    finding.soon =
        fmt::format("identity expires soon name={} on={}: issue another one ({}) and restart this process before",
                    identity.name, security::UtcText(identity.not_after), security::HowToRenew(identity));
  }
  return finding;
}

struct ParticipantWatch::Impl {
  const Participant::State* state = nullptr;
  security::Identity identity;
  Mutex mutex;
  ConditionVariable changed;
  bool ending ETUDE_GUARDED_BY(mutex) = false;
  // of its thread
  bool warned = false;
  PeerJudge judge;
  bool for_others = false;  // it has another domain, whose peers it does not leave
  bool stays_alone = false;
  std::set<std::string> told;  // of the lost
  SpinJudge spin;
  Stopwatch since_start;
  std::thread thread;

  void Run();
  bool AwaitRound() ETUDE_EXCLUDES(mutex);
  void End() ETUDE_EXCLUDES(mutex);
  void CheckDates();
  void CheckPeers();
  void MakeAnew(const std::set<std::string>& lost);
  void CheckThreads();
};

void ParticipantWatch::Impl::CheckDates() {
  const auto finding = LookAtDates(identity, static_cast<std::int64_t>(WallSeconds()));
  if (finding.over) StopBecause(*finding.over);
  if (finding.soon && !std::exchange(warned, true)) Log().warn("{}", *finding.soon);
}

// One that started again a moment ago waits: whoever cannot be admitted must not keep it from its work for others.
void ParticipantWatch::Impl::MakeAnew(const std::set<std::string>& lost) {
  const std::string text = fmt::format("{} peers were lost on this side only and are not admitted again: {}",
                                       lost.size(), fmt::join(lost, ", "));
  if (!for_others && MayStartAgain())
    return RestartBecause({Code::kTimeout, text + "; with another participant they are"});
  if (std::ranges::includes(told, lost)) return;
  told.insert(lost.begin(), lost.end());
  if (for_others)
    Log().error("{}; start them again: this process goes on for those of its other domain", text);
  else
    Log().error("{}; this process starts again when its jobs have ended and {} s have passed since it last did", text,
                kLeastLifeS);
}

void ParticipantWatch::Impl::CheckPeers() {
  const auto finding = judge.Look(LookAround(*state), since_start.Seconds());
  if (!finding.lost.empty()) MakeAnew(finding.lost);
  if (finding.alone && !stays_alone)
    StopBecause({Code::kUnavailable,
                 fmt::format("identity '{}': somebody is on the domain, but no hub (collector, trainer, policy server, "
                             "relay, dashboard) admitted this process within {} s: is its authority (identity-ca.pem, "
                             "permissions-ca.pem) theirs, and is it revoked there?",
                             identity.name, PeerJudge::kPatienceS)});
}

// What turns does not end when it is asked to: the process may hang on its way out, and is then ended as by a kill.
void ParticipantWatch::Impl::CheckThreads() {
  static constexpr std::chrono::seconds kWayOut{120};
  const auto spinning = spin.Look(ThreadTimes(), since_start.Seconds(), judge.admitted());
  if (!spinning || StopRequested() || !MayStartAgain()) return;
  RestartBecause(
      {Code::kInternal,
       fmt::format("the DDS library's thread '{}' has turned without an end for {} s, and nobody is admitted "
                   "any more (cyclonedds#1548: strangers that knock for long, see `etude doctor net`)",
                   spinning->name, SpinJudge::kSpinningS)});
  std::thread([] {
    std::this_thread::sleep_for(kWayOut);
    Log().error("the DDS library does not let this process end: it ends now, as by a kill");
    StartAgainIfWanted();
    std::_Exit(kExitFailure);
  }).detach();
}

// False when it ends.
bool ParticipantWatch::Impl::AwaitRound() {
  const auto due = MonotonicClock::now() + std::chrono::milliseconds(500);
  const MutexLock lock(mutex);
  while (!ending && MonotonicClock::now() < due) changed.WaitFor(mutex, due - MonotonicClock::now());
  return !ending;
}

void ParticipantWatch::Impl::Run() {
  int round = 0;
  do {
    CheckDates();
    if (round % 2 == 1) CheckPeers();
    if (round % 4 == 3) CheckThreads();
    ++round;
  } while (AwaitRound());
}

void ParticipantWatch::Impl::End() {
  {
    const MutexLock lock(mutex);
    ending = true;
  }
  changed.NotifyAll();
  thread.join();
}

ParticipantWatch::ParticipantWatch(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

std::unique_ptr<ParticipantWatch> ParticipantWatch::Start(const Participant::State& state, security::Identity identity,
                                                          double lease_s, Alone alone) {
  auto impl = std::make_unique<Impl>();
  impl->state = &state;
  impl->for_others = alone == Alone::kStays;
  impl->stays_alone = alone != Alone::kEnds;
  impl->identity = std::move(identity);
  // less than a lease: finding out, starting again and the handshakes take their time, too
  impl->judge = PeerJudge(0.7 * lease_s);
  impl->thread = std::thread([raw = impl.get()] { raw->Run(); });
  return std::unique_ptr<ParticipantWatch>(new ParticipantWatch(std::move(impl)));
}

ParticipantWatch::~ParticipantWatch() { impl_->End(); }

}  // namespace etude::bus
