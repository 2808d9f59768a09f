// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/eval.cc: what is refused before anything starts.
#include <sstream>

#include "services/bus/directory.h"
#include "services/campaign/eval_report.h"
#include "services/cli/evaluation.h"
#include "services/core/command.h"
#include "services/core/config.h"
#include "tests/services/cli/cli_fixture.h"

namespace etude {
namespace eval_test {

using testing::HasSubstr;
using testing::Not;

using Outcome = CommandOutcome;

class EvalCli : public CliFixture {};

TEST_F(EvalCli, EvalRefusesWhatIsNoCheckpointBeforeAnythingStarts) {
  const Outcome outcome = Etude({"eval", "--checkpoint", WriteFile("a.safetensors", "short"), "--out", In("eval")});
  EXPECT_EQ(outcome.exit_code, kExitFailure);
  EXPECT_THAT(outcome.text, HasSubstr("a.safetensors"));
  EXPECT_THAT(outcome.text, HasSubstr("safetensors: "));
  EXPECT_THAT(outcome.text, Not(HasSubstr("started again")));
}

// the policy server would refuse each question, and the evaluation would wait for another answer
TEST_F(EvalCli, EvalRefusesAPolicyThatMayNotDrive) {
  WriteCheckpoint("a.safetensors", {{"run", "demo"}, {"refused", "CTRL has 0 trained steps"}});
  const Outcome outcome = Etude({"eval", "--checkpoint", In("a.safetensors"), "--out", In("eval"), "--domain", "81"});
  EXPECT_EQ(outcome.exit_code, kExitUsage) << outcome.text;
  EXPECT_THAT(outcome.text, HasSubstr("may not drive a robot yet: CTRL has 0 trained steps"));
  EXPECT_FALSE(std::filesystem::exists(In("eval")));
}

TEST_F(EvalCli, EvalOfARunThatIsNotThereSaysSoInsteadOfWaiting) {
  const Outcome outcome = Etude({"eval", "--subscribe", "nobody", "--out", In("eval"), "--domain", "81"});
  EXPECT_EQ(outcome.exit_code, kExitMachine) << outcome.text;
  EXPECT_THAT(outcome.text, HasSubstr("neither a run nor a policy server"));
  EXPECT_EQ(Etude({"eval", "--subscribe", "Nobody@x", "--out", In("eval"), "--domain", "81"}).exit_code, kExitUsage);
}

TEST_F(EvalCli, ALogForProgramsHasNoOtherLines) {
  const auto participant = bus::Participant::Open({81, ""});
  ASSERT_TRUE(participant);
  const auto server = bus::Announcement::Open(
      *participant, bus::MakePresence(bus::PresenceKind::kPolicy, "served", "aaaa000000000001", ""), Claim::kRefuse);
  ASSERT_TRUE(server);
  const Outcome outcome = Etude({"eval", "--subscribe", "served", "--scenes", In("none.yaml"), "--out", In("eval"),
                                 "--domain", "81", "--log", "json"});
  EXPECT_THAT(outcome.text, HasSubstr("asking the policy server of run served@"));
  std::istringstream lines(outcome.text);
  for (std::string line; std::getline(lines, line);)
    EXPECT_FALSE(OrderedJson::parse(line, nullptr, false).is_discarded()) << line;
}

TEST_F(EvalCli, EvalSaysWhatIsWrongWithItsSuites) {
  const std::string checkpoint = WriteFile("a.safetensors", "short");
  for (const auto& [wrong, says] : std::vector<std::pair<std::vector<std::string>, std::string>>{
           {{"--occlude", "1.5"}, "--occlude"},
           {{"--pushes", "11"}, "--pushes"},
           {{"--scenes-each", "3"}, "--sentences"},
           {{"--sentences", "table11", "--tasks", "pick"}, "--tasks"},
           {{"--sentences", "table11", "--episodes", "9"}, "--episodes"}}) {
    std::vector<std::string> arguments{"eval", "--checkpoint", checkpoint, "--out", In("e")};
    arguments.insert(arguments.end(), wrong.begin(), wrong.end());
    const Outcome outcome = Etude(arguments);
    EXPECT_EQ(outcome.exit_code, kExitUsage) << wrong[0];
    EXPECT_THAT(outcome.text, HasSubstr(says));
  }
  const Outcome none = Etude({"eval", "--out", In("e"), "--compare", In("nothing")});
  EXPECT_NE(none.exit_code, kExitOk);
  EXPECT_THAT(none.text, HasSubstr("is no evaluation of `etude eval`"));
}

TEST_F(EvalCli, EvalSaysThatTheOtherHasOtherRulesBeforeItRollsOut) {
  WriteCheckpoint("b.safetensors", {{"run", "demo"}});
  cli::EvaluationOptions options;
  options.run = "a";
  options.out = In("a");
  OrderedJson report = campaign::EvalReport(cli::EvaluationSpec(CampaignSpec(), options), {});
  report["rules"]["rollout"] = 1;
  std::filesystem::create_directories(In("a"));
  WriteFile("a/eval.json", report.dump());
  const Outcome outcome =
      Etude({"eval", "--checkpoint", In("b.safetensors"), "--out", In("e"), "--compare", In("a"), "--domain", "81"});
  EXPECT_EQ(outcome.exit_code, kExitUsage) << outcome.text;
  EXPECT_THAT(outcome.text, HasSubstr("by other rules; different: rollout (1, now"));
  EXPECT_FALSE(std::filesystem::exists(In("e") + "/rollouts"));
}

TEST_F(EvalCli, EvalSaysWhatAnOverlayNeeds) {
  const std::string checkpoint = WriteFile("a.safetensors", "short");
  const Outcome no_videos = Etude({"eval", "--checkpoint", checkpoint, "--out", In("e"), "--overlay", "--videos", "0"});
  EXPECT_EQ(no_videos.exit_code, kExitUsage) << no_videos.text;
  EXPECT_THAT(no_videos.text, HasSubstr("--videos must be at least 1"));
  const Outcome no_policy = Etude({"eval", "--out", In("e"), "--compare", In("other"), "--overlay"});
  EXPECT_EQ(no_policy.exit_code, kExitUsage) << no_policy.text;
  EXPECT_THAT(no_policy.text, HasSubstr("--overlay asks the policy"));
  const Outcome nobody = Etude({"eval", "--out", In("e"), "--compare", In("other"), "--insight"});
  EXPECT_EQ(nobody.exit_code, kExitUsage) << nobody.text;
  EXPECT_THAT(nobody.text, HasSubstr("--insight asks the policy"));
  WriteCheckpoint("b.safetensors", {{"run", "demo"}});
  const Outcome no_pictures = Etude({"eval", "--checkpoint", In("b.safetensors"), "--out", In("e"), "--overlay",
                                     "--set", "rollout.record=false", "--domain", "81"});
  EXPECT_EQ(no_pictures.exit_code, kExitUsage) << no_pictures.text;
  EXPECT_THAT(no_pictures.text, HasSubstr("rollout.record must be true"));
}

// the seed of --seed is mixed so that no scene is one that a collection drew; one from --set would not be
TEST_F(EvalCli, EvalRefusesASeedThatIsNotMixed) {
  WriteCheckpoint("b.safetensors", {{"run", "demo"}});
  const Outcome outcome =
      Etude({"eval", "--checkpoint", In("b.safetensors"), "--out", In("e"), "--set", "seed=7", "--domain", "81"});
  EXPECT_EQ(outcome.exit_code, kExitUsage) << outcome.text;
  EXPECT_THAT(outcome.text, HasSubstr("--set seed: say --seed, which never meets a collection's"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "e/rollouts"));
}

TEST_F(EvalCli, UpSaysWhatIsWrongWithItsEvaluationBeforeItStarts) {
  WriteFile("c.yaml", "name: x\n");
  for (const auto& [text, says] :
       std::initializer_list<std::pair<const char*, const char*>>{{"eval: {tasks: [pik]}", "eval: campaign 'eval-"},
                                                                  {"eval: {tasks: [pik]}", "did you mean 'pick'?"},
                                                                  {"eval: {episodes: 0}", "episodes: 0 not in"},
                                                                  {"workers: -1", "workers: -1 not in 0..100"},
                                                                  {"workers: 101", "workers: 101 not in 0..100"}}) {
    const std::string file = WriteFile("up.yaml", std::string("campaign: c.yaml\n") + text + "\n");
    const Outcome outcome = Etude({"up", file, "--out", In("out"), "--domain", "81"});
    EXPECT_EQ(outcome.exit_code, kExitUsage) << text << outcome.text;
    EXPECT_THAT(outcome.text, HasSubstr(says)) << text;
  }
  EXPECT_FALSE(std::filesystem::exists(In("out"))) << "nothing was made";
}

// Before, it was the trainer's last word, when enough had been collected.
TEST_F(EvalCli, UpSaysWhatIsWrongWithItsTrainingBeforeItCollects) {
  WriteFile("c.yaml", "name: x\n");
  for (const auto& [text, says] : std::initializer_list<std::pair<const char*, const char*>>{
           {"config: compcat", "did you mean 'compact'?"},
           {"minutes: 0", "give --steps N or --minutes M"},
           {"minutes: -3", "minutes: -3 not in 0.."},
           {"set: [policy.activation=silk]", "silk"},
           {"set: [optimizer.lrr=1]", "did you mean 'lr'?"},
           {"set: [policy.language=clip:none]", "none"},
           {"set: [init.from=none.safetensors]", "none.safetensors"},
           {"set: ['init.freeze=[image]']", "nothing was learned yet"}}) {
    const std::string file = WriteFile("up.yaml", std::string("campaign: c.yaml\ntrain: {") + text + "}\n");
    const Outcome outcome = Etude({"up", file, "--out", In("out"), "--domain", "81"});
    EXPECT_NE(outcome.exit_code, kExitOk) << text;
    EXPECT_THAT(outcome.text, HasSubstr(file + ": train: ")) << text;
    EXPECT_THAT(outcome.text, HasSubstr(says)) << text;
  }
  EXPECT_FALSE(std::filesystem::exists(In("out"))) << "nothing was made";
}

}  // namespace eval_test
}  // namespace etude
