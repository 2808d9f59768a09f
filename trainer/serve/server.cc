// SPDX-License-Identifier: Apache-2.0
#include "trainer/serve/server.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <map>
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
#include "services/core/thread_annotations.h"
#include "services/core/without_throwing.h"
#include "services/relay/relay.h"
#include "trainer/serve/insight.h"

namespace etude::serve {

using namespace std::chrono_literals;

namespace {

// What is served now, and under which run's id.
struct Served {
  std::string run_id;
  std::shared_ptr<const Model> model;
  std::uint64_t since = 0;  // seconds since 1970
};

constexpr double kStatusEvery = 1;  // s
constexpr auto kSessionSilence = 10s;
constexpr std::size_t kMostSessions = 10'000;   // that are counted
constexpr char kOfCheckpoint[] = "checkpoint";  // begins what is said of a refused one

// Where observations of one run come in and actions go out.
struct Desk {
  std::string run_id;
  bus::Announcement presence;
  bus::AddressedWriters<bus::Action> actions;
  bus::Reader<bus::Observation> observations;
  bus::Writer<bus::PolicyStatus> statuses;
  std::unique_ptr<InsightDesk> insights;  // null: nobody may look into the policy here
};

// Who asks: several hosts may name their sessions alike.
struct Asker {
  std::string session, host;
  auto operator<=>(const Asker&) const = default;
};
struct Asked {
  MonotonicClock::time_point last, answered;
};

// A DDS domain whose observations are answered, by one thread.
struct Front {
  const bus::Participant* participant = nullptr;
  bool insights = true;  // robots' domains take observations and nothing else
  std::optional<Desk> desk = {};
  std::map<Asker, Asked> sessions = {};
  MonotonicClock::time_point looked = MonotonicClock::now();  // until then all that had come was taken
  std::optional<Stopwatch> since_status = {};
};

}  // namespace

struct PolicyServer::Impl {
  ServerOptions options;
  Front front;                  // where checkpoints come from, too
  std::optional<Front> robots;  // a domain of their own
  std::thread follower;
  std::atomic<bool> stop{false};
  std::atomic<std::uint64_t> answered{0}, refused{0}, refused_observations{0};
  const std::string name = bus::UniquePeerName();

  LatencyMeter latency;
  mutable Mutex mutex;
  Served served ETUDE_GUARDED_BY(mutex);
  Status follow_status ETUDE_GUARDED_BY(mutex);
  std::string last_refusal ETUDE_GUARDED_BY(mutex);

  ~Impl() {
    stop = true;
    if (follower.joinable()) follower.join();
  }
  Served Current() const ETUDE_EXCLUDES(mutex) {
    const MutexLock lock(mutex);
    return served;
  }
  bool Stopping() const { return stop || StopRequested(); }

