// SPDX-License-Identifier: Apache-2.0
// Tests trainer/serve with services/policy: the server that robots ask while somebody looks into it, over real DDS.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "services/bus/owner.h"
#include "services/bus/topic.h"
#include "services/core/clock.h"
#include "services/policy/client.h"
#include "services/policy/insight_client.h"
#include "tests/support/matchers.h"
#include "tests/trainer/policy/fixtures.h"
#include "tests/trainer/serve/example_question.h"
#include "trainer/serve/server.h"

namespace etude::serve {
namespace looked_into_test {

using namespace std::chrono_literals;
using ::testing::Contains;
using ::testing::Key;
constexpr std::uint32_t kDomain = 78;
constexpr char kId[] = "dddd000000000004";
constexpr std::uint64_t kQuestions = 6;

// What a robot is told, number by number.
struct Told {
  std::vector<float> waypoints;
  std::string modules;
  bool operator==(const Told&) const = default;
};

std::vector<float> NumbersOf(const std::vector<Waypoint>& waypoints) {
  std::vector<float> numbers;
  for (const auto& waypoint : waypoints) {
    const auto row = ToVector(waypoint);
    numbers.insert(numbers.end(), row.begin(), row.end());
  }
  return numbers;
}

class LookedInto : public ::testing::Test {
 protected:
  LookedInto() : serving_([this] { EXPECT_TRUE(server_.Run()); }) {}
  ~LookedInto() override {
    server_.Stop();
    serving_.join();
  }

  static Told Ask(policy::Client& robot, std::uint64_t seed) {
    std::vector<std::uint8_t> picture;
    const auto answer = robot.Ask(ExampleQuestion(seed, picture));
    EXPECT_THAT(answer, IsOk());
    return answer ? Told{NumbersOf(answer->waypoints), answer->modules.dump()} : Told{};
  }
  static std::vector<Told> AskAll(policy::Client& robot) {
    std::vector<Told> all;
    for (std::uint64_t seed = 0; seed < kQuestions; ++seed) all.push_back(Ask(robot, seed));
    return all;
  }

