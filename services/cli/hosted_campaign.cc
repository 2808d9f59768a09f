// SPDX-License-Identifier: Apache-2.0
#include "services/cli/hosted_campaign.h"

#include <fmt/format.h>

#include <atomic>
#include <thread>

#include "services/core/log.h"
#include "services/core/without_throwing.h"

namespace etude::cli {

struct HostedCampaign::Host {
  campaign::Collector collector;
  Status status;
  std::atomic<bool> ended{false};
  std::thread thread;

  explicit Host(campaign::Collector opened) : collector(std::move(opened)) {
    thread = std::thread([this] {
      status = WithoutThrowing([this] { return collector.Run(); });
      ended.store(true);
    });
  }
  ~Host() { Join(); }
  void Join() {
    if (!thread.joinable()) return;
    collector.Stop();
    thread.join();
  }
};

Result<std::unique_ptr<HostedCampaign>> HostedCampaign::Start(const bus::Participant& participant,
                                                              const CampaignSpec& spec, const HostOptions& options) {
  ETUDE_ASSIGN_OR_RETURN(auto collector, campaign::Collector::Open(participant, spec, options.out,
                                                                   {.shard = options.shard,
                                                                    .claim = options.claim,
                                                                    .policy_id = options.policy_id,
                                                                    .run_id = options.run_id,
                                                                    .subject = options.subject}));
  // nothing is there to be done: no workers are needed
  const auto before = collector.progress();
  std::unique_ptr<HostedCampaign> hosted(new HostedCampaign);
  hosted->host_ = std::make_unique<Host>(std::move(collector));
  hosted->logs_ = options.logs;
  hosted->unheard_ = options.unheard;
  if (options.workers < 1 || before.complete) return hosted;
  campaign::Collector& running = hosted->host_->collector;
  ETUDE_ASSIGN_OR_RETURN(
      auto pool, WorkerPool::Start(
                     {.workers = options.workers,
                      .campaign = spec.name + "@" + running.id(),
                      .bus = options.bus,
                      .logs = options.logs,
                      .on_end = [&running](const std::string& name, int exit_code) { running.Revoke(name, exit_code); },
                      .done = [&running] { return running.progress().attempts; },
                      .silent = [&running] { return running.TakeSilent(); },
                      .program = options.worker}));
  hosted->pool_.emplace(std::move(pool));
  return hosted;
}

HostedCampaign::~HostedCampaign() {
  if (pool_) pool_->Stop();
}

bool HostedCampaign::ended() const { return host_->ended.load(); }

Status HostedCampaign::Supervise() {
  if (!pool_ || ended()) return {};
  const auto now = progress();
  SayUnheard(now);
  if (!now.complete) return pool_->Supervise();
  pool_->NoteEnds();  // the collector waits for those that might come back
  return {};
}

// A profile without multicast keeps the processes of a host that is no hub apart, and none of them ends.
void HostedCampaign::SayUnheard(const campaign::CollectorProgress& progress) {
  heard_ = heard_ || progress.workers > 0;
  if (heard_ || 1000 * since_start_.Seconds() < static_cast<double>(unheard_.count())) return;
  heard_ = true;
  Log().warn(
      "no worker was heard in {:.0f} s: can processes of this host hear each other? Where the profile has no multicast "
      "it has to be one of the hubs (etude doctor net --write-profile); their words are in {}",
      since_start_.Seconds(), (logs_ / "worker-0.log").string());
}

Status HostedCampaign::Finish() {
  if (pool_) pool_->Stop();
  host_->Join();
  return host_->status;
}

Status CheckNotAllGivenUp(const campaign::CollectorProgress& progress, const Path& dataset) {
  if (!progress.complete || progress.committed > 0 || progress.given_up == 0) return {};
  return Fail(
      Code::kExhausted,
      fmt::format("'{}' is complete and has no episode: all {} were given up after max_attempts attempts; why is "
                  "in '{}'",
                  dataset.string(), progress.given_up, (dataset / "attempts.jsonl").string()));
}

campaign::CollectorProgress HostedCampaign::progress() const { return host_->collector.progress(); }

}  // namespace etude::cli
