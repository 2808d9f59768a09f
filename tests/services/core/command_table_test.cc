// SPDX-License-Identifier: Apache-2.0
// Tests services/core/command_table.cc
#include "services/core/command_table.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <string>
#include <vector>

#include "services/core/command.h"

namespace etude {
namespace command_table_test {

using Json = nlohmann::ordered_json;

// A program as ours are: an option of each kind, and a command with one of its own.
struct Program {
  CLI::App app{"does things", "program"};
  std::string file, channel = "latest", task;
  std::vector<std::string> words;
  int count = 3;
  bool quiet = false;

  Program() {
    app.add_option("file", file, "what to read")->required();
    app.add_option("--channel", channel, "which")->check(CLI::IsMember({"latest", "best"}));
    app.add_option("--count,-n", count, "how many")->check(CLI::Range(0, 9))->capture_default_str();
    app.add_option("--word", words, "some");
    app.add_flag("--quiet", quiet, "say nothing");
    app.add_subcommand("check", "looks")->add_option("task", task, "which task");
  }
  std::optional<int> Parse(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "program");
    std::vector<char*> argv;
    for (auto& argument : arguments) argv.push_back(argument.data());
    return ParseCommandLine(app, static_cast<int>(argv.size()), argv.data());
  }
};

const Json& Named(const Json& table, const std::string& name) {
  for (const auto& option : table["options"])
    if (option["names"][0] == name) return option;
  ADD_FAILURE() << name << " is not in " << table.dump();
  static const Json kNone;
  return kNone;
}

TEST(CommandTable, SaysWhatEachOptionTakes) {
  const Json table = CommandTable(Program().app);
  EXPECT_EQ(Named(table, "--channel")["choices"], Json({"latest", "best"}));
  EXPECT_EQ(Named(table, "--count")["names"], Json({"--count", "-n"}));
  EXPECT_EQ(Named(table, "--count")["value"], "INT in [0 - 9]");
  EXPECT_EQ(Named(table, "--count")["default"], "3");
  EXPECT_EQ(Named(table, "--quiet")["value"], "");
  EXPECT_EQ(Named(table, "--word")["repeats"], true);
  EXPECT_EQ(Named(table, "--count")["repeats"], false);
  EXPECT_EQ(Named(table, "file")["positional"], true);
  EXPECT_EQ(Named(table, "file")["required"], true);
}

TEST(CommandTable, HasCommandsInside) {
  const Json table = CommandTable(Program().app);
  ASSERT_EQ(table["commands"].size(), 1u);
  EXPECT_EQ(table["commands"][0]["name"], "check");
  EXPECT_EQ(Named(table["commands"][0], "task")["description"], "which task");
}

TEST(ParseCommandLine, GoesOnWhenTheArgumentsAreRight) {
  Program program;
  EXPECT_FALSE(program.Parse({"a.txt", "--count", "4"}).has_value());
  EXPECT_EQ(program.count, 4);
}

// As episodes' files are called: to CLI11 they were octal, and -1 the largest number there is.
TEST(ParseCommandLine, NumbersAreDecimal) {
  Program program;
  EXPECT_FALSE(program.Parse({"a.txt", "--count", "08"}).has_value());
  EXPECT_EQ(program.count, 8);
  Program zero;
  EXPECT_FALSE(zero.Parse({"a.txt", "--count", "000"}).has_value());
  EXPECT_EQ(zero.count, 0);
  testing::internal::CaptureStderr();
  EXPECT_EQ(Program().Parse({"a.txt", "--count", "010"}), kExitUsage) << "ten is more than nine";
  EXPECT_EQ(Program().Parse({"a.txt", "--count", "0x5"}), kExitUsage);
  EXPECT_EQ(Program().Parse({"a.txt", "--count", "-"}), kExitUsage);
  Program large;
  std::uint64_t seed = 0;
  large.app.add_option("--seed", seed, "of all");
  EXPECT_EQ(large.Parse({"a.txt", "--seed", "-1"}), kExitUsage);
  EXPECT_THAT(testing::internal::GetCapturedStderr(), testing::HasSubstr("-1 is below 0"));
}

TEST(ParseCommandLine, EndsWithHelpAndWithWrongUsage) {
  testing::internal::CaptureStdout();
  testing::internal::CaptureStderr();
  EXPECT_EQ(Program().Parse({"--help"}), kExitOk);
  EXPECT_EQ(Program().Parse({"a.txt", "--count", "10"}), kExitUsage);
  EXPECT_EQ(Program().Parse({}), kExitUsage);
  testing::internal::GetCapturedStdout();
  EXPECT_NE(testing::internal::GetCapturedStderr(), "");
}

TEST(ParseCommandLine, PrintsItsTableWhenAsked) {
  Program program;
  testing::internal::CaptureStdout();
  EXPECT_EQ(program.Parse({"--command-table"}), kExitOk);
  EXPECT_EQ(Json::parse(testing::internal::GetCapturedStdout()), CommandTable(program.app));
}

// before, NaN was in every range, and a larger number was the largest one
TEST(ParseCommandLine, NumbersAreFiniteAndFit) {
  testing::internal::CaptureStderr();
  for (const char* wrong : {"nan", "inf", "-nan"}) {
    Program program;
    double seconds = 1;
    program.app.add_option("--seconds", seconds, "how long")->check(CLI::Range(0.5, 9.0));
    EXPECT_EQ(program.Parse({"a.txt", "--seconds", wrong}), kExitUsage) << wrong;
  }
  Program large;
  std::uint64_t seed = 0;
  large.app.add_option("--seed", seed, "of all");
  EXPECT_EQ(large.Parse({"a.txt", "--seed", "18446744073709551616"}), kExitUsage);
  testing::internal::GetCapturedStderr();
}

}  // namespace command_table_test
}  // namespace etude
