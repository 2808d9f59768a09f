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

TEST(Sentence, SaysWhereItLookedInVain) {
  Facts facts;
  facts.looked_in = "/data and on domain 0";
  EXPECT_EQ(Sentence(facts), "nothing found in /data and on domain 0");
}

}  // namespace sentence_test
}  // namespace etude::monitor
