// SPDX-License-Identifier: Apache-2.0
// Who may work for a campaign, and on what: workers' requests and their leases.
#include <fmt/format.h>

#include "services/campaign/collector_impl.h"
#include "services/core/log.h"
#include "services/core/printable.h"

namespace etude::campaign {

// A worker whose episodes never fit is no use here, and would be leased the same work for ever.
std::optional<std::string> Collector::Impl::WhySentAway(const std::string& worker) const {
  const MutexLock lock(mutex);
  const auto found = unfit.find(worker);
  if (found == unfit.end() || found->second.in_a_row < options.unfit_budget) return std::nullopt;
  return fmt::format("the last {} episodes of worker {} did not fit campaign '{}'; the last one: {}",
                     found->second.in_a_row, worker, spec.name, found->second.reason);
}

namespace {

// "" of a worker without files of its user's; else hex.
bool IsDigest(const std::string& text) {
  return text.size() <= 64 && text.find_first_not_of("0123456789abcdef") == std::string::npos;
}

}  // namespace

// The first worker that asks says which files and libraries count; it may have been the odd one.
std::string Collector::Impl::WhileNothingIsCommitted() const {
  const MutexLock lock(mutex);
  if (table.committed() > 0) return "";
  return "; nothing is committed yet: the collector started again begins with those of the worker that asks first";
}

// Workers that would make other episodes than the rest, or that we would misunderstand.
std::optional<std::string> Collector::Impl::WhyRefused(const bus::WorkRequest& request) {
  const auto other = [&](const char* what, std::uint32_t here, std::uint32_t there) {
    return fmt::format(
        "campaign '{}' is collected with {} {} (program {}), this worker has {} (program {}): use "
        "programs of the same {}",
        spec.name, what, here, Version(), there, request.version, what);
  };
  if (request.wire != bus::kWireVersion) return other("wire number", bus::kWireVersion, request.wire);
  if (!IsPlainName(request.host))
    return fmt::format("worker {} does not name its host: use this program's worker", request.worker);
  if (request.content != options.content) return other("content number", options.content, request.content);
  if (const auto why = WhySentAway(request.worker)) return why;
  if (request.spec_sha256 != spec_sha256) return std::nullopt;  // its files are those of another spec
  if (!IsDigest(request.files_sha256))
    return fmt::format("worker {} names its files by what is no SHA-256: use this program's worker", request.worker);
  if (!files_sha256) {
    files_sha256 = request.files_sha256;
    if (const Status remembered = RememberFiles(sink->folder(), request.files_sha256); !remembered)
      Log().warn("after a restart the first worker's files will count: {}", remembered.error().message);
  }
  if (request.files_sha256 != *files_sha256)
    return fmt::format(
        "campaign '{}' began with other robot or object files than this worker has under the same paths "
        "(SHA-256 {}, here {}): copy them from where it began, or collect into another folder{}",
        spec.name, *files_sha256, request.files_sha256, WhileNothingIsCommitted());
  return WhyUnlike(request);
}

// A host whose episodes would have other bytes. One that does not say what they depend on is an older program's.
std::optional<std::string> Collector::Impl::WhyUnlike(const bus::WorkRequest& request) {
  if (request.fingerprint_json.empty() || spec.determinism == "none") return std::nullopt;
  const auto there = ParseFingerprint(request.fingerprint_json);
  if (!there) return there.error().message;
  if (!fingerprint) {
    fingerprint = *there;
    if (const Status remembered = RememberFingerprint(sink->folder(), *there); !remembered)
      Log().warn("after a restart the first worker's fingerprint will count: {}", remembered.error().message);
  }
  const auto difference = FirstDifference(*there, *fingerprint, spec.determinism);
  if (!difference) return std::nullopt;
  return fmt::format(
      "this host's episodes would have other bytes than those of campaign '{}' ({}): use the same libraries and driver "
      "(`etude worker --fingerprint` prints them), or allow it with determinism: physics or none{}",
      spec.name, *difference, WhileNothingIsCommitted());
}

bus::Lease Collector::Impl::Answer(const bus::WorkRequest& request) {
  bus::Lease lease;
  lease.campaign = spec.name;
  lease.campaign_id = id;
  lease.spec_sha256 = spec_sha256;
  lease.worker = request.worker;
  lease.request_id = request.request_id;
  lease.duration_ns = static_cast<std::uint64_t>(std::chrono::nanoseconds(options.lease).count());
  if (const auto why = WhyRefused(request)) {
    lease.kind = bus::LeaseKind::kRefused;
    lease.reason = *why;
    Log().warn("refused worker={}: {}", request.worker, *why);
    return lease;
  }
  const Assignment assignment = Assign(request);
  lease.kind = assignment.kind == Assignment::Kind::kWork   ? bus::LeaseKind::kWork
               : assignment.kind == Assignment::Kind::kDone ? bus::LeaseKind::kDone
                                                            : bus::LeaseKind::kWait;
  lease.index = assignment.index;
  lease.attempt = assignment.attempt;
  lease.token = assignment.token;
  if (assignment.kind == Assignment::Kind::kWork) lease.sampling_json = WeightsText(WeightsAt(assignment.index));
  return lease;
}

Assignment Collector::Impl::Assign(const bus::WorkRequest& request) {
  const bool journal_is_durable = Reweight();
  const MutexLock lock(mutex);
  heard[request.worker] = MonotonicClock::now();
  hosts[request.worker] = bus::HostOfAddress(request.host);
  // a stopping collector leases nothing new, and does not say that all is done; a worker that is ready for another
  // spec sees ours in the answer and makes itself ready first
  if (Stopping() || request.spec_sha256 != spec_sha256 || !journal_is_durable) return {};
  if (HoldsElsewhere(request)) return {};
  if (const auto again = MakeAgain(request)) return *again;
  if (!table.Holds(request.worker, request.working_on)) {  // who asks again, because the answer was lost, is told again
    if (leasing != Leasing::kOn && !AllDone()) return {};
    // who makes something for a full disk waits with it; another shard can use them meanwhile
    if (!options.shard.whole() && !disk_errors.empty()) return {};
    // what its host could make again comes first, to who has nothing in hand
    if (request.working_on != 0 && rechecks.WaitsFor(HostOf(request.worker))) return {};
  }
  // others' episodes are being made again: it may be needed for one that comes back
  if (table.complete() && !AllDone()) return {};
  const Assignment assignment = table.Request(request.worker, MonotonicClock::now(), request.working_on);
  if (assignment.kind == Assignment::Kind::kDone && request.working_on == 0) dismissed.insert(request.worker);
  return assignment;
}

// A lease is told again to the host that it went to only: whoever asks in another's name learns nothing. A worker that
// was started again there goes on at once; one that asks after another has taken its name over is a second one, and
// both would make every attempt.
bool Collector::Impl::HoldsElsewhere(const bus::WorkRequest& request) {
  const bool holds = table.Holds(request.worker) || rechecks.Holds(request.worker);
  const std::string host = bus::HostOfAddress(request.host);
  LeasedTo& last = leased_to[request.worker];
  const std::string last_host = bus::HostOfAddress(last.address);
  if (holds && (host != last_host || (request.host == last.before && request.host != last.address))) {
    constexpr std::size_t kMostTold = 1000;
    if (told_apart.size() < kMostTold && told_apart.insert(request.worker).second)
      Log().warn("{} called {}: one of them waits; give each another --name",
                 host == last_host ? fmt::format("two workers of host '{}' are both", host)
                                   : fmt::format("workers of hosts '{}' and '{}' are both", last_host, host),
                 Printable(request.worker));
    return true;
  }
  if (request.host != last.address) last = {.address = request.host, .before = std::move(last.address)};
  return false;
}

// Which program each worker is, once: the commit is logged, not compared.
void Collector::Impl::Greet(const bus::WorkRequest& request) {
  constexpr std::size_t kMostRemembered = 10'000;
  if (greeted.size() >= kMostRemembered) greeted.clear();
  if (!greeted.insert(request.worker).second) return;
  Log().info("worker={} program={} wire={} content={} (here {})", Printable(request.worker), Printable(request.version),
             request.wire, request.content, BuildVersion());
}

void Collector::Impl::OnRequest(const bus::WorkRequest& request) {
  if (request.campaign_id != id) return;
  Greet(request);
  {
    const MutexLock lock(mutex);
    idle.erase(request.worker);
  }
  // who names no host is refused where a worker of another wire number listens: in the campaign's partition
  const std::string host = IsPlainName(request.host) ? request.host : "";
  // an answer that is lost is asked for again
  if (const Status written = topics.leases.Write(host, Answer(request)); !written)
    Log().warn("cannot answer worker={}: {}", request.worker, written.error().message);
}

}  // namespace etude::campaign
