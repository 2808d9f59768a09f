// SPDX-License-Identifier: Apache-2.0
// Whose checkpoints are followed, and which becomes the model.
#include <fmt/format.h>

#include <memory>
#include <string>
#include <utility>

#include "services/bus/directory.h"
#include "services/core/clock.h"
#include "services/core/identity.h"
#include "services/core/log.h"
#include "services/core/service_manager.h"
#include "services/core/stop.h"
#include "services/relay/relay.h"
#include "trainer/serve/server_impl.h"

namespace etude::serve {

using namespace std::chrono_literals;
using internal::Served;

namespace {

constexpr char kOfCheckpoint[] = "checkpoint";  // begins what is said of a refused one

}  // namespace

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
  if (!judged) {
    if (judged.error().code != Code::kUnavailable) ++refused;  // that is judged again
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

}  // namespace etude::serve
