// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <map>
#include <sstream>

#include "services/cli/all_commands.h"
#include "services/cli/reference.h"
#include "services/spec/attempt_outcome.h"

namespace etude::cli {
namespace {

// What a cell of a table, or a line of a page, may hold of any text.
std::string Cell(const std::string& text) {
  std::string cell;
  for (const char c : text) {
    if (c == '|' || c == '<' || c == '>') cell += '\\';
    cell += c == '\n' ? ' ' : c;
  }
  return cell;
}

std::string Code(const std::string& text) {
  return text.empty() ? "" : text.find('|') == std::string::npos ? "`" + text + "`" : Cell(text);
}

// "--domain INT in [0 - 230]", "spec (required)"
std::string OptionText(const OrderedJson& option) {
  std::string text = Code(fmt::format("{}", fmt::join(option["names"].get<std::vector<std::string>>(), ", ")));
  const auto choices = option["choices"].get<std::vector<std::string>>();
  if (!choices.empty())
    text += fmt::format(" one of {}", fmt::join(choices, ", "));
  else if (option["value"] != "")
    text += " " + Cell(option["value"].get<std::string>());
  if (option["repeats"].get<bool>()) text += ", several";
  if (option["required"].get<bool>()) text += ", needed";
  return text;
}

// The default; of what depends on the machine that is asked, that it does.
std::string DefaultText(const OrderedJson& option) {
  const std::string name = option["names"][0];
  if (name == "--workers") return option["default"] == "" ? "" : "by its cores";
  return Code(option["default"].get<std::string>());
}

std::string OptionTable(const OrderedJson& options) {
  std::string table;
  for (const auto& option : options) {
    if (option["names"][0] == "--help") continue;
    table += fmt::format("| {} | {} | {} |\n", OptionText(option), DefaultText(option),
                         Cell(option["description"].get<std::string>()));
  }
  return table.empty() ? "" : "\n| option or argument | default | meaning |\n|---|---|---|\n" + table;
}

std::string Parameters(const OrderedJson& operation) {
  std::vector<std::string> names;
  if (operation.contains("parameters"))
    for (const auto& parameter : operation["parameters"])
      if (parameter.contains("name") && parameter["in"] == "query") names.push_back(parameter["name"]);
  return fmt::format("{}", fmt::join(names, ", "));
}

}  // namespace

std::string CommandsPage(const OrderedJson& commands) {
  std::string page = "# Commands\n\nWhat the programs say of themselves. Every command has `--help` too.\n";
  for (const auto& [words, row] : FlatCommands(commands))
    page += fmt::format("\n## etude {}\n\n{}\n{}", words, Cell(row["description"].get<std::string>()),
                        OptionTable(row["options"]));
  return page;
}

std::string ConfigSection(const std::string& kind, const std::string& intro, const OrderedJson& keys) {
  std::string page =
      fmt::format("\n## {}\n\n{}\n\n| key | type | default | unit | meaning |\n|---|---|---|---|---|\n", kind, intro);
  for (const auto& key : keys)
    page += fmt::format("| `{}` | {} | {} | {} | {} |\n", key["key"].get<std::string>(),
                        Cell(key["type"].get<std::string>()), Code(key["default"].get<std::string>()),
                        Cell(key["unit"].get<std::string>()), Cell(key["meaning"].get<std::string>()));
  return page;
}

std::string HttpPage(const OrderedJson& api) {
  std::string page =
      "# HTTP API of the dashboard\n\nPaths begin with `/api/v1`, except those that say otherwise; `/openapi.json` "
      "below it has the whole of it for programs.\n\n| request | query | answer |\n|---|---|---|\n";
  for (const auto& [path, methods] : api["paths"].items())
    for (const auto& [method, operation] : methods.items()) {
      if (!operation.is_object()) continue;
      std::string verb = method;
      for (char& c : verb) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
      page += fmt::format("| `{} {}` | {} | {} |\n", verb, path, Cell(Parameters(operation)),
                          Cell(operation.value("summary", "")));
    }
  return page;
}

std::string MetricsPage(const std::string& families) {
  std::map<std::string, std::string> help;
  std::string table;
  std::istringstream lines(families);
  for (std::string hash, kind, name, rest; lines >> hash >> kind >> name && std::getline(lines >> std::ws, rest);) {
    if (kind == "HELP") help[name] = rest;
    if (kind == "TYPE") table += fmt::format("| `{}` | {} | {} |\n", name, rest, Cell(help[name]));
  }
  return "# Metrics\n\n`GET /metrics` of the dashboard, in Prometheus' text format.\n\n| metric | type | meaning "
         "|\n|---|---|---|\n" +
         table;
}

std::string FailuresPage(const OrderedJson& outcomes) {
  std::string page =
      "# How an attempt ends\n\nThe `outcome` of a line in `attempts.jsonl`, of a report on the bus, and of a rollout. "
      "Only `success` makes a demonstration; the reason beside it says the rest in words, and `etude attempt replay` "
      "shows it.\n\n| outcome | meaning |\n|---|---|\n";
  for (const auto& row : outcomes)
    page += fmt::format("| `{}` | {} |\n", row["outcome"].get<std::string>(), Cell(row["meaning"].get<std::string>()));
  page += fmt::format(
      "| `{}` | the collector's word: it crashed or hung three workers, one after the other, and the next "
      "attempt is made instead; a rollout is given up |\n",
      kKillsWorkers);
  return page;
}

}  // namespace etude::cli
