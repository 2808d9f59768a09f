// SPDX-License-Identifier: Apache-2.0
// `etude collect`: a collector and local workers until the dataset is complete.
#include <fmt/format.h>

#include "services/bus/process_reporter.h"
#include "services/campaign/spec_file.h"
#include "services/cli/command_line.h"
#include "services/cli/hosted_campaign.h"
#include "services/core/command_table.h"
#include "services/core/progress.h"
#include "services/core/stop.h"

namespace etude::cli {
namespace {

struct CollectArguments {
  campaign::SpecArguments spec;
  std::string out, shard;
  int workers = DefaultWorkers();
  BusArguments bus;
  Claim claim = Claim::kRefuse;
};

Status CollectEpisodes(const CollectArguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const CampaignSpec spec, campaign::LoadSpec(arguments.spec));
  Shard shard;
  if (!arguments.shard.empty()) {
    ETUDE_ASSIGN_OR_RETURN(shard, ParseShard(arguments.shard));
  }
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open({security::Role::kCollector}));
  ETUDE_ASSIGN_OR_RETURN(const auto reporter,
                         bus::ProcessReporter::Start(participant, {.role = "etude collect", .folder = arguments.out}));
  ETUDE_ASSIGN_OR_RETURN(auto hosted, HostedCampaign::Start(participant, spec,
                                                            {.bus = arguments.bus,
                                                             .workers = arguments.workers,
                                                             .out = arguments.out,
                                                             .logs = Path(arguments.out) / "logs",
                                                             .shard = shard,
                                                             .claim = arguments.claim}));
  {
    ProgressDisplay display;
    while (!hosted->ended() && !StopRequested()) {
      ETUDE_RETURN_IF_ERROR(hosted->Supervise());
      if (display.due()) display.Show(campaign::ProgressLine(hosted->progress()));
      WaitForStop(std::chrono::milliseconds(100));
    }
  }
  ETUDE_RETURN_IF_ERROR(hosted->Finish());
  const auto progress = hosted->progress();
  fmt::print("{} {}\n{}\n", progress.complete ? "complete:" : "stopped, run again to continue:", arguments.out,
             campaign::SummaryText(progress));
  return CheckNotAllGivenUp(progress, arguments.out);
}

}  // namespace

void AddCollect(CLI::App& app, Body& body) {
  auto* command = app.add_subcommand("collect", "collect demonstrations on this machine: a collector and N workers");
  auto arguments = std::make_shared<CollectArguments>();
  command->add_option("spec", arguments->spec.file, "campaign file (YAML), see deploy/campaigns/")->required();
  command->add_option("--out", arguments->out, "dataset folder; run again, it resumes")
      ->required()
      ->check(NamesAPlace());
  command->add_option("--workers", arguments->workers, "local workers, 0 for only those of other hosts")
      ->check(CLI::Range(0, kMostWorkers))
      ->capture_default_str();
  command->add_option("--episodes", arguments->spec.episodes, "instead of the file's count");
  command->add_option("--seed", arguments->spec.seed, "instead of the file's seed");
  AddOverrides(*command, arguments->spec.overrides, "image_stride=1");
  command->add_option("--shard", arguments->shard,
                      "I/K: only every K-th episode, from the I-th on, into a folder of its own (see etude collector)");
  bus::AddClaim(*command, arguments->claim);
  arguments->bus.Add(*command);
  command->callback([arguments, &body] { body = [arguments] { return CollectEpisodes(*arguments); }; });
}

}  // namespace etude::cli
