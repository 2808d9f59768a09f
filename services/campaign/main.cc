// SPDX-License-Identifier: Apache-2.0
// etude-collector: owns a campaign; workers on any host join it.
#include <CLI/CLI.hpp>

#include "services/bus/arguments.h"
#include "services/bus/process_reporter.h"
#include "services/campaign/collector.h"
#include "services/campaign/spec_file.h"
#include "services/core/command.h"
#include "services/core/log.h"

namespace etude {
namespace {

struct Arguments {
  campaign::SpecArguments spec;
  std::string out;
  bus::Arguments bus;
  double lease_s = 10;
  Claim claim = Claim::kRefuse;
};

Status Collect(const Arguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const CampaignSpec spec, campaign::LoadSpec(arguments.spec));
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open());
  ETUDE_ASSIGN_OR_RETURN(const auto reporter,
                         bus::ProcessReporter::Start(participant, {.role = "collector", .folder = arguments.out}));
  campaign::CollectorOptions options;
  options.lease = std::chrono::milliseconds(static_cast<std::int64_t>(arguments.lease_s * 1000));
  options.claim = arguments.claim;
  ETUDE_ASSIGN_OR_RETURN(auto collector, campaign::Collector::Open(participant, spec, arguments.out, options));
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
  app.add_option("--out", arguments.out, "dataset folder")->required();
  app.add_option("--episodes", arguments.spec.episodes, "instead of the file's count");
  app.add_option("--seed", arguments.spec.seed, "instead of the file's seed");
  app.add_option("--set", arguments.spec.overrides, "KEY=VALUE of the campaign, e.g. camera.width=84")
      ->allow_extra_args(false);
  app.add_option("--lease", arguments.lease_s, "seconds of silence after which a worker's work goes to another")
      ->check(CLI::Range(0.5, 3600.0));
  etude::bus::AddClaim(app, arguments.claim);
  arguments.bus.Add(app);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? etude::kExitOk : etude::kExitUsage;
  }
  return etude::RunMain("etude-collector", [&] { return etude::Collect(arguments); });
}
