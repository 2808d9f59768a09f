// SPDX-License-Identifier: Apache-2.0
// Tests services/cli: the program as a user meets it. Exit codes, messages, help.
#include "services/core/command.h"
#include "services/core/config.h"
#include "tests/services/cli/cli_fixture.h"

namespace etude {
namespace cli_test {

using testing::HasSubstr;
using testing::Not;

using Outcome = CommandOutcome;

class Cli : public CliFixture {};

TEST_F(Cli, EveryCommandHasHelp) {
  const std::vector<std::vector<std::string>> commands{{},
                                                       {"up"},
                                                       {"collect"},
                                                       {"collector"},
                                                       {"eval"},
                                                       {"dataset"},
                                                       {"dataset", "info"},
                                                       {"dataset", "verify"},
                                                       {"dataset", "hash"},
                                                       {"dataset", "filter"},
                                                       {"dataset", "split"},
                                                       {"dataset", "merge"},
                                                       {"dataset", "link"},
                                                       {"dataset", "delete"},
                                                       {"dataset", "export"},
                                                       {"dataset", "import"},
                                                       {"checkpoint"},
                                                       {"checkpoint", "show"},
                                                       {"checkpoint", "promote"},
                                                       {"checkpoint", "watch"},
                                                       {"top"},
                                                       {"campaign"},
                                                       {"campaign", "list"},
                                                       {"campaign", "status"},
                                                       {"campaign", "drain"},
                                                       {"topic", "list"},
                                                       {"topic", "echo"},
                                                       {"topic", "hz"},
                                                       {"doctor"}};
  for (auto arguments : commands) {
    arguments.push_back("--help");
    const Outcome outcome = Etude(arguments);
    EXPECT_EQ(outcome.exit_code, kExitOk) << testing::PrintToString(arguments) << outcome.text;
    EXPECT_THAT(outcome.text, HasSubstr("--help"));
  }
}

TEST_F(Cli, HelpNamesEveryCommand) {
  const Outcome outcome = Etude({"--help"});
  for (const char* command : {"up", "collect", "collector", "worker", "train", "policy", "eval", "dataset",
                              "checkpoint", "config", "language", "doctor"})
    EXPECT_THAT(outcome.text, HasSubstr(std::string("\n  ") + command + " "));
}

TEST_F(Cli, DescribesConfigurations) {
  const Outcome outcome = Etude({"config", "describe", "up"});
  EXPECT_EQ(outcome.exit_code, kExitOk) << outcome.text;
  EXPECT_THAT(outcome.text, HasSubstr("train.minutes  (number, min, default 12.0)\n    how long training lasts"));
  EXPECT_THAT(Etude({"config", "describe", "campaign"}).text,
              HasSubstr("camera.fovy_deg  (number, deg, default 60.0)\n    vertical field of view"));
  EXPECT_THAT(Etude({"config", "describe", "results"}).text,
              HasSubstr("rows[].train.minutes  (number, min, default 0.0)\n    of training"));
  EXPECT_EQ(Etude({"config", "describe", "nothing"}).exit_code, kExitUsage);
}

// The shell of a user: `etude … | head`, but that the reader has gone for certain before etude prints.
TEST_F(Cli, IsEndedQuietlyByAReaderThatHasGone) {
  const std::string pipeline =
      R"(mkfifo "$1" && { read -r gone <"$1"; "$2" config describe campaign; echo "status $?" >&2; } |
         { exec <&-; echo gone >"$1"; })";
  auto process = campaign::Process::Start(
      {.argv = {"/bin/sh", "-c", pipeline, "sh", In("gone"), (ProgramsFolder() / "etude").string()},
       .log = folder_ / "output.txt"});
  ASSERT_TRUE(process) << process.error().message;
  ASSERT_TRUE(process->Wait(std::chrono::seconds(60)));
  EXPECT_EQ(ReadTextFile(folder_ / "output.txt").value_or(""), "status 141\n");
}

TEST_F(Cli, SaysWhichHeldOutWordsTrainingNeverSaw) {
  const Outcome outcome = Etude({"language", "held-out"});
  EXPECT_EQ(outcome.exit_code, kExitOk) << outcome.text;
  EXPECT_THAT(outcome.text, HasSubstr("grab, loafs"));
  EXPECT_THAT(outcome.text, HasSubstr("of 50 hold a word that training never saw"));
}

TEST_F(Cli, WrongUsageIsExitCode2) {
  EXPECT_EQ(Etude({}).exit_code, kExitUsage);
  EXPECT_EQ(Etude({"collect"}).exit_code, kExitUsage);
  EXPECT_EQ(Etude({"collect", "x.yaml", "--out", In("d"), "--workers", "many"}).exit_code, kExitUsage);
  EXPECT_EQ(Etude({"eval", "--out", In("d")}).exit_code, kExitUsage);
  EXPECT_EQ(Etude({"collect", "x.yaml", "--out", ""}).exit_code, kExitUsage) << "a variable that is not set";
  EXPECT_EQ(Etude({"doctor", "--domain", "999"}).exit_code, kExitUsage);
}

TEST_F(Cli, UnknownCommandNamesTheNearest) {
  const Outcome outcome = Etude({"colect"});
  EXPECT_EQ(outcome.exit_code, kExitUsage);
  EXPECT_THAT(outcome.text, HasSubstr("did you mean 'collect'?"));
}

TEST_F(Cli, UnknownKeyNamesTheNearest) {
  const Outcome outcome = Etude({"collect", WriteFile("c.yaml", "episode: 3\n"), "--out", In("d")});
  EXPECT_EQ(outcome.exit_code, kExitUsage);
  EXPECT_THAT(outcome.text, HasSubstr("unknown key 'episode': did you mean 'episodes'?"));
  EXPECT_FALSE(std::filesystem::exists(In("d"))) << "nothing was made";
}

TEST_F(Cli, UnknownKeyInSetNamesTheNearest) {
  const Outcome outcome =
      Etude({"collect", WriteFile("c.yaml", "name: x\n"), "--out", In("d"), "--set", "camera.widht=84"});
  EXPECT_EQ(outcome.exit_code, kExitUsage);
  EXPECT_THAT(outcome.text, HasSubstr("'camera.widht': did you mean 'width'?"));
}

TEST_F(Cli, BadYamlNamesTheLine) {
  const Outcome outcome = Etude({"collector", WriteFile("c.yaml", "name: [\n"), "--out", In("d")});
  EXPECT_EQ(outcome.exit_code, kExitUsage);
  EXPECT_THAT(outcome.text, HasSubstr("c.yaml:"));
}

TEST_F(Cli, AllProblemsOfASpecAreReportedAtOnce) {
  const Outcome outcome = Etude({"collect", WriteFile("c.yaml", "tasks: [pik]\nimage_stride: 0\n"), "--out", In("d")});
  EXPECT_EQ(outcome.exit_code, kExitUsage);
  EXPECT_THAT(outcome.text, HasSubstr("'pik' is not known, did you mean 'pick'?"));
  EXPECT_THAT(outcome.text, HasSubstr("image_stride: 0"));
}

TEST_F(Cli, MissingCampaignFileIsUsage) {
  const Outcome outcome = Etude({"collect", In("none.yaml"), "--out", In("d")});
  EXPECT_EQ(outcome.exit_code, kExitUsage);
  EXPECT_THAT(outcome.text, HasSubstr("none.yaml"));
}

TEST_F(Cli, UpRefusesAnUnknownKey) {
  const Outcome outcome = Etude({"up", WriteFile("up.yaml", "campaign: c.yaml\ntrain: {minute: 3}\n")});
  EXPECT_EQ(outcome.exit_code, kExitUsage);
  EXPECT_THAT(outcome.text, HasSubstr("'train.minute': did you mean 'minutes'?"));
}

TEST_F(Cli, ShippedFilesAreValid) {
  for (const char* name : {"quickstart", "compact", "paper"}) {
    // a folder below a file cannot be made, so that a valid spec gets as far as the disk
    const std::string blocked = WriteFile("file", "");
    const Outcome outcome = Etude({"collector", std::string("deploy/campaigns/") + name + ".yaml", "--out",
                                   blocked + "/below", "--domain", "81"});
    EXPECT_NE(outcome.exit_code, kExitUsage) << outcome.text;
    EXPECT_NE(outcome.exit_code, kExitOk);
  }
}

TEST_F(Cli, EveryDescribedKeyIsOneThatCampaignsTake) {
  const OrderedJson keys = JsonOf({"config", "describe", "campaign"});
  ASSERT_GT(keys.size(), 40u);
  std::vector<std::string> arguments{
      "collect", WriteFile("c.yaml", ""), "--out", WriteFile("file", "") + "/below", "--domain", "81"};
  for (const auto& key : keys) {
    EXPECT_FALSE(key["meaning"].get<std::string>().empty() && key["type"] != "section") << key["key"];
    // keys of a list's items have no path of their own
    if (key["type"] == "section" || key["key"].get<std::string>().find("[]") != std::string::npos) continue;
    arguments.insert(arguments.end(),
                     {"--set", key["key"].get<std::string>() + "=" + key["default"].get<std::string>()});
  }
  // all keys at their defaults are the default campaign, which gets as far as the folder that cannot be made
  const Outcome outcome = Etude(arguments);
  EXPECT_NE(outcome.exit_code, kExitUsage) << outcome.text;
  EXPECT_NE(outcome.exit_code, kExitOk);
  EXPECT_THAT(outcome.text, HasSubstr("file"));
}

TEST_F(Cli, HeldOutWordsDependOnWhatIsTrained) {
  const OrderedJson three = JsonOf({"language", "held-out"});
  const OrderedJson one = JsonOf({"language", "held-out", "--tasks", "push", "--objects", "cube", "coke"});
  ASSERT_TRUE(three.is_object() && one.is_object());
  EXPECT_EQ(three["table_11"].size(), 30u);
  EXPECT_EQ(three["table_8"].size(), 50u);
  EXPECT_LT(one["seen"].size(), three["seen"].size());
  EXPECT_THAT(three["seen"].dump(), HasSubstr("\"raise\""));
  EXPECT_THAT(one["seen"].dump(), Not(HasSubstr("\"raise\""))) << "only pushing was said";
  const Outcome unknown = Etude({"language", "held-out", "--tasks", "pussh"});
  EXPECT_EQ(unknown.exit_code, kExitUsage);
  EXPECT_THAT(unknown.text, HasSubstr("did you mean 'push'?"));
  // as a campaign's objects: they were taken for names of one's own
  EXPECT_THAT(JsonOf({"language", "held-out", "--objects", "generated:train"})["seen"].dump(), HasSubstr("\"apple\""));
  const Outcome typo = Etude({"language", "held-out", "--objects", "cubee"});
  EXPECT_EQ(typo.exit_code, kExitUsage);
  EXPECT_THAT(typo.text, HasSubstr("did you mean 'cube'?"));
}

TEST_F(Cli, UpNamesWhatIsMissingInItsFile) {
  for (const auto& [text, says] : std::initializer_list<std::pair<const char*, const char*>>{
           {"", "campaign: name a campaign file"},
           {"campaign: c.yaml\ntrain: {run: My Run}\n", "train.run: 'My Run' must match"},
           {"campaign: none.yaml\n", "none.yaml"},
           {"campaign: bad.yaml\n", "did you mean 'pick'?"},
           {"campaign: c.yaml\ncampaign_set: [episodes=0]\n", "episodes: 0 not in"}}) {
    WriteFile("c.yaml", "name: x\n");
    WriteFile("bad.yaml", "tasks: [pik]\n");
    const Outcome outcome = Etude({"up", WriteFile("up.yaml", text), "--out", In("out")});
    EXPECT_EQ(outcome.exit_code, kExitUsage) << text << outcome.text;
    EXPECT_THAT(outcome.text, HasSubstr(says)) << text;
  }
  EXPECT_EQ(Etude({"up", In("none.yaml")}).exit_code, kExitFailure);
  EXPECT_EQ(Etude({"up", In("up.yaml"), "--workers", "0"}).exit_code, kExitUsage);
  EXPECT_FALSE(std::filesystem::exists(In("out"))) << "nothing was made";
}

TEST_F(Cli, CollectionsOptionsAreChecked) {
  const std::string spec = WriteFile("c.yaml", "name: x\n");
  for (const std::vector<std::string>& wrong : std::vector<std::vector<std::string>>{{"--workers", "101"},
                                                                                     {"--workers", "-1"},
                                                                                     {"--episodes", "0"},
                                                                                     {"--seed", "one"},
                                                                                     {"--domain", "231"},
                                                                                     {"--set", "seed"},
                                                                                     {"--shard", "3/2"},
                                                                                     {"--frobnicate"}}) {
    std::vector<std::string> arguments{"collect", spec, "--out", In("d")};
    arguments.insert(arguments.end(), wrong.begin(), wrong.end());
    EXPECT_EQ(Etude(arguments).exit_code, kExitUsage) << wrong[0];
  }
  EXPECT_EQ(Etude({"collector", spec, "--out", In("d"), "--lease", "0.1"}).exit_code, kExitUsage);
  const Outcome shard = Etude({"collector", spec, "--out", In("d"), "--shard", "0/2"});
  EXPECT_EQ(shard.exit_code, kExitUsage);
  EXPECT_THAT(shard.text, HasSubstr("NUMBER/COUNT"));
  EXPECT_FALSE(std::filesystem::exists(In("d")));
}

TEST_F(Cli, SecurityShowIsJsonForPrograms) {
  const std::string keys = In("keys");
  ASSERT_EQ(Etude({"security", "init", keys}).exit_code, kExitOk);
  for (const char* name : {"bench-1", "bench-2"})
    ASSERT_EQ(Etude({"security", "issue", keys, "--role", "worker", "--name", name}).exit_code, kExitOk);
  ASSERT_EQ(Etude({"security", "revoke", keys, "bench-2"}).exit_code, kExitOk);
  const OrderedJson issued = JsonOf({"security", "show", keys});
  ASSERT_EQ(issued.size(), 2u) << issued.dump(1);
  EXPECT_EQ(issued[0]["name"], "bench-1");
  EXPECT_EQ(issued[0]["roles"], OrderedJson::array({"worker"}));
  EXPECT_EQ(issued[0]["state"], "valid");
  EXPECT_EQ(issued[1]["state"], "revoked");
  EXPECT_GE(issued[1]["revoked"], issued[1]["not_before"]);
}

TEST_F(Cli, TrainingOnSeveralDatasetsCollectsIntoNone) {
  const std::string spec = WriteFile("c.yaml", "name: x\n");
  const Outcome refused = Etude({"train", "--data", In("a"), In("b"), "--collect", spec, "--out", In("run")});
  EXPECT_EQ(refused.exit_code, kExitUsage) << refused.text;
  EXPECT_THAT(refused.text, HasSubstr("--data names several"));
}

TEST_F(Cli, SaysItsVersion) {
  const Outcome outcome = Etude({"--version"});
  EXPECT_EQ(outcome.exit_code, kExitOk);
  EXPECT_EQ(outcome.text, Version() + "\n");
}

}  // namespace cli_test
}  // namespace etude