  const Selector run_{"look", kId};
  bus::Participant participant_ = bus::Participant::Open({kDomain, ""}).value();
  std::shared_ptr<const Model> model_ =
      Model::FromBytes(checkpoint::Encode(checkpoint::ExampleCheckpoint(policy::TinyConfig())).value()).value();
  PolicyServer server_ = PolicyServer::Open(participant_, {.run = run_}, model_).value();
  std::thread serving_;
};

TEST_F(LookedInto, RobotsAreToldTheSameBitsAsWithoutAnybodyLooking) {
  auto robot = policy::Client::Open(participant_, run_.text(), "robot").value();
  const std::vector<Told> alone = AskAll(robot);
  EXPECT_NE(alone[0], alone[1]) << "other pictures, other answers";

  // somebody watches this robot, and somebody asks questions of his own
  auto wishes = bus::Writer<bus::InsightWish>::Open(participant_, bus::Owner{run_.name, kId}.partition()).value();
  auto insights = bus::Reader<bus::Insight>::Open(participant_, bus::Owner{run_.name, kId}.partition()).value();
  ASSERT_TRUE(wishes.WaitForReaders(1, 20s));
  bus::InsightWish wish;
  wish.run_id = kId;
  wish.viewer = "somebody";
  wish.session = "robot";
  wish.seconds = 30;
  ASSERT_TRUE(wishes.Write(wish));
  std::atomic<int> looks{0};
  std::jthread looking([&](const std::stop_token& stop) {
    auto client = policy::InsightClient::Open(participant_, run_.text()).value();
    std::vector<std::uint8_t> picture;
    for (std::uint64_t seed = 100; !stop.stop_requested(); ++seed)
      if (client.Ask(ExampleQuestion(seed, picture))) ++looks;
  });

  int watched = 0;
  const auto deadline = MonotonicClock::now() + 30s;
  while ((watched < 2 || looks < 2) && MonotonicClock::now() < deadline) {
    EXPECT_EQ(AskAll(robot), alone);
    for (const auto& insight : insights.Take()) watched += insight.viewer == "somebody" ? 1 : 0;
  }
  EXPECT_GE(watched, 2);
  EXPECT_GE(looks, 2);
}

// before, one question about a picture of another camera stood as the server's refusal until it ended
TEST_F(LookedInto, WhatWhoeverLooksIsRefusedIsNoRefusalOfARobot) {
  auto statuses = bus::Reader<bus::PolicyStatus>::Open(participant_, bus::Owner{run_.name, kId}.partition()).value();
  bus::PolicyStatus status;
  const auto until = [&](auto&& said) {
    for (const auto deadline = MonotonicClock::now() + 20s; !said() && MonotonicClock::now() < deadline;) {
      statuses.Wait(1s);
      for (auto& taken : statuses.Take()) status = std::move(taken);
    }
    return said();
  };
  std::vector<std::uint8_t> picture;
  policy::Question odd = ExampleQuestion(1, picture);
  odd.joints.clear();
  {
    auto client = policy::InsightClient::Open(participant_, run_.text()).value();
    EXPECT_THAT(client.Ask(odd), HasCode(Code::kInvalidArgument));
  }
  ASSERT_TRUE(until([&] { return status.refused > 0; }));
  EXPECT_EQ(status.last_refusal, "");

  auto robot = policy::Client::Open(participant_, run_.text(), "robot").value();
  EXPECT_FALSE(robot.Ask(odd));
  ASSERT_TRUE(until([&] { return !status.last_refusal.empty(); }));
  EXPECT_THAT(status.last_refusal, ::testing::StartsWith("observation: "));
}

TEST_F(LookedInto, WhatWordsAndJointsAreWorthIsAskedForByWish) {
  auto client = policy::InsightClient::Open(participant_, run_.text()).value();
  std::vector<std::uint8_t> picture;
  const policy::Question question = ExampleQuestion(1, picture);
  EXPECT_TRUE(client.Ask(question).value().joints.empty());
  const auto insight = client.Ask(question, R"({"worth": true})");
  ASSERT_THAT(insight, IsOk());
  EXPECT_EQ(insight->joints.size(), question.joints.size());
  EXPECT_FALSE(insight->words.empty());
}

TEST_F(LookedInto, AnInsightSaysWhatTheRobotIsTold) {
  auto robot = policy::Client::Open(participant_, run_.text(), "robot").value();
  auto client = policy::InsightClient::Open(participant_, run_.text()).value();
  for (std::uint64_t seed = 0; seed < 3; ++seed) {
    std::vector<std::uint8_t> picture;
    const auto insight = client.Ask(ExampleQuestion(seed, picture));
    ASSERT_THAT(insight, IsOk());
    const Told told = Ask(robot, seed);
    EXPECT_EQ(NumbersOf(insight->waypoints), told.waypoints) << seed;
    EXPECT_EQ(insight->modules.dump(), told.modules) << seed;
    EXPECT_EQ(insight->checkpoint_step, model_->metadata().step);
    EXPECT_EQ(insight->view, (policy::View{10, 20, 24, 16}));
    ASSERT_THAT(insight->attention, Contains(Key("TAR2D")));
    const auto& attention = insight->attention.at("TAR2D");
    EXPECT_EQ(attention.rows, 4);
    EXPECT_EQ(attention.columns, 6);
    EXPECT_EQ(attention.keys, std::vector<std::string>{"self"});
    EXPECT_EQ(attention.heads.size(), 2u);
    EXPECT_GT(attention.share(), 0);
    EXPECT_LE(attention.share(), 1.05) << "of 1, as bytes";
  }
}

}  // namespace looked_into_test
}  // namespace etude::serve
