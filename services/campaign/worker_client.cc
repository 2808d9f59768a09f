// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/worker_client.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <thread>

#include "services/bus/object_channel.h"
#include "services/bus/topic.h"
#include "services/core/check.h"
#include "services/core/clock.h"
#include "services/core/log.h"
#include "services/core/stop.h"

namespace etude::campaign {
namespace {

using namespace std::chrono_literals;

std::string HostName() {
  char name[256] = "unknown";
  ::gethostname(name, sizeof name - 1);
  return name;
}

// Heartbeats on a thread of their own: an attempt takes seconds and must not cost its lease.
class Heart {
 public:
  Heart(bus::Writer<bus::WorkerStatus> writer, bus::WorkerStatus status, std::chrono::milliseconds period)
      : writer_(std::move(writer)), status_(std::move(status)), period_(period) {
    thread_ = std::jthread([this](std::stop_token stop) { Beat(stop); });
  }
  ~Heart() {
    thread_.request_stop();
    thread_.join();
    // the worker is gone for good: late joiners need not see it
    (void)writer_.Dispose(status_);
  }

  template <class Change>
  void Set(const Change& change) {
    const std::lock_guard lock(mutex_);
    change(status_);
  }
  void SetPhase(const char* phase) {
    Set([&](auto& status) { status.phase = phase; });
  }

 private:
  void Beat(const std::stop_token& stop) {
    std::unique_lock lock(sleep_mutex_);
    while (!stop.stop_requested()) {
      bus::WorkerStatus status;
      {
        const std::lock_guard status_lock(mutex_);
        status = status_;
      }
      if (const Status written = writer_.Write(status); !written) Log().debug("heartbeat: {}", written.error().message);
      wake_.wait_for(lock, stop, period_, [] { return false; });
    }
  }

  bus::Writer<bus::WorkerStatus> writer_;
  std::mutex mutex_;
  bus::WorkerStatus status_;  // guarded by mutex_
  std::chrono::milliseconds period_;
  std::mutex sleep_mutex_;
  std::condition_variable_any wake_;
  std::jthread thread_;
};

}  // namespace

struct WorkerClient::Impl {
  WorkerOptions options;
  bus::Reader<bus::CampaignAnnouncement> announcements;
  bus::Reader<bus::Lease> leases;
  bus::Writer<bus::WorkRequest> requests;
  bus::Writer<bus::AttemptReport> reports;
  bus::ObjectSender sender;
  std::unique_ptr<Heart> heart;

  std::optional<bus::CampaignAnnouncement> announcement;  // the newest
  std::string made_for;                                   // spec hash that `work` was made for
  WorkFunction work;
  std::string files_sha256;
  std::uint64_t request_id = 0;
  std::optional<bus::AttemptReport> last_report;  // of the last attempt that failed
  std::uint64_t episodes = 0, failures = 0;

