// SPDX-License-Identifier: Apache-2.0
// `etude config describe KIND`: every key of a file, with its unit, default and meaning.
#include <fmt/format.h>

#include "services/cli/command_line.h"
#include "services/cli/up_config.h"
#include "services/core/config_reference.h"
#include "services/spec/campaign_spec.h"

namespace etude::cli {
namespace {

std::vector<ConfigKey> ReferenceOf(const std::string& kind) {
  return kind == "up" ? ConfigReference<UpConfig>() : ConfigReference<CampaignSpec>();
}

Status Describe(const std::string& kind, bool as_json) {
  const auto keys = ReferenceOf(kind);
  if (!as_json) {
    fmt::print("{}", FormatReference(keys));
    return {};
  }
  OrderedJson list = OrderedJson::array();
  for (const auto& key : keys)
    list.push_back({{"key", key.path},
                    {"type", key.type},
                    {"unit", key.unit},
                    {"default", key.default_value},
                    {"meaning", key.meaning}});
  fmt::print("{}\n", list.dump(1));
  return {};
}

}  // namespace

void AddConfig(CLI::App& app, Body& body) {
  auto* command = app.add_subcommand("config", "what may stand in a configuration file");
  command->require_subcommand(1);
  auto kind = std::make_shared<std::string>();
  auto as_json = std::make_shared<bool>(false);
  auto* describe = command->add_subcommand("describe", "every key with its type, unit, default and meaning");
  describe->add_option("kind", *kind, "campaign | up")->required()->check(CLI::IsMember({"campaign", "up"}));
  describe->add_flag("--json", *as_json, "as JSON");
  describe->callback([=, &body] { body = [=] { return Describe(*kind, *as_json); }; });
}

}  // namespace etude::cli
