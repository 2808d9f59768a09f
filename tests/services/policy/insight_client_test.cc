// SPDX-License-Identifier: Apache-2.0
// Tests services/policy/insight_client.cc against a policy server by hand, over real DDS.
#include "services/policy/insight_client.h"

#include <gtest/gtest.h>

#include <atomic>
#include <memory>
#include <mutex>
#include <thread>

#include "services/bus/topic.h"
#include "services/core/clock.h"
#include "tests/services/policy/policy_asker.h"
#include "tests/support/matchers.h"
#include "tests/support/wait_until.h"

namespace etude::policy {
namespace insight_client_test {

using namespace std::chrono_literals;

constexpr char kId[] = "cccc000000000003";

enum class Manner { kShows, kShowsTheTryBefore, kRefuses, kIsSilent };

// Shows each observation for whose session a wish stands.
class FakeServer {
 public:
  FakeServer(const bus::Participant& participant, const std::string& name)
      : presence_(AnnounceServer(participant, name, kId)),
        wishes_(bus::Reader<bus::InsightWish>::Open(participant, bus::Owner{name, kId}.partition()).value()),
        observations_(bus::Reader<bus::Observation>::Open(participant, bus::Owner{name, kId}.partition()).value()),
        insights_(bus::Writer<bus::Insight>::Open(participant, bus::Owner{name, kId}.partition()).value()),
        thread_([this](const std::stop_token& stop) {
          while (!stop.stop_requested()) {
            observations_.Wait(5ms);
            const auto observations = observations_.Take();
            TakeWishes();
            for (const auto& observation : observations) Look(observation);
          }
        }) {}
  ~FakeServer() {
    thread_.request_stop();
    thread_.join();
  }
  bus::InsightWish wish() const {
    const std::lock_guard lock(mutex_);
    return wish_;
  }
  bus::Observation last() const {
    const std::lock_guard lock(mutex_);
    return last_;
  }

  std::atomic<Manner> manner{Manner::kShows};
  std::atomic<int> asked{0}, deaf{0};  // deaf: to so many observations more

 private:
  void TakeWishes() {
    for (const auto& wish : wishes_.Take()) {
      const std::lock_guard lock(mutex_);
      wish_ = wish;
    }
  }
  void Look(const bus::Observation& observation) {
    ++asked;
    {
      const std::lock_guard lock(mutex_);
      last_ = observation;
      if (wish_.session != observation.session || wish_.seconds == 0) return;
    }
    if (deaf > 0) {
      --deaf;
      return;
    }
    if (manner == Manner::kIsSilent) return;
    bus::Insight insight;
    insight.viewer = wish().viewer;
    insight.run_id = observation.run_id;
    insight.session = observation.session;
    insight.request_id = observation.request_id - (manner == Manner::kShowsTheTryBefore ? 1 : 0);
    insight.checkpoint_step = 7;
    insight.modules_json = R"({"LANG": {"value": "coke"}})";
    insight.attention_json = "{}";
    if (manner == Manner::kRefuses) insight.error = "it does not fit";
    EXPECT_TRUE(insights_.Write(insight));
  }

