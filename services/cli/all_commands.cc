// SPDX-License-Identifier: Apache-2.0
#include "services/cli/all_commands.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "services/campaign/process.h"
#include "services/cli/command_line.h"
#include "services/cli/sibling_text.h"
#include "services/core/command_table.h"

namespace etude::cli {
namespace {

// What a program's table has below the words of `prefix`. What another command of `etude` stands for is left out.
Result<OrderedJson> TableOf(const OwnProgram& own, OrderedJson table) {
  for (const auto& word : own.prefix) {
    const auto& inner = table["commands"];
    const auto found = std::ranges::find_if(inner, [&](const auto& row) { return row["name"] == word; });
    if (found == inner.end())
      return Fail(Code::kInternal,
                  fmt::format("{} has no command '{}', which `etude {}` stands for", own.program, word, own.command));
    OrderedJson below = *found;
    table = std::move(below);
  }
  OrderedJson kept = OrderedJson::array();
  for (auto& row : table["commands"]) {
    const bool elsewhere = std::ranges::any_of(OwnPrograms(), [&](const OwnProgram& other) {
      return own.prefix.empty() && other.program == std::string_view(own.program) && !other.prefix.empty() &&
             row["name"] == other.prefix[0];
    });
    if (!elsewhere) kept.push_back(std::move(row));
  }
  table["commands"] = std::move(kept);
  table["name"] = own.command;
  if (table["description"] == "") table["description"] = own.description;
  return table;
}

void Flatten(const OrderedJson& row, const std::string& words, std::vector<std::pair<std::string, OrderedJson>>& flat) {
  const auto& inner = row["commands"];
  const bool acts =
      std::ranges::any_of(row["options"], [](const auto& option) { return option["names"][0] != "--help"; });
  if (!words.empty() && (inner.empty() || acts)) flat.emplace_back(words, row);
  for (const auto& command : inner)
    Flatten(command, (words.empty() ? "" : words + " ") + command["name"].get<std::string>(), flat);
}

}  // namespace

Result<OrderedJson> AllCommands(const CLI::App& app, Missing missing) {
  OrderedJson table = CommandTable(app);
  std::map<std::string, OrderedJson> programs;  // asked once each: torch takes a moment
  for (const auto& own : OwnPrograms()) {
    if (missing == Missing::kSkip && !campaign::FindSibling(own.program)) continue;
    if (!programs.contains(own.program)) {
      ETUDE_ASSIGN_OR_RETURN(programs[own.program], AskSiblingJson(own.program, {"--command-table"}));
    }
    ETUDE_ASSIGN_OR_RETURN(OrderedJson row, TableOf(own, programs[own.program]));
    for (auto& command : table["commands"])
      if (command["name"] == own.command) command = row;
  }
  return table;
}

std::vector<std::pair<std::string, OrderedJson>> FlatCommands(const OrderedJson& commands) {
  std::vector<std::pair<std::string, OrderedJson>> flat;
  Flatten(commands, "", flat);
  return flat;
}

}  // namespace etude::cli