  Status FollowRuns();
  Status FollowRun(bus::Directory& directory, const std::string& run_id, const std::string& user, WatchedLoop& watched);
  Status Judge(const bus::PublishedBlob& blob);
  void TakeCheckpoint(const bus::PublishedBlob& blob);
  void Serve(const std::string& run_id, std::shared_ptr<const Model> fresh) ETUDE_EXCLUDES(mutex);
  void TryOut(const Model& fresh);
  void NoteRefusal(const std::string& reason) ETUDE_EXCLUDES(mutex);
  void CountCorrupt(std::uint64_t count);
  void PublishStatus(Front& at);
  Status OpenDesk(Front& at, const std::string& run_id);
  bool IsOurs(const Desk& desk, const bus::Observation& observation);
  void NoteAlike(const Front& at, const Asker& asker);
  void AnswerAll(Front& at, const std::vector<bus::Observation>& observations, MonotonicClock::time_point arrived);
  void Send(Desk& desk, bus::Action& action, const std::string& host, const Latency& measured);
  Status ServeAt(Front& at);
};

// a first number for clients, before any of them has asked
void PolicyServer::Impl::TryOut(const Model& fresh) {
  constexpr int kTrials = 12;
  const bus::Observation trial = fresh.Trial();
  for (int i = 0; i < kTrials; ++i) {
    const Stopwatch watch;
    (void)fresh.Answer(trial);
    if (i >= 2) latency.AddTrial(1000 * watch.Seconds());  // the first ones also fill caches
  }
  Log().info("answering takes {} (trials of step={})", ToString(latency.Now()), fresh.metadata().step);
}

void PolicyServer::Impl::NoteRefusal(const std::string& reason) {
  constexpr std::size_t kLongest = 500;
  const MutexLock lock(mutex);
  last_refusal = reason.substr(0, kLongest);
}

// The bus has dropped them already.
void PolicyServer::Impl::CountCorrupt(std::uint64_t count) {
  if (count == 0) return;
  refused += count;
  NoteRefusal(fmt::format("{}: its bytes do not fit its checksum", kOfCheckpoint));
}

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

// One that may not drive yet, or answers what is no number, never takes the place of one that may; until there is one
// its refusals are the answers.
void PolicyServer::Impl::Serve(const std::string& run_id, std::shared_ptr<const Model> fresh) {
  const Served current = Current();
  const auto& kept = current.model;
  const auto& metadata = fresh->metadata();
  const bool stays = kept && kept->untrained().empty();
  if (!fresh->untrained().empty()) {
    ++refused;
    NoteRefusal(fmt::format("{} of step {}: not trained: {}", kOfCheckpoint, metadata.step, fresh->untrained()));
    Log().warn("refused a checkpoint run={}@{} step={}: not trained: {}; {}", options.run.name, run_id, metadata.step,
               fresh->untrained(),
               stays ? fmt::format("step {} serves on", kept->metadata().step)
                     : "observations are answered with this refusal");
    if (stays) return;
  } else if (const bus::Action trial = stays ? fresh->Answer(fresh->Trial()) : bus::Action(); !trial.error.empty()) {
    ++refused;
    NoteRefusal(fmt::format("{} of step {}: {}", kOfCheckpoint, metadata.step, trial.error));
    Log().warn("refused a checkpoint run={}@{} step={}: {}; step {} serves on", options.run.name, run_id, metadata.step,
               trial.error, kept->metadata().step);
    return;
  } else {
    Log().info("serving run={}@{} step={} stage={} sha256={:.12}", options.run.name, run_id, metadata.step,
               metadata.stage_name, fresh->sha256());
    if (latency.Now().p99_ms == 0) TryOut(*fresh);
  }
  const MutexLock lock(mutex);
  // what was wrong with one before it is over
  if (fresh->untrained().empty() && last_refusal.starts_with(kOfCheckpoint)) last_refusal.clear();
  served = {run_id, std::move(fresh), static_cast<std::uint64_t>(WallSeconds())};
}

// One run after the other of those that the selector fits.
Status PolicyServer::Impl::FollowRuns() {
  ETUDE_ASSIGN_OR_RETURN(auto directory, bus::Directory::Open(*front.participant));
  WatchedLoop watched;
  std::string unclear;  // why it is not known whom to follow
  while (!Stopping()) {
    watched.Moved();
    // a run that is named by its whole id need not be there: it may have published all it ever will
    std::string run_id = options.run.id, user;
    if (const auto before = std::exchange(options.before, std::nullopt);
        !IsId(run_id) && relay::GoesOn(directory, options.run, before))
      run_id = before->id, user = before->user;
    if (!IsId(run_id)) {
      const auto found = directory.FindPublisher(options.run, 1s);
      // what is served serves on; and a service is not started again after an error of usage, which this is for people
      if (!found && (Current().model || ServiceManager::IsThere())) {
        if (std::exchange(unclear, found.error().message) != found.error().message)
          Log().warn("{}; {}", found.error().message,
                     Current().model ? "the last checkpoint serves on" : "waiting until it is clear");
        WaitForStop(1s);
        continue;
      }
      if (!found) return Fail(found.error());
      if (!*found) continue;
      run_id = (*found)->id;
      user = (*found)->user;  // of a relay, where the run has ended: who keeps what it published
    }
    ETUDE_RETURN_IF_ERROR(FollowRun(directory, run_id, user, watched));
  }
  return {};
}

// Until another run has taken its place.
Status PolicyServer::Impl::FollowRun(bus::Directory& directory, const std::string& run_id, const std::string& user,
                                     WatchedLoop& watched) {
  ETUDE_ASSIGN_OR_RETURN(
      auto subscriber,
      bus::BlobSubscriber::Open(*front.participant, {options.run.name, run_id}, options.channel,
                                {.accept = [this](const bus::PublishedBlob& blob) { return Judge(blob); }}));
  Log().info("following run {}@{}", options.run.name, run_id);
  std::uint64_t corrupt = 0;
  while (!Stopping()) {
    watched.Moved();
    const auto blob = subscriber.Wait(200ms);
    CountCorrupt(subscriber.corrupt_blobs() - std::exchange(corrupt, subscriber.corrupt_blobs()));
    if (blob && blob->channel == options.channel) TakeCheckpoint(*blob);
    if (directory.Replaced(bus::PresenceKind::kRun, options.run, run_id, user)) return {};
  }
  return {};
}

// Before anything of it is parsed.
Status PolicyServer::Impl::Judge(const bus::PublishedBlob& blob) {
  if (!options.accept) return {};
  Status judged = options.accept(blob);
  if (!judged && judged.error().code != Code::kUnavailable) {  // that is judged again
    ++refused;
    NoteRefusal(fmt::format("{}: {}", kOfCheckpoint, judged.error().message));
  }
  return judged;
}

// Every new checkpoint becomes the model, or is refused and the last good one stays.
void PolicyServer::Impl::TakeCheckpoint(const bus::PublishedBlob& blob) {
  auto fresh = Model::FromBytes(blob.bytes, options.clip_folders.get(), options.device);
  if (!fresh) {
    ++refused;
    NoteRefusal(fmt::format("{}: {}", kOfCheckpoint, fresh.error().message));
    const auto kept = Current().model;
    Log().warn("refused a checkpoint run={}@{} version={}: {}; {}", options.run.name, blob.owner, blob.version,
               fresh.error().message,
               kept ? fmt::format("step {} serves on", kept->metadata().step) : "none serves yet");
    return;
  }
  Serve(blob.owner, std::move(*fresh));
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

PolicyServer::PolicyServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
PolicyServer::PolicyServer(PolicyServer&&) noexcept = default;
PolicyServer& PolicyServer::operator=(PolicyServer&&) noexcept = default;
PolicyServer::~PolicyServer() = default;

Result<PolicyServer> PolicyServer::Open(const bus::Participant& participant, const ServerOptions& options,
                                        std::shared_ptr<const Model> model) {
  if (model && !IsId(options.run.id))
    return Fail(Code::kInvalidArgument,
                fmt::format("serve a checkpoint as '{}': it needs a whole id", options.run.text()));
  if (options.robots && options.robots->domain() == participant.domain())
    return Fail(Code::kInvalidArgument,
                fmt::format("serve robots in DDS domain {}: it is the run's own", participant.domain()));
  auto impl = std::make_unique<Impl>();
  impl->front.participant = &participant;
  if (options.robots) impl->robots.emplace(Front{.participant = options.robots, .insights = false});
  impl->options = options;
  if (model) impl->Serve(options.run.id, std::move(model));
  return PolicyServer(std::move(impl));
}

Status PolicyServer::Follow() {
  impl_->follower = std::thread([impl = impl_.get()] {
    const Status status = WithoutThrowing([impl] { return impl->FollowRuns(); });
    if (status) return;
    {
      const MutexLock lock(impl->mutex);
      impl->follow_status = status;
    }
    impl->stop = true;
  });
  return {};
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

Status PolicyServer::Run() {
  Impl& impl = *impl_;
  if (!impl.Current().model) Log().info("waiting for the first checkpoint of run '{}'", impl.options.run.text());
  // each in its own thread: who waits for one domain's observations does not hear the other's
  const auto serve = [&impl](Front& at) {
    Status served = WithoutThrowing([&] { return impl.ServeAt(at); });
    impl.stop = true;
    return served;
  };
  Status of_robots;
  std::thread beside;
  if (impl.robots) beside = std::thread([&] { of_robots = serve(*impl.robots); });
  Status served = serve(impl.front);
  if (beside.joinable()) beside.join();
  ETUDE_RETURN_IF_ERROR(served);
  ETUDE_RETURN_IF_ERROR(of_robots);
  const MutexLock lock(impl.mutex);
  return impl.follow_status;
}

void PolicyServer::Stop() { impl_->stop = true; }
std::uint64_t PolicyServer::answered() const { return impl_->answered; }
std::uint64_t PolicyServer::refused_checkpoints() const { return impl_->refused; }
Latency PolicyServer::latency() const { return impl_->latency.Now(); }
std::uint64_t PolicyServer::checkpoint_step() const {
  const auto model = impl_->Current().model;
  return model ? model->metadata().step : 0;
}

}  // namespace etude::serve
