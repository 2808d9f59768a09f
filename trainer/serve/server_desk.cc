// SPDX-License-Identifier: Apache-2.0
// Where observations of a run are answered.
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "services/bus/addressed_writers.h"
#include "services/bus/directory.h"
#include "services/bus/topic.h"
#include "services/core/clock.h"
#include "services/core/file.h"
#include "services/core/identity.h"
#include "services/core/log.h"
#include "services/core/service_manager.h"
#include "services/core/stop.h"
#include "services/core/without_throwing.h"
#include "trainer/serve/server_impl.h"

namespace etude::serve {

using namespace std::chrono_literals;
using internal::Asker;
using internal::Desk;
using internal::Front;
using internal::Served;

namespace {

constexpr double kStatusEvery = 1;  // s
constexpr auto kSessionSilence = 10s;
constexpr std::size_t kMostSessions = 10'000;  // that are counted

}  // namespace

// What is served and how that goes, for whoever looks; not more often than once a second.
void PolicyServer::Impl::PublishStatus(Front& at) {
  if (!at.desk || (at.since_status && at.since_status->Seconds() < kStatusEvery)) return;
  at.since_status.emplace();
  const Served current = Current();
  if (!current.model || current.run_id != at.desk->run_id) return;
  const auto now = MonotonicClock::now();
  std::erase_if(at.sessions, [&](const auto& session) { return now - session.second.last > kSessionSilence; });
  const checkpoint::Metadata& metadata = current.model->metadata();
  const Latency measured = latency.Now();
  bus::PolicyStatus status;
  status.run = options.run.name;
  status.server = name;
  status.run_id = current.run_id;
  status.host = HostName();
  status.pid = static_cast<std::uint32_t>(::getpid());
  if (follower.joinable()) status.channel = options.channel;
  status.step = metadata.step;
  status.sha256 = current.model->sha256();
  status.stage = static_cast<std::uint32_t>(metadata.stage);
  status.stages = static_cast<std::uint32_t>(metadata.stages);
  status.stage_name = metadata.stage_name;
  status.control_trained = current.model->untrained().empty();
  status.since = current.since;
  status.answered = answered;
  status.refused = refused + refused_observations;
  status.p50_ms = measured.p50_ms;
  status.p95_ms = measured.p95_ms;
  status.sessions = static_cast<std::uint32_t>(at.sessions.size());
  {
    const MutexLock lock(mutex);
    status.last_refusal = last_refusal;
  }
  if (const Status written = at.desk->statuses.Write(status); !written)
    Log().debug("cannot say what is served: {}", written.error().message);
}

Status PolicyServer::Impl::OpenDesk(Front& at, const std::string& run_id) {
  at.desk.reset();
  const bus::Participant& participant = *at.participant;
  const std::string partition = bus::Owner{options.run.name, run_id}.partition();
  ETUDE_ASSIGN_OR_RETURN(auto observations, bus::Reader<bus::Observation>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto statuses, bus::Writer<bus::PolicyStatus>::Open(participant, partition));
  std::unique_ptr<InsightDesk> insights;
  if (at.insights) {
    ETUDE_ASSIGN_OR_RETURN(insights, InsightDesk::Open(participant, partition, run_id));
  }
  const auto presence = bus::MakePresence(bus::PresenceKind::kPolicy, options.run.name, run_id, options.folder);
  // several may serve one run: the newest is the one that is found, and each answers those who found it
  ETUDE_ASSIGN_OR_RETURN(auto announced, bus::Announcement::Open(participant, presence, Claim::kAdopt));
  at.desk.emplace(Desk{run_id, std::move(announced), bus::AddressedWriters<bus::Action>(participant, partition),
                       std::move(observations), std::move(statuses), std::move(insights)});
  at.since_status.reset();
  at.looked = MonotonicClock::now();
  return {};
}

void PolicyServer::Impl::Send(Desk& desk, bus::Action& action, const std::string& host, const Latency& measured) {
  action.server_p50_ms = static_cast<float>(measured.p50_ms);
  action.server_p99_ms = static_cast<float>(measured.p99_ms);
  if (!action.error.empty()) {
    ++refused_observations;
    // who only looks is told so himself; no robot stands still for it
    if (!desk.insights || !desk.insights->IsLookers(action.session)) NoteRefusal("observation: " + action.error);
    Log().warn("refused an observation session={}: {}", action.session, action.error);
  }
  // a client that went away must not stop the others
  if (const Status written = desk.actions.Write(host, action); !written)
    Log().warn("answer session={}: {}", action.session, written.error().message);
  else
    ++answered;
}

// Who does not name a host cannot be answered. One that asks another server of this run is answered there: two of them
// may serve different checkpoints.
bool PolicyServer::Impl::IsOurs(const Desk& desk, const bus::Observation& observation) {
  if (observation.run_id != desk.run_id) return false;
  if (!observation.server.empty() && observation.server != desk.presence.presence().instance) return false;
  if (IsPlainName(observation.host)) return true;
  ++refused_observations;
  NoteRefusal("observation: it does not name its client's host");
  return false;
}

// An observation may replace another one of its session in the middle of the bus: who shares a name with another host
// loses answers, and is told why here.
void PolicyServer::Impl::NoteAlike(const Front& at, const Asker& asker) {
  // one that was silent for longer may be a process that was started again
  const auto recently = MonotonicClock::now() - 1s;
  const auto is_other = [&](const auto& one) {
    return one.first.session == asker.session && one.first != asker && one.second.last > recently;
  };
  const auto other = std::ranges::find_if(at.sessions, is_other);
  if (other == at.sessions.end()) return;
  Log().warn(
      "session '{}' asks from '{}' and from '{}': give each robot a name of its own, or one's questions replace the "
      "other's",
      asker.session, other->first.host, asker.host);
}

/// @param arrived  the earliest moment at which they can have come
void PolicyServer::Impl::AnswerAll(Front& at, const std::vector<bus::Observation>& observations,
                                   MonotonicClock::time_point arrived) {
  const Served serving = Current();
  Desk& desk = *at.desk;
  // another run has taken this one's place since: who asks goes on with its desk
  if (serving.run_id != desk.run_id) return;
  // a client that asked again wants the answer to its last question only
  std::map<Asker, const bus::Observation*> newest;
  for (const auto& observation : observations)
    if (IsOurs(desk, observation)) newest[{observation.session, observation.host}] = &observation;
  std::vector<const bus::Observation*> open;
  std::vector<MonotonicClock::time_point> since;
  for (const auto& [asker, observation] : newest) {
    auto known = at.sessions.find(asker);
    if (known == at.sessions.end() && at.sessions.size() < kMostSessions) {
      NoteAlike(at, asker);
      known = at.sessions.try_emplace(asker).first;
    }
    const bool counted = known != at.sessions.end();
    if (counted) known->second.last = MonotonicClock::now();
    open.push_back(observation);
    // nobody asks the next thing before it was answered
    since.push_back(counted ? std::max(arrived, known->second.answered) : arrived);
  }

  const auto& current = serving.model;
  const Latency measured = latency.Now();
  std::atomic<std::size_t> next{0};
  Mutex sending;
  // each is sent as soon as it is there: the first of many do not wait for the last
  const auto work = [&] {
    for (std::size_t i = next++; i < open.size(); i = next++) {
      bus::Action action = current->Answer(*open[i]);
      const MutexLock lock(sending);
      Send(desk, action, open[i]->host, measured);
      const auto now = MonotonicClock::now();
      if (action.error.empty()) latency.Add(std::chrono::duration<double, std::milli>(now - since[i]).count());
      if (const auto known = at.sessions.find({open[i]->session, open[i]->host}); known != at.sessions.end())
        known->second.answered = now;
    }
  };
  std::vector<std::thread> others;
  const std::size_t helpers = std::min(open.size(), static_cast<std::size_t>(options.threads));
  for (std::size_t t = 1; t < helpers; ++t)  // the system may have no more of them: those that are there do all
    if (!WithoutThrowing([&]() -> Status { return others.emplace_back(work), Status(); })) break;
  work();
  for (auto& thread : others) thread.join();
  if (!desk.insights) return;
  for (const auto* observation : open) desk.insights->Offer(*observation, current);
}

// Until somebody wants an end of it.
Status PolicyServer::Impl::ServeAt(Front& at) {
  WatchedLoop watched;
  while (!Stopping()) {
    watched.Moved();
    const Served current = Current();
    if (!current.model) {
      WaitForStop(50ms);
      continue;
    }
    if (!at.desk || at.desk->run_id != current.run_id) ETUDE_RETURN_IF_ERROR(OpenDesk(at, current.run_id));
    auto& observations = at.desk->observations;
    const bool waiting = at.desk->actions.waiting();  // for a host that is new
    const bool there = observations.Wait(0ms);        // they came while others were answered
    const bool came = there || observations.Wait(waiting ? 5ms : 100ms);
    const auto before = std::exchange(at.looked, MonotonicClock::now());
    if (came) AnswerAll(at, observations.Take(), there ? before : at.looked);
    at.desk->actions.Tidy();
    PublishStatus(at);
  }
  return {};
}

}  // namespace etude::serve