  bus::Announcement presence_;
  bus::Reader<bus::InsightWish> wishes_;
  bus::Reader<bus::Observation> observations_;
  bus::Writer<bus::Insight> insights_;
  mutable std::mutex mutex_;
  bus::InsightWish wish_;
  bus::Observation last_;
  std::jthread thread_;
};

class PolicyInsight : public PolicyAsker {
 protected:
  InsightClient OpenClient(const std::string& run, std::chrono::milliseconds patience = 20s) {
    return InsightClient::Open(participant_, run, {.server = 20s, .again = 50ms, .patience = patience}).value();
  }
};

TEST_F(PolicyInsight, IsOfItsOwnQuestionAndItsOwnSessionAlone) {
  FakeServer server(participant_, "look-own");
  auto client = OpenClient(std::string("look-own@") + kId);
  const auto insight = client.Ask(MakeQuestion());
  ASSERT_THAT(insight, IsOk());
  EXPECT_EQ(insight->checkpoint_step, 7u);
  EXPECT_EQ(insight->modules["LANG"]["value"], "coke");

  const bus::Observation asked = server.last();
  EXPECT_EQ(asked.instruction, "pick up the red can");
  EXPECT_EQ(asked.joints, (std::vector<float>{0.1f, 0.2f}));
  EXPECT_EQ(asked.image, picture_);
  EXPECT_EQ(asked.run_id, kId);
  const bus::InsightWish wish = server.wish();
  EXPECT_EQ(wish.run_id, kId);
  EXPECT_EQ(wish.session, asked.session);
  EXPECT_NE(wish.session, "") << "nobody else's observations are looked into";
  EXPECT_EQ(wish.what_if_json, "");
}

// it went on asking the one before, which nobody is any more
TEST_F(PolicyInsight, AServerThatWasStartedAgainIsAsked) {
  auto server = std::make_unique<FakeServer>(participant_, "look-again");
  auto client = OpenClient("look-again");
  ASSERT_THAT(client.Ask(MakeQuestion()), IsOk());
  const std::string first = server->last().server;
  EXPECT_NE(first, "");
  server.reset();
  server = std::make_unique<FakeServer>(participant_, "look-again");
  ASSERT_THAT(client.Ask(MakeQuestion()), IsOk());
  EXPECT_NE(server->last().server, first);
}

TEST_F(PolicyInsight, AsksAgainUntilItComes) {
  FakeServer server(participant_, "look-again");
  server.deaf = 3;
  auto client = OpenClient("look-again");
  ASSERT_THAT(client.Ask(MakeQuestion()), IsOk());
  EXPECT_GE(server.asked, 4);
}

TEST_F(PolicyInsight, ALateOneCounts) {
  FakeServer server(participant_, "look-late");
  server.manner = Manner::kShowsTheTryBefore;
  auto client = OpenClient("look-late");
  // the first try's insight comes after the second try
  ASSERT_THAT(client.Ask(MakeQuestion()), IsOk());
  EXPECT_GE(server.asked, 2);
  // but none of the question before
  server.manner = Manner::kShows;
  ASSERT_THAT(client.Ask(MakeQuestion("push the milk")), IsOk());
  EXPECT_EQ(server.last().instruction, "push the milk");
}

TEST_F(PolicyInsight, WaitsItsTurn) {
  FakeServer server(participant_, "look-turn");
  auto client = OpenClient("look-turn");
  ASSERT_THAT(client.Ask(MakeQuestion()), IsOk());
  const Stopwatch watch;
  for (int i = 0; i < 4; ++i) ASSERT_THAT(client.Ask(MakeQuestion()), IsOk());
  // one turn less than there are: the first begins before the watch does
  EXPECT_GE(watch.Seconds(), 3.0 / bus::kInsightsPerSecond);
}

TEST_F(PolicyInsight, ASilentServerIsWaitedForOnce) {
  FakeServer server(participant_, "look-silent");
  server.manner = Manner::kIsSilent;
  auto client = OpenClient("look-silent", 400ms);
  const auto none = client.Ask(MakeQuestion());
  ASSERT_THAT(none, HasCode(Code::kUnavailable));
  EXPECT_THAT(none, MessageHas("no insight within 0.4 s"));
  server.manner = Manner::kShows;
  const auto still = client.Ask(MakeQuestion());
  ASSERT_THAT(still, HasCode(Code::kUnavailable));
  EXPECT_EQ(still.error().message, none.error().message);
}

TEST_F(PolicyInsight, ARefusalIsOfOneQuestion) {
  FakeServer server(participant_, "look-refusal");
  server.manner = Manner::kRefuses;
  auto client = OpenClient("look-refusal");
  const auto refused = client.Ask(MakeQuestion());
  ASSERT_THAT(refused, HasCode(Code::kInvalidArgument));
  EXPECT_EQ(refused.error().message, "it does not fit");
  server.manner = Manner::kShows;
  EXPECT_THAT(client.Ask(MakeQuestion()), IsOk());
}

TEST_F(PolicyInsight, TakesItsWishBack) {
  FakeServer server(participant_, "look-end");
  {
    auto client = OpenClient("look-end");
    ASSERT_THAT(client.Ask(MakeQuestion()), IsOk());
    EXPECT_GT(server.wish().seconds, 0u);
  }
  EXPECT_TRUE(WaitUntil([&] { return server.wish().seconds == 0; }));
}

TEST_F(PolicyInsight, SaysThatNobodyServesTheRun) {
  auto client = InsightClient::Open(participant_, "look-nobody", {.server = 200ms}).value();
  const auto none = client.Ask(MakeQuestion());
  ASSERT_THAT(none, HasCode(Code::kUnavailable));
  EXPECT_THAT(none, MessageHas("look-nobody"));
  EXPECT_FALSE(InsightClient::Open(participant_, "Two Words"));
}

}  // namespace insight_client_test
}  // namespace etude::policy
