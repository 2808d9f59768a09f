// SPDX-License-Identifier: Apache-2.0
// Tests services/monitor/sentence.cc
#include "services/monitor/sentence.h"

#include <gtest/gtest.h>

namespace etude::monitor {
namespace sentence_test {

TEST(Sentence, TellsWhatIsUnderWay) {
  Facts facts;
  facts.collection = CollectionFacts{"quickstart", "running", 412, 600, 0, 185.0};
  facts.training = TrainingFacts{"running", "CTRL", 5, 5, 6589, std::nullopt, std::nullopt};
  facts.policy = PolicyFacts{6500, 1};
  EXPECT_EQ(
      Sentence(facts),
      "quickstart: collecting 412 of 600, done in 3:05; training stage 5/5 CTRL, step 6,589; step 6,500 on a policy "
      "server");
}

TEST(Sentence, TellsWhatHasEnded) {
  Facts facts;
  facts.collection = CollectionFacts{"quickstart", "finished", 600, 600, 2, std::nullopt};
  facts.training = TrainingFacts{"finished", "CTRL", 5, 5, 7204, std::nullopt, 600.0};
  facts.evaluation = EvaluationFacts{"finished", 0.988, 400, 400};
  EXPECT_EQ(Sentence(facts),
            "quickstart: collected 600, gave up 2; trained 10:00 to stage 5/5 CTRL; 98.8 % success of 400");
}

TEST(Sentence, NeverCallsSilenceAnEnd) {
  Facts facts;
  facts.collection = CollectionFacts{"q", "silent", 412, 1600, 0, 185.0};
  facts.training = TrainingFacts{"failed", "", 0, 0, 12, std::nullopt, std::nullopt};
  facts.evaluation = EvaluationFacts{"running", 0.5, 112, 400};
  EXPECT_EQ(Sentence(facts),
            "q: collection silent at 412 of 1,600; training failed at step 12; 112 of 400 rollouts, 50.0 % success");
}

TEST(Sentence, KnowsWhatAPolicyServerSays) {
  bus::PolicyStatus status;
  status.step = 6500;
  status.sessions = 1;
  EXPECT_EQ(Text(FactsOf(status)), "step 6,500 answers, not trained to drive yet");
  status.control_trained = true;
  EXPECT_EQ(Text(FactsOf(status)), "step 6,500 serves 1 session");
}

TEST(Sentence, SaysWhatACampaignWaitsFor) {
  bus::CampaignStatus status;
  status.committed = 412;
  status.total = 600;
  status.state = "paused";
  EXPECT_EQ(Text(FactsOf("q", status)), "paused at 412 of 600");
  status.given_up = 188;
  EXPECT_EQ(Text(FactsOf("q", status)), "collected 412 of 600, gave up 188");
}

TEST(Grouped, PutsACommaBetweenThousands) {
  const std::pair<std::uint64_t, const char*> cases[] = {{0, "0"},
                                                         {7, "7"},
                                                         {999, "999"},
                                                         {1000, "1,000"},
                                                         {12'345, "12,345"},
                                                         {1'000'000, "1,000,000"},
                                                         {UINT64_MAX, "18,446,744,073,709,551,615"}};
  for (const auto& [number, text] : cases) EXPECT_EQ(Grouped(number), text);
}

TEST(Sentence, HasOneServerOrSeveralAndNothingOfNone) {
  EXPECT_EQ(Text(PolicyFacts{}), "");
  EXPECT_EQ(Text(PolicyFacts{std::nullopt, 1}), "a policy server up");
  EXPECT_EQ(Text(PolicyFacts{std::nullopt, 3}), "3 policy servers up");
  EXPECT_EQ(Text(PolicyFacts{6500, 2}), "step 6,500 on 2 policy servers");
  EXPECT_EQ(Text(PolicyFacts{6500, 2, 0}), "step 6,500 serves 0 sessions");
  EXPECT_EQ(Text(PolicyFacts{0, 1, 5, false}), "step 0 answers, not trained to drive yet");
}

TEST(Sentence, OfARunHasAStageWhereThereAreStages) {
  TrainingFacts facts{"running", "CTRL", 0, 0, 12, 65.0, std::nullopt};
  EXPECT_EQ(Text(facts), "training step 12, done in 1:05");
  facts.stage = 2, facts.stages = 3;
  EXPECT_EQ(Text(facts), "training stage 2/3 CTRL, step 12, done in 1:05");
  facts.state = "stopped";
  EXPECT_EQ(Text(facts), "training stopped at stage 2/3 CTRL, step 12");
  facts.state = "finished";
  EXPECT_EQ(Text(facts), "trained to stage 2/3 CTRL");
}

TEST(Sentence, OfARunningCollectionHasItsEndWhereItIsKnown) {
  CollectionFacts facts{"q", "running", 0, 600, 0, std::nullopt};
  EXPECT_EQ(Text(facts), "collecting 0 of 600");
  facts.eta_s = 3725.0;
  EXPECT_EQ(Text(facts), "collecting 0 of 600, done in 1:02:05");
  facts = {"q", "finished", 590, 600, 10, std::nullopt};
  EXPECT_EQ(Text(facts), "collected 590 of 600, gave up 10");
  facts.state = "draining";
  EXPECT_EQ(Text(facts), "draining at 590 of 600");
}

TEST(Sentence, OfAnEvaluationWithoutARolloutSaysNothingOfItsShare) {
  EXPECT_EQ(Text(EvaluationFacts{"running", 0, 0, 400}), "evaluating");
  EXPECT_EQ(Text(EvaluationFacts{"stopped", 0, 0, 400}), "");
}

TEST(Sentence, SaysWhereItLookedInVain) {
  Facts facts;
  facts.looked_in = "/data and on domain 0";
  EXPECT_EQ(Sentence(facts), "nothing found in /data and on domain 0");
}

}  // namespace sentence_test
}  // namespace etude::monitor
