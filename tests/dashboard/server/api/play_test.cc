// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/api/play.cc with a session and a policy server on the bus: what the policy sees in it, and
// which words its training never said.
#include "dashboard/server/api/play.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <functional>
#include <future>
#include <optional>
#include <utility>

#include "dashboard/server/live/play_watch.h"
#include "services/bus/directory.h"
#include "services/bus/topic.h"
#include "tests/dashboard/server/api/api_fixture.h"
#include "tests/dashboard/server/api/json_schema.h"
#include "tests/support/matchers.h"
#include "tests/support/write_program.h"

namespace etude::api {
namespace play_test {

using namespace std::chrono_literals;
using testing::IsEmpty;

constexpr std::uint32_t kDomain = 83;
constexpr char kRun[] = "example";

class PlayApiTest : public ApiFixture {
 protected:
  PlayApiTest()
      : id_(sources_.Run("lab.run").value()->View().value()->identity),
        presence_(bus::Announcement::Open(participant_, bus::MakePresence(bus::PresenceKind::kPolicy, kRun, id_, ""),
                                          Claim::kAdopt)
                      .value()),
        states_(bus::Writer<bus::PlayState>::Open(participant_, bus::kPlayPartition).value()),
        wishes_(bus::Reader<bus::InsightWish>::Open(participant_, bus::Owner{kRun, id_}.partition()).value()),
        insights_(bus::Writer<bus::Insight>::Open(participant_, bus::Owner{kRun, id_}.partition()).value()) {
    context_.play = &watch_;
    state_.session = "one";
    state_.run = kRun;
    state_.phase = "moving";
    state_.scene_json = R"({"tasks": ["pick", "push"], "campaign_objects": ["coke", "milk"],
                            "objects": [{"name": "coke", "hidden": false}, {"name": "milk", "hidden": false}]})";
  }
  ~PlayApiTest() override { context_.play = nullptr; }

  // Says the state, as a session does, until `done`.
  bool Until(const std::function<bool()>& done) {
    const auto deadline = MonotonicClock::now() + 30s;
    while (MonotonicClock::now() < deadline) {
      EXPECT_TRUE(states_.Write(state_));
      if (done()) return true;
      wishes_.Wait(5ms);  // not faster than a session talks
    }
    return false;
  }
  bool IsThere() {
    return Until([this] { return Get(kPrefix + "/play/sessions/one").status == 200; });
  }
  void Serve() {
    live::LiveModel model;
    bus::PolicyStatus server;
    server.server = "s", server.run = kRun, server.run_id = id_, server.step = 200;
    model.On(server, MonotonicClock::now());
    live_ = std::make_shared<const live::LiveView>(model.view());
  }
  // What a server shows to whom it is asked by: one head that looks at the second of two by two patches alone.
  void Show(const bus::InsightWish& wish) {
    bus::Insight insight;
    insight.run_id = id_;
    insight.viewer = wish.viewer;
    insight.session = wish.session;
    insight.checkpoint_step = 200;
    insight.modules_json = R"({"TAR2D": {"entity": "target", "quantity": "pixel", "value": [3, 1]}})";
    insight.attention_json = R"({"TAR2D": {"offset": 0, "heads": 1, "image": [2, 2], "keys": [], "scale": [0.5]}})";
    insight.attention = {0, 255, 0, 0};
    insight.view = {10, 20, 64, 48};
    ASSERT_TRUE(insights_.Write(insight));
  }
  OrderedJson Insight() { return GetJson(kPrefix + "/play/sessions/one/insight"); }

  const std::string id_;
  bus::Participant participant_ = bus::Participant::Open({kDomain, ""}).value();
  bus::Announcement presence_;
  bus::Writer<bus::PlayState> states_;
  bus::Reader<bus::InsightWish> wishes_;
  bus::Writer<bus::Insight> insights_;
  bus::PlayState state_;
  live::PlayWatch watch_{bus::Arguments{.domain = kDomain}};
};

TEST_F(PlayApiTest, ShowsWhatThePolicySeesWhileSomebodyAsks) {
  ASSERT_TRUE(IsThere());
  EXPECT_THAT(wishes_.Take(), IsEmpty()) << "a session that is only looked at costs its policy nothing";
  std::optional<bus::InsightWish> wish;
  ASSERT_TRUE(Until([&] {
    (void)Insight();
    for (auto& one : wishes_.Take()) wish = std::move(one);
    return wish.has_value();
  }));
  EXPECT_EQ(wish->session, "play-one") << "as its observations are called";
  Show(*wish);
  OrderedJson shown;
  ASSERT_TRUE(Until([&] { return (shown = Insight())["number"] == 1; }));
  const auto document = OrderedJson::parse(dashboard::OpenApiText());
  std::vector<std::string> problems;
  CheckSchema(document, document["components"]["schemas"]["PlayInsight"], shown, "", problems);
  EXPECT_THAT(problems, IsEmpty());
  EXPECT_EQ(shown["attention"]["TAR2D"]["weights"], (std::vector<double>{0, 0.5, 0, 0}));
  EXPECT_FALSE(shown["attention"]["TAR2D"].contains("heads")) << "too much for several times a second";
  const auto each = GetJson(kPrefix + "/play/sessions/one/insight?heads=each");
  EXPECT_EQ(each["attention"]["TAR2D"]["heads"][0]["weights"], (std::vector<double>{0, 0.5, 0, 0}));
  EXPECT_EQ(Get(kPrefix + "/play/sessions/one/insight?heads=two").status, 400);
  EXPECT_EQ(shown["view"]["width"], 64);
  EXPECT_EQ(shown["checkpoint_step"], 200);
}

