// SPDX-License-Identifier: Apache-2.0
// Tests trainer/serve/insight.cc and inspect.cc
#include "trainer/serve/insight.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "services/bus/owner.h"
#include "services/episode/bounded_json.h"
#include "tests/trainer/policy/fixtures.h"
#include "tests/trainer/serve/example_observation.h"

namespace etude::serve {
namespace insight_test {

using namespace std::chrono_literals;
using ::testing::HasSubstr;
constexpr std::uint32_t kInsightDomain = 78;
constexpr char kInsightRun[] = "aaaa000000000007";

std::shared_ptr<const Model> ExampleModel() {
  const auto bytes = checkpoint::Encode(checkpoint::ExampleCheckpoint(policy::TinyConfig())).value();
  return Model::FromBytes(bytes).value();
}

TEST(Inspect, SaysWhatTheAnswerSaysAndWhereEveryHeadLooks) {
  const auto model = ExampleModel();
  const auto observation = ExampleObservation(4);
  const auto insight = model->Inspect(observation, "");

  ASSERT_EQ(insight.error, "");
  EXPECT_EQ(insight.modules_json, model->Answer(observation).modules_json) << "bit for bit what the robot is told";
  EXPECT_EQ(insight.what_if_json, "");
  EXPECT_EQ(insight.picture.size(), 24u * 16 * 3);
  EXPECT_EQ(insight.view, (std::vector<std::uint32_t>{10, 20, 24, 16})) << "where the picture lies in the camera's";
  EXPECT_EQ(insight.waypoints, model->Answer(observation).waypoints);
  const auto layout = ParseBoundedJson(insight.attention_json);
  ASSERT_TRUE(layout);
  const auto& place = (*layout)["TAR2D"];
  const std::size_t tokens = place["image"][0].get<std::size_t>() * place["image"][1].get<std::size_t>();
  EXPECT_EQ(place["keys"], (OrderedJson{"self"}));
  for (std::size_t h = 0; h < 2; ++h) {
    const double scale = place["scale"][h].get<double>() / 255;
    double sum = 0;
    for (std::size_t k = 0; k <= tokens; ++k)
      sum += scale * insight.attention.at(place["offset"].get<std::size_t>() + h * (tokens + 1) + k);
    EXPECT_NEAR(sum, 1, 0.05) << h;
  }
}

TEST(Inspect, AnswersWhatWouldBe) {
  const auto model = ExampleModel();
  const auto observation = ExampleObservation(4);
  const auto insight = model->Inspect(observation, R"({"say": {"TAR3D": {"position": [0.5, 0.25, 0.125]}}})");

  ASSERT_EQ(insight.error, "");
  EXPECT_EQ(insight.modules_json, model->Answer(observation).modules_json);
  const auto changed = ParseBoundedJson(insight.what_if_json).value();
  EXPECT_EQ(changed["TAR3D"]["value"], (OrderedJson{0.5, 0.25, 0.125}));
  EXPECT_NE(changed["DISP"]["value"], ParseBoundedJson(insight.modules_json).value()["DISP"]["value"]);
  EXPECT_EQ(insight.what_if_waypoints.size(), insight.waypoints.size());
  EXPECT_NE(insight.what_if_waypoints, insight.waypoints);
  EXPECT_THAT(model->Inspect(observation, "{").error, HasSubstr("what if"));
  auto odd = observation;
  odd.joints.clear();
  EXPECT_THAT(model->Inspect(odd, "").error, HasSubstr("joints"));
}

TEST(Inspect, AnswersWhatAModuleThatThinksOtherwiseLeadsTo) {
  const auto model = ExampleModel();
  const auto observation = ExampleObservation(4);
  const auto insight = model->Inspect(observation, R"({"think": {"LANG": "push the blue box"}})");
  ASSERT_EQ(insight.error, "");
  const auto plain = ParseBoundedJson(insight.modules_json), changed = ParseBoundedJson(insight.what_if_json);
  ASSERT_TRUE(plain && changed);
  EXPECT_NE((*changed)["LANG"], (*plain)["LANG"]);
  EXPECT_NE(insight.what_if_waypoints, insight.waypoints);
}

TEST(Inspect, SaysWhatWordsAndJointsAreWorthWhenAsked) {
  const auto model = ExampleModel();
  auto observation = ExampleObservation(4);
  observation.instruction = "push the red box";
  EXPECT_EQ(model->Inspect(observation, "").worth_json, "");
  const auto insight = model->Inspect(observation, R"({"worth": true})");
  ASSERT_EQ(insight.error, "");
  EXPECT_EQ(insight.what_if_json, "") << "nothing is answered otherwise";
  EXPECT_EQ(insight.modules_json, model->Answer(observation).modules_json);
  const auto worth = ParseBoundedJson(insight.worth_json).value();
  ASSERT_EQ(worth["words"].size(), 4u);
  EXPECT_EQ(worth["words"][2]["word"], "red");
  ASSERT_EQ(worth["joints"].size(), observation.joints.size());
  double moves = 0;
  for (const auto& word : worth["words"]) moves += word["moves"].get<double>();
  EXPECT_GT(moves, 0);

  const auto other = model->Inspect(observation, R"({"worth": true, "sentence": "raise it"})");
  EXPECT_EQ(other.worth_json, insight.worth_json) << "of what was observed";
  EXPECT_NE(other.what_if_json, "");
}

class Desk : public ::testing::Test {
 protected:
  Desk()
      : participant_(bus::Participant::Open({kInsightDomain, ""}).value()),
        partition_(bus::Owner{"demo", kInsightRun}.partition()),
        desk_(InsightDesk::Open(participant_, partition_, kInsightRun).value()),
        wishes_(bus::Writer<bus::InsightWish>::Open(participant_, partition_).value()),
        insights_(bus::Reader<bus::Insight>::Open(participant_, partition_).value()) {
    EXPECT_TRUE(wishes_.WaitForReaders(1, 20s));
  }
  void Wish(const std::string& session, std::uint32_t seconds, const std::string& run_id = kInsightRun,
            const std::string& viewer = "viewer") {
    bus::InsightWish wish;
    wish.run = "demo";
    wish.run_id = run_id;
    wish.viewer = viewer;
    wish.session = session;
    wish.seconds = seconds;
    ASSERT_TRUE(wishes_.Write(wish));
  }
  // offers until something is shown, or it has been tried long enough
  std::optional<bus::Insight> Offer(const bus::Observation& observation, std::chrono::milliseconds patience) {
    const auto deadline = MonotonicClock::now() + patience;
    while (MonotonicClock::now() < deadline) {
      desk_->Offer(observation, model_);
      insights_.Wait(20ms);
      auto taken = insights_.Take();
      if (!taken.empty()) return std::move(taken.back());
    }
    return std::nullopt;
  }

