// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/reference.cc, reference_pages.cc and all_commands.cc
#include "services/cli/reference.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "services/cli/all_commands.h"
#include "tests/support/matchers.h"
#include "tests/support/run_command.h"

namespace etude::cli {
namespace reference_test {

using testing::HasSubstr;
using testing::Not;

OrderedJson Option(const std::string& name, const std::string& value) {
  return {{"names", {name}}, {"positional", false}, {"value", value},   {"choices", OrderedJson::array()},
          {"default", ""},   {"required", false},   {"repeats", false}, {"description", "a | b"}};
}

OrderedJson Commands() {
  const OrderedJson help = Option("--help", "");
  const OrderedJson inner{{"name", "info"},
                          {"description", "look"},
                          {"options", {help, Option("--size", "INT")}},
                          {"commands", OrderedJson::array()}};
  const OrderedJson group{{"name", "dataset"}, {"description", "datasets"}, {"options", {help}}, {"commands", {inner}}};
  return {{"name", "etude"}, {"description", ""}, {"options", {help}}, {"commands", {group}}};
}

TEST(FlatCommands, LeavesOutWhatOnlyGroups) {
  const auto flat = FlatCommands(Commands());
  ASSERT_EQ(flat.size(), 1u);
  EXPECT_EQ(flat[0].first, "dataset info");
}

TEST(CommandsPage, HasATableOfOptionsThatAnyTextFitsInto) {
  const std::string page = CommandsPage(Commands());
  EXPECT_THAT(page, HasAll({"## etude dataset info", "| `--size` INT |  | a \\| b |"}));
  EXPECT_THAT(page, Not(HasSubstr("| `--help`")));
}

TEST(CommandsPage, OnlyWorkersAreByTheCores) {
  auto commands = Commands();
  auto& options = commands["commands"][0]["commands"][0]["options"];
  for (const char* name : {"--workers", "--threads"}) {
    options.push_back(Option(name, "INT"));
    options.back()["default"] = "1";
  }
  const std::string page = CommandsPage(commands);
  EXPECT_THAT(page, HasAll({"| `--workers` INT | by its cores |", "| `--threads` INT | `1` |"}));
}

TEST(MetricsPage, PutsHelpAndTypeTogether) {
  const std::string page = MetricsPage("# HELP etude_x How many.\n# TYPE etude_x counter\n");
  EXPECT_THAT(page, HasSubstr("| `etude_x` | counter | How many. |"));
}

TEST(HttpPage, NamesRequestsWithTheirQueries) {
  const OrderedJson query{{"name", "task"}, {"in", "query"}}, path{{"name", "id"}, {"in", "path"}};
  const OrderedJson get{{"summary", "rows"}, {"parameters", {path, query}}};
  const std::string page = HttpPage({{"paths", {{"/evals/{id}", {{"get", get}}}}}});
  EXPECT_THAT(page, HasSubstr("| `GET /evals/{id}` | task | rows |"));
}

TEST(ConfigSection, HasUnitsAndDefaults) {
  const OrderedJson key{
      {"key", "camera.width"}, {"type", "integer"}, {"unit", "px"}, {"default", "224"}, {"meaning", "wide"}};
  EXPECT_THAT(ConfigSection("campaign", "What.", OrderedJson::array({key})),
              HasSubstr("| `camera.width` | integer | `224` | px | wide |"));
}

// The kept pages are what the programs say today; deploy/docs/generate makes them again.
TEST(Reference, IsWhatTheProgramsSay) {
  const auto output = RunInShell("ETUDE_DOCS_DOMAIN=73 deploy/docs/generate --check 2>&1");
  EXPECT_EQ(output.code, 0) << output.text;
}

}  // namespace reference_test
}  // namespace etude::cli
