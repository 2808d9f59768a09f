// SPDX-License-Identifier: Apache-2.0
// `etude config describe KIND`: every key of a file, with its unit, default and meaning. Kinds that only another
// program knows are described by it.
#include "services/cli/command_line.h"
#include "services/cli/results_config.h"
#include "services/cli/up_config.h"
#include "services/core/config_reference.h"
#include "services/spec/campaign_spec.h"

namespace etude::cli {
namespace {

Status Describe(const std::string& kind, bool as_json) {
  const auto ask = [&](const std::string& program, std::vector<std::string> arguments) {
    if (as_json) arguments.push_back("--json");
    return ExecSibling(program, arguments);
  };
  if (kind == "experiment") return ask("etude-trainer", {"describe"});
  if (kind == "robot") return ask("etude-worker", {"robot", "describe"});
  if (kind == "up")
    PrintReference(ConfigReference<UpConfig>(), as_json);
  else if (kind == "results")
    PrintReference(ConfigReference<ResultsConfig>(), as_json);
  else
    PrintReference(ConfigReference<CampaignSpec>(), as_json);
  return {};
}

}  // namespace

void AddConfig(CLI::App& app, Body& body) {
  auto* command = AddGroup(app, "config", "what may stand in a configuration file");
  auto kind = std::make_shared<std::string>();
  auto as_json = std::make_shared<bool>(false);
  auto* describe = command->add_subcommand("describe", "every key with its type, unit, default and meaning");
  describe->add_option("kind", *kind, "campaign | up | experiment | robot | results")
      ->required()
      ->check(CLI::IsMember({"campaign", "up", "experiment", "robot", "results"}));
  describe->add_flag("--json", *as_json, "as JSON");
  describe->callback([=, &body] { body = [=] { return Describe(*kind, *as_json); }; });
}

}  // namespace etude::cli
