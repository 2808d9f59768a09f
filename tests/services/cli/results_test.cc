// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/results.cc: what `etude results` takes from a folder of earlier runs, and what it does not.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "services/core/command.h"
#include "services/core/config.h"
#include "tests/support/etude_command.h"
#include "tests/support/temporary_folder.h"

namespace etude {
namespace results_test {

using testing::HasSubstr;
using testing::Not;

// A folder in which row 'a' was made with training seed 7, but for what a test leaves out. Nothing here is collected,
// trained or rolled out: the campaigns do not exist.
class Results : public testing::Test {
 protected:
  CommandOutcome Make(const std::string& minutes, std::vector<std::string> more = {}) {
    const std::string rows = fmt::format(
        "rows:\n"
        "  - name: a\n    title: first\n    data: {{campaign: none.yaml}}\n"
        "    train: {{minutes: {}, seeds: [7]}}\n    eval: {{episodes: 10}}\n"
        "  - name: b\n    title: second\n    data: {{campaign: none.yaml}}\n"
        "    train: {{minutes: 5, init: a}}\n    eval: {{episodes: 10}}\n"
        "  - name: c\n    title: third\n    train: {{runs_of: a, seeds: [7]}}\n"
        "    eval: {{sentences: table8, scenes_each: 2}}\n",
        minutes);
    Write("results.yaml", rows);
    std::vector<std::string> arguments{"results", In("results.yaml"), "--out", In("out"), "--domain", "81"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return RunEtude(arguments, folder_ / "output.txt");
  }
  void Write(const std::string& name, const std::string& text) {
    ASSERT_TRUE(WriteFileAtomically(folder_ / name, std::string_view(text)));
  }
  void WriteReport(int done, int invalid) {
    const OrderedJson all{{"task", "overall"},
                          {"n", done},
                          {"success", {{"successes", done}}},
                          {"success_latched", {{"successes", done}}}};
    Write("out/eval/a-7/eval.json",
          OrderedJson({{"done", done}, {"overall", all}, {"scenes", {{"invalid", invalid}}}}).dump());
  }
  std::string In(const std::string& name) const { return (folder_ / name).string(); }

  TemporaryFolder folder_;
};

TEST_F(Results, ARowThatIsDefinedAnewIsNotTakenFromItsOldFolder) {
  Write("out/runs/a-7/whole", "\n");
  WriteReport(10, 0);
  const CommandOutcome made = Make("10", {"--row", "a"});
  ASSERT_EQ(made.exit_code, kExitOk) << made.text;
  EXPECT_THAT(made.text, HasSubstr("| first | the campaign's | 10 min | scratch | 100.0 ["));

  const CommandOutcome anew = Make("20", {"--row", "a"});
  EXPECT_EQ(anew.exit_code, kExitUsage) << anew.text;
  for (const char* part : {"row 'a' is not what", "rows/a.json, eval/a-[0-9]*, runs/a-[0-9]*", "another --out"})
    EXPECT_THAT(anew.text, HasSubstr(part));
  EXPECT_THAT(anew.text, Not(HasSubstr("| first |")));

  EXPECT_EQ(Make("10", {"--row", "a"}).exit_code, kExitOk) << "as it was, it is still the same row";
}

// one of ten scenes cannot be done by the expert: nine rollouts and that one are the whole evaluation
TEST_F(Results, AScenelessRolloutDoesNotStopTheTable) {
  Write("out/runs/a-7/whole", "\n");
  WriteReport(9, 1);
  const CommandOutcome made = Make("10", {"--row", "a"});
  EXPECT_EQ(made.exit_code, kExitOk) << made.text;
  EXPECT_THAT(made.text, HasSubstr("| first |"));
  EXPECT_THAT(made.text, Not(HasSubstr("eval-a-7"))) << "nothing is missing";

  WriteReport(9, 0);
  const CommandOutcome missing = Make("10", {"--row", "a"});
  EXPECT_NE(missing.exit_code, kExitOk) << missing.text;
  EXPECT_THAT(missing.text, HasSubstr("eval-a-7: etude eval"));
}

TEST_F(Results, BeginsOnlyWithRunsThatCameToTheirEnd) {
  Write("out/runs/a-7/checkpoints/latest.safetensors", "stopped in the middle");
  const CommandOutcome stopped = Make("10", {"--row", "b"});
  EXPECT_EQ(stopped.exit_code, kExitFailure) << stopped.text;
  EXPECT_THAT(stopped.text, HasSubstr("row 'b' begins with 'a', of which no run in"));
  EXPECT_THAT(stopped.text, Not(HasSubstr("data-b"))) << "asked before anything is collected";

  // its seed is one of row a's, not of b's
  Write("out/runs/a-7/whole", "\n");
  const CommandOutcome whole = Make("10", {"--row", "b"});
  EXPECT_THAT(whole.text, HasSubstr("data-b: etude collect none.yaml"));
  EXPECT_THAT(whole.text, HasSubstr("data-b ended with"));

  Write("out/rows/a.json", "{}");
  const CommandOutcome other = Make("10", {"--row", "b"});
  EXPECT_EQ(other.exit_code, kExitUsage) << other.text;
  EXPECT_THAT(other.text, HasSubstr("row 'a' is not what"));
}

// a row of its own, of runs that are there: sentences are as many as their suite has
TEST_F(Results, EvaluatesTheRunsOfAnotherRow) {
  const CommandOutcome early = Make("10", {"--row", "c"});
  EXPECT_EQ(early.exit_code, kExitFailure) << early.text;
  EXPECT_THAT(early.text, HasSubstr("make that row first"));

  Write("out/runs/a-7/whole", "\n");
  Write("out/eval/c-7/eval.json", R"({"done": 7, "episodes": 8, "overall": {"n": 7}})");
  const CommandOutcome going_on = Make("10", {"--row", "c"});
  EXPECT_THAT(going_on.text, HasSubstr("--sentences table8 --scenes-each 2"));
  EXPECT_THAT(going_on.text, Not(HasSubstr("--episodes")));

  Write("out/eval/c-7/eval.json", R"({"done": 8, "episodes": 8, "overall": {"n": 8, "success": {"successes": 6}}})");
  const CommandOutcome whole = Make("10", {"--row", "c"});
  ASSERT_EQ(whole.exit_code, kExitOk) << whole.text;
  EXPECT_THAT(whole.text, HasSubstr("| third | - | - | runs of a | 75.0 ["));
}

}  // namespace results_test
}  // namespace etude