  bus::Participant participant_;
  std::string partition_;
  std::unique_ptr<InsightDesk> desk_;
  bus::Writer<bus::InsightWish> wishes_;
  bus::Reader<bus::Insight> insights_;
  std::shared_ptr<const Model> model_ = ExampleModel();
};

TEST_F(Desk, ShowsWhoWishesWhatIsWishedAndNobodyElse) {
  const auto observation = ExampleObservation(4, "demo", kInsightRun),
             other = ExampleObservation(5, "demo", kInsightRun);
  Wish(observation.session, 30);
  const auto insight = Offer(observation, 20s);
  ASSERT_TRUE(insight);
  EXPECT_EQ(insight->viewer, "viewer");
  EXPECT_EQ(insight->request_id, observation.request_id);
  EXPECT_EQ(insight->modules_json, model_->Inspect(observation, "").modules_json);
  EXPECT_FALSE(Offer(other, 300ms)) << "another session's";

  Wish(observation.session, 0);
  const auto deadline = MonotonicClock::now() + 20s;
  while (Offer(observation, 300ms) && MonotonicClock::now() < deadline) {
  }
  const auto shown = desk_->shown();
  EXPECT_FALSE(Offer(observation, 300ms)) << "the wish is over";
  EXPECT_EQ(desk_->shown(), shown);
}

TEST_F(Desk, DoesNothingForAnotherRunsWish) {
  Wish("", 30, "bbbb000000000000");
  const auto observation = ExampleObservation(4, "demo", kInsightRun),
             other = ExampleObservation(5, "demo", kInsightRun);
  EXPECT_FALSE(Offer(observation, 500ms));
  EXPECT_EQ(desk_->shown(), 0u);
  // wishes come in the order in which they were written: the other run's has been seen when this one has
  Wish(other.session, 30, kInsightRun, "another");
  ASSERT_TRUE(Offer(other, 20s));
  const auto shown = Offer(observation, 300ms);  // one of before may still arrive
  EXPECT_TRUE(!shown || shown->request_id == other.request_id);
}

// before, sessions shared a viewer's turns, and mostly the first by name had them
TEST_F(Desk, ShowsEverySessionOfAWishForAll) {
  Wish("", 30);
  const auto first = ExampleObservation(4, "demo", kInsightRun), second = ExampleObservation(5, "demo", kInsightRun);
  ASSERT_TRUE(Offer(first, 20s));

  desk_->Offer(second, model_);  // once, while the first may not be shown again

  bool shown = false;
  for (const auto deadline = MonotonicClock::now() + 20s; !shown && MonotonicClock::now() < deadline;) {
    insights_.Wait(20ms);
    for (const auto& insight : insights_.Take()) shown = shown || insight.session == second.session;
  }
  EXPECT_TRUE(shown);
}

TEST_F(Desk, ShowsAtMostSoManyASecond) {
  Wish("", 60);
  const auto observation = ExampleObservation(4, "demo", kInsightRun);
  ASSERT_TRUE(Offer(observation, 20s));
  const Stopwatch watch;
  const auto before = desk_->shown();
  const auto offer = [&] {
    desk_->Offer(observation, model_);
    insights_.Wait(5ms);
    (void)insights_.Take();
  };
  while (watch.Seconds() < 1) offer();
  EXPECT_LE(desk_->shown() - before, InsightDesk::kPerSecond + 2);
  // and, however busy the machine is, more than one
  while (desk_->shown() - before < 2 && watch.Seconds() < 20) offer();
  EXPECT_GE(desk_->shown() - before, 2);
}

}  // namespace insight_test
}  // namespace etude::serve
