// SPDX-License-Identifier: Apache-2.0
// Ranks that die: `etude train --ranks 2`, whose rank 1 is a process that rank 0 starts. Tests trainer/local_ranks.cc
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "services/core/command.h"
#include "tests/faults/campaign_run.h"
#include "tests/faults/trainer_run.h"
#include "tests/support/child_processes.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/wait_until.h"
#include "tests/trainer/data/synthetic_dataset.h"

namespace etude::faults {
namespace rank_faults_test {

using namespace std::chrono_literals;

constexpr int kTogether = 50;  // steps between two validations
constexpr int kAll = 300;      // of a run: some seconds behind the first validation

class RankFaults : public testing::Test {
 protected:
  void SetUp() override {
    AddSyntheticEpisodes(folder_ / "data", SyntheticSpec(learn::kTinyPicture, learn::kTinyPicture), 0, 24);
  }
  campaign::Process Start(bool resume) const {
    TrainerRun run{.data = folder_ / "data", .out = out_, .log = folder_ / "rank-0.log", .resume = resume};
    run.flags = {"--ranks", "2"};
    for (const auto& change : {fmt::format("steps={}", kAll), fmt::format("eval.every_steps={}", kTogether),
                               fmt::format("checkpoint.every_steps={}", kTogether)})
      if (!resume) run.flags.insert(run.flags.end(), {"--set", change});
    return StartTrainer(run);
  }
  // SIGKILL to rank 1, which is another program than its parent by then
  void KillRankOne(campaign::Process& trainer) {
    std::vector<pid_t> ranks;
    const auto there = [&] {
      ranks = ChildrenOf(trainer.pid());
      return !trainer.running() || (ranks.size() == 1 && WordsOf(ranks[0]).find("--meet") != std::string::npos);
    };
    ASSERT_TRUE(WaitUntil(there)) << Logs();
    ASSERT_EQ(ranks.size(), 1u) << Logs();
    ASSERT_EQ(::kill(ranks[0], SIGKILL), 0);
  }
  // Ended as one that the machine ends, and whoever reads it knows where to look.
  void ExpectItSaysWhichOneDied(campaign::Process& trainer) {
    ASSERT_EQ(trainer.Wait(60s), kExitMachine) << Logs();
    for (const std::string& words : {std::string("rank 1 of 2 ended with signal SIGKILL"),
                                     "its words are in '" + (out_ / "rank-1.log").string() + "'"})
      EXPECT_NE(Logs().find(words), std::string::npos) << words << Logs();
  }
  std::string Logs() const {
    return fmt::format("\n{}\n---- rank 1\n{}", ReadTextFile(folder_ / "rank-0.log").value_or(""),
                       ReadTextFile(out_ / "rank-1.log").value_or(""));
  }

  const TemporaryFolder folder_;
  const Path out_ = folder_ / "run";

 private:
  static std::string WordsOf(pid_t pid) {
    std::ifstream words(fmt::format("/proc/{}/cmdline", pid), std::ios::binary);
    return {std::istreambuf_iterator<char>(words), {}};
  }
};

// before, rank 0 waited five minutes and then named nobody
TEST_F(RankFaults, OneThatDiesAtOnceIsNamedAtOnce) {
  auto trainer = Start(false);
  ASSERT_NO_FATAL_FAILURE(KillRankOne(trainer));
  ASSERT_NO_FATAL_FAILURE(ExpectItSaysWhichOneDied(trainer));
  EXPECT_EQ(StepOfState(out_), 0) << "nothing was learned";
}

TEST_F(RankFaults, OneThatDiesEndsTheRunWhichGoesOnFromItsLastStep) {
  auto trainer = Start(false);
  ASSERT_TRUE(WaitUntil([&] { return LastValidation(out_) >= kTogether || !trainer.running(); })) << Logs();
  ASSERT_NO_FATAL_FAILURE(KillRankOne(trainer));
  ASSERT_NO_FATAL_FAILURE(ExpectItSaysWhichOneDied(trainer));
  EXPECT_NE(Logs().find("and can be resumed"), std::string::npos) << Logs();
  const int kept = StepOfState(out_);
  EXPECT_GE(kept, kTogether);
  EXPECT_LT(kept, kAll);
  EXPECT_TRUE(IsWhole(out_ / "checkpoints" / "latest.safetensors"));

  auto rest = Start(true);
  ASSERT_EQ(rest.Wait(120s), kExitOk) << Logs();
  EXPECT_EQ(StepOfState(out_), kAll);
  EXPECT_NE(Logs().find(fmt::format("from step {}", kept)), std::string::npos) << Logs();
  EXPECT_TRUE(IsWhole(out_ / "checkpoints" / fmt::format("{:08}.safetensors", kAll)));
}

}  // namespace rank_faults_test
}  // namespace etude::faults