TEST_F(PlayApiTest, AWordIsSeenWhereTheTrainingOfThePolicySaidIt) {
  ASSERT_TRUE(IsThere());
  const std::string address = kPrefix + "/play/sessions/one/meaning?sentence=push%20the%20coke";
  const auto alone = GetJson(address);
  EXPECT_EQ(alone["words_of"], "campaign") << "nobody is known to serve it";
  EXPECT_EQ(alone["words"][0]["seen"], true);
  WriteExampleRun(lab_.root() / "another");  // which comes first by name
  std::filesystem::remove(lab_.root() / "another" / "identity.json");
  ASSERT_TRUE(Until([this] { return sources_.catalog().Find(sources::Kind::kRun, "lab.another").has_value(); }));
  Serve();
  const auto trained = GetJson(address);
  EXPECT_EQ(trained["words_of"], "training");
  EXPECT_EQ(trained["words"][0], (OrderedJson{{"text", "push"}, {"seen", false}}));
  EXPECT_EQ(trained["words"][2], (OrderedJson{{"text", "coke"}, {"seen", true}}));
  EXPECT_EQ(trained["task"], "push") << "what it means does not depend on the training";
  EXPECT_TRUE(later_.empty()) << "no other run was opened, and none is hashed";
}

// before, all commands waited in one queue: a session that hung kept the Stop of every other one for eight seconds
TEST_F(PlayApiTest, ASessionThatDoesNotAnswerKeepsNobodyElsesCommands) {
  auto commands = bus::Reader<bus::PlayCommand>::Open(participant_, bus::kPlayPartition).value();
  bus::PlayState other = state_;
  other.session = "two";
  const auto both = [&](const std::function<bool()>& done) {
    return Until([&] {
      EXPECT_TRUE(states_.Write(other));
      return done();
    });
  };
  ASSERT_TRUE(both([&] { return watch_.Sessions().value().size() == 2; }));
  const auto stop = [&](const char* session) {
    return std::async(std::launch::async,
                      [&, session] { return watch_.Command(session, bus::PlayAction::kStop, OrderedJson::object()); });
  };
  const auto heard = [&](const std::string& session) {
    for (const auto& command : commands.Take())
      (command.session == "one" ? state_ : other).command_id = command.session == session ? command.command_id : "";
    return !(session == "one" ? state_ : other).command_id.empty();
  };
  auto silent = stop("one");
  std::string asked;  // of the one that does not answer
  ASSERT_TRUE(both([&] {
    if (!heard("one")) return false;
    asked = std::exchange(state_.command_id, "");
    return true;
  }));
  auto answered = stop("two");
  ASSERT_TRUE(both([&] {
    (void)heard("two");
    return answered.wait_for(0s) == std::future_status::ready;
  }));
  EXPECT_THAT(answered.get(), IsOk());
  EXPECT_EQ(silent.wait_for(0s), std::future_status::timeout);
  // before, it waited behind the first one, and then as long itself: longer than a request may take
  auto behind = stop("one");
  ASSERT_TRUE(both([&] { return behind.wait_for(0s) == std::future_status::ready; }));
  EXPECT_THAT(behind.get(), MessageHas("has not answered the command before this one yet"));
  state_.command_id = asked;
  ASSERT_TRUE(both([&] { return silent.wait_for(0s) == std::future_status::ready; }));
  EXPECT_THAT(silent.get(), IsOk());
}

TEST_F(PlayApiTest, AnIndexOfAWrongKindIsRefusedByName) {
  http::Request request;
  request.method = "POST";
  request.content_type = "application/json";
  for (const char* index : {"-1", "\"3\"", "0.5"}) {
    request.body = fmt::format(R"({{"spec": "quickstart", "run": "example", "index": {}, "dry_run": true}})", index);
    const auto answer = Ask(request, kPrefix + "/play/sessions");
    EXPECT_EQ(answer.status, 400) << index;
    EXPECT_THAT(answer.body, testing::HasSubstr("index: a whole number")) << "before, it was 0";
  }
}

// before, whatever had ended the worker, it was the request that was wrong
TEST(RenderScene, SaysWhetherTheRequestTheMachineOrTheWorkerIsWrong) {
  const TemporaryFolder folder;
  const auto ends = [&](const char* how) {
    const Path worker = WriteProgram(folder / "etude-worker", fmt::format("#!/bin/sh\necho in its words\n{}\n", how));
    return RenderScene(worker, {.spec = "a.yaml"}, folder / "scene.png");
  };
  EXPECT_THAT(ends("exit 0"), IsOk());
  EXPECT_THAT(ends("exit 2"), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(ends("exit 3"), HasCode(Code::kUnavailable));
  EXPECT_THAT(ends("exit 1"), HasCode(Code::kInternal));
  EXPECT_THAT(ends("kill -KILL $$"), HasCode(Code::kInternal));
  EXPECT_THAT(ends("exit 3"), MessageHas("in its words"));
}

}  // namespace play_test
}  // namespace etude::api