  void TakeAnnouncements();
  Status Join();
  Status Prepare(const WorkFactory& factory);
  Result<bus::Lease> Ask();
  Status Serve(const bus::Lease& lease);
  void Send(const bus::Lease& lease, const WorkResult& result);
  void Report(const bus::Lease& lease, const std::string& outcome, const std::string& details_json);
};

void WorkerClient::Impl::TakeAnnouncements() {
  for (auto& taken : announcements.Take())
    if (taken.campaign == options.campaign && (!announcement || taken.epoch >= announcement->epoch))
      announcement = std::move(taken);
}

// Waits for the campaign's announcement.
Status WorkerClient::Impl::Join() {
  Stopwatch since_word;
  bool said = false;
  TakeAnnouncements();
  while (!announcement && !StopRequested()) {
    if (!said || since_word.Seconds() > 30) {
      Log().info("waiting for campaign={}: is its collector running on this domain?", options.campaign);
      since_word.Restart();
      said = true;
    }
    announcements.Wait(1s);
    TakeAnnouncements();
  }
  return {};
}

// Makes the work function, again when the spec has changed.
Status WorkerClient::Impl::Prepare(const WorkFactory& factory) {
  if (announcement->version != options.version)
    return Fail(Code::kUnavailable,
                fmt::format("join campaign '{}': its collector is version {}, this worker is {}: install the "
                            "same version on both",
                            options.campaign, announcement->version, options.version));
  if (work && made_for == announcement->spec_sha256) return {};
  const std::string origin = fmt::format("campaign '{}'", options.campaign);
  const OrderedJson json = OrderedJson::parse(announcement->spec_json, nullptr, false);
  ETUDE_ASSIGN_OR_RETURN(const auto spec, FromJson<CampaignSpec>(json, origin));
  ETUDE_RETURN_IF_ERROR(spec.Validate());
  if (SpecHash(spec) != announcement->spec_sha256)
    return Fail(Code::kUnavailable, fmt::format("join {}: the announced hash does not fit the spec", origin));
  work = nullptr;  // the old one's context goes first
  ETUDE_ASSIGN_OR_RETURN(work, factory(spec));
  files_sha256.clear();
  if (options.files_sha256) {
    ETUDE_ASSIGN_OR_RETURN(files_sha256, options.files_sha256(spec));
  }
  made_for = announcement->spec_sha256;
  return {};
}

// Asks until answered; the collector may be away for a while.
Result<bus::Lease> WorkerClient::Impl::Ask() {
  // the first answers may be lost while both sides still discover each other
  auto patience = std::min<std::chrono::milliseconds>(100ms, options.ask_again);
  while (!StopRequested()) {
    const std::uint64_t id = ++request_id;
    if (const Status asked = requests.Write({options.campaign, options.name, id, options.version, files_sha256});
        !asked)
      Log().debug("request: {}", asked.error().message);
    const auto deadline = MonotonicClock::now() + patience;
    patience = std::min(2 * patience, options.ask_again);
    while (MonotonicClock::now() < deadline && !StopRequested()) {
      if (!leases.Wait(deadline - MonotonicClock::now())) break;
      for (auto& lease : leases.Take())
        if (lease.worker == options.name && lease.request_id == id) return lease;
    }
    TakeAnnouncements();
    if (announcement->complete) break;
  }
  bus::Lease none;
  none.kind = announcement->complete ? bus::LeaseKind::kDone : bus::LeaseKind::kWait;
  return none;
}

void WorkerClient::Impl::Report(const bus::Lease& lease, const std::string& outcome, const std::string& details_json) {
  last_report = bus::AttemptReport{options.campaign, options.name, lease.index, lease.attempt,
                                   lease.token,      outcome,      details_json};
  if (const Status sent = reports.Write(*last_report); !sent)
    Log().warn("cannot report an attempt, its lease will come again: {}", sent.error().message);
}

void WorkerClient::Impl::Send(const bus::Lease& lease, const WorkResult& result) {
  heart->SetPhase("send");
  const OrderedJson meta{{"index", lease.index}, {"attempt", lease.attempt}};
  while (true) {
    // the token is unique, so it is the object's id too: a repeat is recognised
    const auto verdict = sender.Send(lease.token, result.episode, lease.token, meta.dump(), options.send_timeout);
    if (verdict) {
      if (verdict->kind == bus::AckKind::kRefused) {
        Log().warn("refused index={} attempt={}: {}", lease.index, lease.attempt, verdict->reason);
      } else {
        ++episodes;
      }
      return;
    }
    if (StopRequested()) {
      Report(lease, kHandedBack, "{}");
      return;
    }
    Log().warn("not acknowledged yet, sending again index={}: {}", lease.index, verdict.error().message);
    TakeAnnouncements();
    if (announcement->complete) return;
  }
}

Status WorkerClient::Impl::Serve(const bus::Lease& lease) {
  // this very attempt was reported already: the report was lost, or is on its way
  if (last_report && last_report->token == lease.token) {
    (void)reports.Write(*last_report);
    WaitForStop(20ms);
    return {};
  }
  heart->Set([&](auto& status) {
    status.phase = "play";
    status.index = lease.index;
    status.attempt = lease.attempt;
    status.token = lease.token;
  });
  Stopwatch elapsed;
  const auto result = work({lease.index, lease.attempt});
  const double seconds = elapsed.Seconds();
  if (!result) {
    Report(lease, kHandedBack, "{}");
    return Fail(result.error());
  }
  if (result->episode.empty()) {
    ++failures;
    Report(lease, result->outcome, result->details_json);
  } else if (StopRequested()) {
    Report(lease, kHandedBack, "{}");
  } else {
    Send(lease, *result);
  }
  heart->Set([&](auto& status) {
    status.phase = "idle";
    status.token = 0;
    status.episodes = episodes;
    status.failures = failures;
    status.steps_per_second = static_cast<double>(result->steps) / seconds;
    status.frames_per_second = static_cast<double>(result->frames) / seconds;
  });
  return {};
}

WorkerClient::WorkerClient(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
WorkerClient::WorkerClient(WorkerClient&&) noexcept = default;
WorkerClient& WorkerClient::operator=(WorkerClient&&) noexcept = default;
WorkerClient::~WorkerClient() = default;
const std::string& WorkerClient::name() const { return impl_->options.name; }

Result<WorkerClient> WorkerClient::Open(const bus::Participant& participant, const WorkerOptions& options) {
  WorkerOptions resolved = options;
  if (!IsPlainName(resolved.campaign))
    return Fail(Code::kInvalidArgument, fmt::format("--campaign '{}': a name of a-z, 0-9, _ and -", resolved.campaign));
  if (resolved.name.empty()) resolved.name = bus::UniquePeerName();
  const std::string& partition = resolved.campaign;
  ETUDE_ASSIGN_OR_RETURN(auto announcements, bus::Reader<bus::CampaignAnnouncement>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto leases, bus::Reader<bus::Lease>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto requests, bus::Writer<bus::WorkRequest>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto reports, bus::Writer<bus::AttemptReport>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto heartbeats, bus::Writer<bus::WorkerStatus>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto sender, bus::ObjectSender::Open(participant, partition, "episode", resolved.name));
  bus::WorkerStatus status;
  status.campaign = resolved.campaign;
  status.worker = resolved.name;
  status.host = HostName();
  status.phase = "idle";
  const auto heartbeat = resolved.heartbeat;
  return WorkerClient(std::unique_ptr<Impl>(
      new Impl{.options = std::move(resolved),
               .announcements = std::move(announcements),
               .leases = std::move(leases),
               .requests = std::move(requests),
               .reports = std::move(reports),
               .sender = std::move(sender),
               .heart = std::make_unique<Heart>(std::move(heartbeats), std::move(status), heartbeat)}));
}

Status WorkerClient::Run(const WorkFactory& factory) {
  Impl& impl = *impl_;
  ETUDE_RETURN_IF_ERROR(impl.Join());
  while (!StopRequested()) {
    impl.TakeAnnouncements();
    ETUDE_RETURN_IF_ERROR(impl.Prepare(factory));
    ETUDE_ASSIGN_OR_RETURN(const bus::Lease lease, impl.Ask());
    switch (lease.kind) {
      case bus::LeaseKind::kDone:
        return {};
      case bus::LeaseKind::kRefused:
        return Fail(Code::kUnavailable, lease.reason);
      case bus::LeaseKind::kWait:
        WaitForStop(200ms);
        break;
      case bus::LeaseKind::kWork:
        ETUDE_RETURN_IF_ERROR(impl.Serve(lease));
        if (impl.options.once) return {};
        break;
    }
  }
  return {};
}

}  // namespace etude::campaign
