// SPDX-License-Identifier: Apache-2.0
// etude-collector: owns a campaign; workers on any host join it.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <condition_variable>
#include <mutex>
#include <stop_token>
#include <thread>

#include "services/bus/arguments.h"
#include "services/bus/process_reporter.h"
#include "services/campaign/collector.h"
#include "services/campaign/spec_file.h"
#include "services/core/command.h"
#include "services/core/command_table.h"
#include "services/core/service_manager.h"

namespace etude {
namespace {

struct Arguments {
  campaign::SpecArguments spec;
  std::string out, shard;
  bus::Arguments bus;
  double lease_s = 10;
  double away_s = std::chrono::duration<double>(campaign::CollectorOptions().away).count();
  std::uint64_t max_memory_mb = campaign::CollectorOptions().max_memory >> 20;
  Claim claim = Claim::kRefuse;
};

// Tells the service manager once a second how far the campaign is, until it is stopped.
void TellProgress(const std::stop_token& stop, const campaign::Collector& collector) {
  std::mutex mutex;
  std::condition_variable_any wake;
  std::unique_lock lock(mutex);
  while (!stop.stop_requested()) {
    ServiceManager::Get().Say(campaign::ProgressLine(collector.progress()));
    wake.wait_for(lock, stop, std::chrono::seconds(1), [] { return false; });
  }
}

Status Collect(const Arguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const CampaignSpec spec, campaign::LoadSpec(arguments.spec));
  campaign::CollectorOptions options;
  if (!arguments.shard.empty()) {
    ETUDE_ASSIGN_OR_RETURN(options.shard, ParseShard(arguments.shard));
  }
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open({security::Role::kCollector}));
  ETUDE_ASSIGN_OR_RETURN(const auto reporter,
                         bus::ProcessReporter::Start(participant, {.role = "collector", .folder = arguments.out}));
  options.lease = std::chrono::milliseconds(static_cast<std::int64_t>(arguments.lease_s * 1000));
  options.away = std::chrono::milliseconds(static_cast<std::int64_t>(arguments.away_s * 1000));
  options.claim = arguments.claim;
  options.max_memory = arguments.max_memory_mb << 20;
  ETUDE_ASSIGN_OR_RETURN(auto collector, campaign::Collector::Open(participant, spec, arguments.out, options));
  ServiceManager::Get().Ready(fmt::format("campaign {}@{}", spec.name, collector.id()));
  const std::jthread teller([&](const std::stop_token& stop) { TellProgress(stop, collector); });
  ETUDE_RETURN_IF_ERROR(collector.Run());
  fmt::print("{}\n", campaign::SummaryText(collector.progress()));
  return {};
}

}  // namespace
}  // namespace etude

int main(int argc, char** argv) {
  CLI::App app(
      "Owns a campaign: leases work to workers on any host, commits what they send. Run again, it "
      "resumes.",
      "etude collector");
  etude::Arguments arguments;
  app.add_option("spec", arguments.spec.file, "campaign file (YAML)")->required();
  app.add_option("--out", arguments.out, "dataset folder")->required()->check(etude::NamesAPlace());
  app.add_option("--episodes", arguments.spec.episodes, "instead of the file's count");
  app.add_option("--seed", arguments.spec.seed, "instead of the file's seed");
  app.add_option("--set", arguments.spec.overrides, "KEY=VALUE of the campaign, e.g. camera.width=84")
      ->allow_extra_args(false);
  app.add_option("--lease", arguments.lease_s, "seconds of silence after which a worker's work goes to another")
      ->check(CLI::Range(1.0, 3600.0))  // heartbeats come twice a second
      ->capture_default_str();
  app.add_option("--away", arguments.away_s,
                 "seconds to stay when all is done, for workers of the last minute that are not to be heard")
      ->check(CLI::Range(0.0, 3600.0))
      ->capture_default_str();
  app.add_option("--max-memory", arguments.max_memory_mb,
                 "MiB of episodes that came and are not on the disk yet; senders beyond it wait")
      ->check(CLI::Range(1, 1 << 20))
      ->capture_default_str();
  app.add_option("--shard", arguments.shard,
                 "I/K: only every K-th episode, from the I-th on; K collectors with a folder each share the campaign");
  etude::bus::AddClaim(app, arguments.claim);
  arguments.bus.Add(app);
  if (const auto ended = etude::ParseCommandLine(app, argc, argv)) return *ended;
  return etude::RunMain("etude-collector", [&] { return etude::Collect(arguments); });
}
