// SPDX-License-Identifier: Apache-2.0
#include "services/relay/relay.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <optional>
#include <utility>

#include "services/bus/directory.h"
#include "services/core/clock.h"
#include "services/core/identity.h"
#include "services/core/log.h"
#include "services/core/service_manager.h"
#include "services/core/stop.h"
#include "services/relay/kept_checkpoints.h"
#include "services/store/safetensors.h"

namespace etude::relay {
namespace {

using namespace std::chrono_literals;

// that a publication failed: until it is tried again
constexpr auto kTryAgain = 5s;

// One channel of what is kept.
struct Channel {
  std::optional<MonotonicClock::time_point> alone;  // since when nobody else has it
  std::optional<bus::BlobPublisher> publisher;      // while it is offered
  std::uint64_t version = 0;                        // that is offered
  MonotonicClock::time_point not_before = {};
};

}  // namespace

struct Relay::Impl {
  const bus::Participant* participant;
  bus::Owner run;
  RelayOptions options;
  KeptCheckpoints kept;
  std::optional<bus::Announcement> presence;
  std::optional<bus::BlobSubscriber> subscriber;
  std::map<std::string, Channel> channels;
  std::map<std::string, std::uint64_t> unkept = {};  // by channel: the newest version that cannot be kept now

  Status Take(const bus::PublishedBlob& blob);
  void Update(const std::string& channel, const Kept& one);
  void Offer(const std::string& name, const Kept& one, Channel& channel);
  Status Publish(const std::string& name, const Kept& one, Channel& channel);
};

// Durable before it counts as heard: with a full disk it is judged, that is kept, again later.
Status Relay::Impl::Take(const bus::PublishedBlob& blob) {
  if (options.accept) ETUDE_RETURN_IF_ERROR(options.accept(blob));
  const auto content = store::DecodeSafetensors(blob.bytes, [](std::string_view) { return false; });
  if (!content) return Fail(content.error().Wrap("it is no checkpoint"));
  ETUDE_RETURN_IF_ERROR(kept.Keep(blob));
  Log().info("kept run={} channel={} version={} bytes={} sha256={:.12}", run.partition(), blob.channel, blob.version,
             blob.bytes.size(), blob.sha256);
  return {};
}

// Late joiners get it from the run as long as that is there. What the run has to say is heard before it is replaced.
void Relay::Impl::Update(const std::string& name, const Kept& one) {
  Channel& channel = channels[name];
  const auto newer = unkept.find(name);
  const bool there =
      subscriber->Offered(name, one.version) || (newer != unkept.end() && subscriber->Offered(name, newer->second));
  if (there) {
    if (channel.publisher)
      Log().info("the run itself has its newest checkpoint again run={} channel={} version={}", run.partition(), name,
                 one.version);
    channel = {};
    return;
  }
  const auto now = MonotonicClock::now();
  if (!channel.alone) channel.alone = now;
  const bool offered = channel.publisher && channel.version == one.version;
  if (offered || !one.whole || now < channel.not_before || now - *channel.alone < options.patience) return;
  Offer(name, one, channel);
}

void Relay::Impl::Offer(const std::string& name, const Kept& one, Channel& channel) {
  const Status published = Publish(name, one, channel);
  if (published) {
    Log().info("the run is not there, its newest checkpoint is offered run={} channel={} version={} sha256={:.12}",
               run.partition(), name, one.version, one.sha256);
    return;
  }
  Log().warn("not offered, it is tried again run={} channel={} version={}: {}", run.partition(), name, one.version,
             published.error().message);
  channel.publisher.reset();
  channel.not_before = MonotonicClock::now() + kTryAgain;
}

Status Relay::Impl::Publish(const std::string& name, const Kept& one, Channel& channel) {
  ETUDE_ASSIGN_OR_RETURN(const auto bytes, kept.Read(name));
  if (!channel.publisher) {
    ETUDE_ASSIGN_OR_RETURN(channel.publisher, bus::BlobPublisher::OpenRelay(*participant, run));
  }
  ETUDE_RETURN_IF_ERROR(channel.publisher->Publish(name, one.version, bytes, one.meta_json));
  channel.version = one.version;
  return {};
}

namespace {

// What was kept before anybody asked for signatures would be offered for ever. One below a floor that is shared stays:
// it is signed, and subscribers have floors of their own.
Status ForgetRefused(const bus::Owner& run, const RelayOptions& options, KeptCheckpoints& kept) {
  if (!options.accept) return {};
  const auto channels = kept.channels();  // as they are now: some are forgotten meanwhile
  for (const auto& [channel, one] : channels) {
    const Status judged = options.accept({channel, one.version, run.id, one.meta_json, one.sha256, {}});
    if (judged || judged.error().code != Code::kCorrupt) continue;
    Log().warn("not kept any more channel={} version={}: {}", channel, one.version, judged.error().message);
    ETUDE_RETURN_IF_ERROR(kept.Forget(channel));
  }
  return {};
}

}  // namespace

Relay::Relay(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Relay::Relay(Relay&&) noexcept = default;
Relay& Relay::operator=(Relay&&) noexcept = default;
Relay::~Relay() = default;

Result<Relay> Relay::Open(const bus::Participant& participant, const bus::Owner& run, const RelayOptions& options) {
  ETUDE_ASSIGN_OR_RETURN(auto kept, KeptCheckpoints::Open(options.folder, run, options.user));
  ETUDE_RETURN_IF_ERROR(ForgetRefused(run, options, kept));
  std::unique_ptr<Impl> impl(new Impl{&participant, run, options, std::move(kept), {}, {}, {}});
  const auto presence = bus::MakePresence(bus::PresenceKind::kRelay, run.name, run.id, options.folder.string());
  // several may relay one run
  ETUDE_ASSIGN_OR_RETURN(impl->presence, bus::Announcement::Open(participant, presence, Claim::kAdopt));
  bus::ReceiveOptions receive;
  receive.from_relays = false;
  receive.accept = [relay = impl.get()](const bus::PublishedBlob& blob) {
    const Status taken = relay->Take(blob);
    if (taken) {
      relay->unkept.erase(blob.channel);
    } else if (taken.error().code == Code::kUnavailable) {
      auto& newest = relay->unkept[blob.channel];
      newest = std::max(newest, blob.version);
    }
    return taken;
  };
  ETUDE_ASSIGN_OR_RETURN(impl->subscriber, bus::BlobSubscriber::Open(participant, run, "", receive));
  return Relay(std::move(impl));
}

void Relay::Step(std::chrono::nanoseconds timeout) {
  (void)impl_->subscriber->Wait(timeout);  // what came is kept by then
  for (const auto& [channel, one] : impl_->kept.channels()) impl_->Update(channel, one);
}

std::vector<std::string> Relay::offered() const {
  std::vector<std::string> names;
  for (const auto& [name, channel] : impl_->channels)
    if (channel.publisher) names.push_back(name);
  return names;
}

bool GoesOn(bus::Directory& directory, const Selector& selector, const std::optional<KeptOwner>& kept) {
  if (!kept || kept->name != selector.name || !kept->id.starts_with(selector.id)) return false;
  directory.WaitForOthers();
  return !directory.Replaced(bus::PresenceKind::kRun, selector, kept->id, kept->user);
}

namespace {

// Nothing within a second when none is there, and none is kept.
Result<std::optional<bus::Owner>> RunOf(bus::Directory& directory, const Selector& selector, const Path& folder) {
  if (IsId(selector.id)) return std::optional(bus::Owner{selector.name, selector.id});
  ETUDE_ASSIGN_OR_RETURN(const auto kept, KeptRun(folder));
  if (GoesOn(directory, selector, kept)) return std::optional<bus::Owner>(*kept);
  ETUDE_ASSIGN_OR_RETURN(const auto found, directory.Find(bus::PresenceKind::kRun, selector, 1s));
  if (found) return std::optional(bus::Owner{found->name, found->id});
  return std::optional<bus::Owner>();
}

// The folder may hold the only copies of a run that has gone; the next run of its name takes its place.
Status CheckFolder(const Path& folder, const bus::Owner& run) {
  ETUDE_ASSIGN_OR_RETURN(const auto kept, KeptRun(folder));
  if (!kept || kept->name == run.name) return {};
  return Fail(
      Code::kInvalidArgument,
      fmt::format("relay run {}: '{}' keeps the checkpoints of run {}, which would be removed; give another folder",
                  run.partition(), folder.string(), kept->partition()));
}

}  // namespace

Status RelayRuns(const bus::Participant& participant, const Selector& selector, const RelayOptions& options,
                 const std::function<bool()>& stopping) {
  constexpr auto kRound = 200ms;
  ETUDE_ASSIGN_OR_RETURN(auto directory, bus::Directory::Open(participant));
  bool said = false;
  std::string unclear;  // which run is meant
  while (!stopping()) {
    const auto found = RunOf(directory, selector, options.folder);
    // a service is not started again after an error of usage, which this is for people
    if (!found && ServiceManager::IsThere()) {
      if (std::exchange(unclear, found.error().message) != found.error().message)
        Log().warn("{}; waiting until it is clear", found.error().message);
      WaitForStop(kRound);
      continue;
    }
    if (!found) return Fail(found.error());
    const auto& run = *found;
    if (!run && !std::exchange(said, true))
      Log().info("waiting for run {}: it is not there, and '{}' keeps nothing of it", selector.text(),
                 options.folder.string());
    if (!run) continue;
    ETUDE_RETURN_IF_ERROR(CheckFolder(options.folder, *run));
    const auto live = directory.Matching(bus::PresenceKind::kRun, {run->name, run->id});
    ETUDE_ASSIGN_OR_RETURN(const auto before, KeptRun(options.folder));
    const bool known = before && before->id == run->id && !before->user.empty();
    // of one that has gone already, and of which nothing says: this one relays for its own user
    const std::string user = !live.empty() ? live.front().user : known ? before->user : UserName();
    RelayOptions of_run = options;
    of_run.user = user;
    ETUDE_ASSIGN_OR_RETURN(auto relay, Relay::Open(participant, *run, of_run));
    Log().info("relaying run {} into '{}'", run->partition(), options.folder.string());
    for (bool told = false; !stopping(); relay.Step(kRound)) {
      if (!directory.Replaced(bus::PresenceKind::kRun, selector, run->id, user)) continue;
      const auto next = RunOf(directory, selector, options.folder);
      if (next) break;
      if (!std::exchange(told, true))
        Log().warn("run {} is relayed on until it is clear which one follows it: {}", run->partition(),
                   next.error().message);
    }
  }
  return {};
}

}  // namespace etude::relay
