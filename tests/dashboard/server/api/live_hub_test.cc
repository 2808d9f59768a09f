// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/api/live_hub.cc
#include "dashboard/server/api/live_hub.h"

#include <gmock/gmock.h>

#include <map>
#include <set>

#include "tests/dashboard/server/api/api_fixture.h"
#include "tests/dashboard/server/api/json_schema.h"

namespace etude::api {
namespace live_hub_test {

class FakeSocket : public http::Socket {
 public:
  void Send(const std::string& slot, std::string text) override {
    if (!stuck) sent.push_back(OrderedJson::parse(text));
    waiting = stuck ? slot : "";
  }
  bool Waits(const std::string& slot) const override { return waiting == slot; }
  int slowdown() const override { return 1; }
  std::size_t waiting_bytes() const override { return 0; }
  void Close() override {}

  std::vector<OrderedJson> sent;
  bool stuck = false;
  std::string waiting;
};

class LiveHubTest : public ApiFixture {
 protected:
  LiveHubTest() : client_(hub_.Connect({}, socket_)) {}
  void Tick() {
    hub_.Tick();
    RunLater();
  }
  LiveHub hub_{context_};
  std::shared_ptr<FakeSocket> socket_ = std::make_shared<FakeSocket>();
  std::shared_ptr<http::SocketClient> client_;
};

TEST_F(LiveHubTest, EveryChannelSendsWhatIsDescribed) {
  const auto document = OrderedJson::parse(dashboard::OpenApiText());
  const std::map<std::string, std::string> arguments{{"home", "{}"},
                                                     {"fleet", R"({"limit":10})"},
                                                     {"attempts", R"({"campaign":"lab.data"})"},
                                                     {"train", R"({"run":"lab.run","since":50})"},
                                                     {"eval", R"({"id":"lab.eval_a"})"},
                                                     {"logs", R"({"level":"warn"})"},
                                                     {"events", R"({"level":"warn"})"},
                                                     {"topics", "{}"},
                                                     {"sample", R"({"topic":"etude/process/status"})"},
                                                     {"play", R"({"session":"play-1"})"}};
  const std::set<std::string> of_the_bus{"sample", "play"};  // there is none here
  for (const auto& [channel, about] : document["x-live"]["channels"].items()) {
    ASSERT_TRUE(arguments.contains(channel)) << channel;
    client_->OnText(R"({"op":"sub","ch":")" + channel + R"(","args":)" + arguments.at(channel) + "}");
  }
  Tick();
  ASSERT_EQ(socket_->sent.size(), arguments.size());
  for (const auto& message : socket_->sent) {
    const std::string channel = message["ch"];
    if (of_the_bus.contains(channel)) {
      EXPECT_TRUE(message.contains("error")) << message.dump();
      continue;
    }
    ASSERT_TRUE(message.contains("data")) << message.dump();
    std::vector<std::string> problems;
    CheckSchema(document, document["x-live"]["server"], message, channel, problems);
    CheckSchema(document, document["x-live"]["channels"][channel]["data"], message["data"], channel, problems);
    EXPECT_THAT(problems, testing::IsEmpty());
  }
}

TEST_F(LiveHubTest, NothingIsComputedForABrowserThatTakesNothing) {
  socket_->stuck = true;
  client_->OnText(R"({"op":"sub","ch":"home"})");
  Tick();
  EXPECT_EQ(socket_->waiting, "home");
  hub_.Tick();
  EXPECT_TRUE(later_.empty()) << "what was sent before has not gone out";
}

TEST_F(LiveHubTest, RatesAreTheChannels) {
  client_->OnText(R"({"op":"sub","ch":"home","hz":1000})");
  Tick();
  Tick();
  EXPECT_EQ(socket_->sent.size(), 1u) << "twice a second at most";
}

TEST_F(LiveHubTest, AskedForAgainItIsNotDueAnySooner) {
  for (int i = 0; i < 5; ++i) {
    client_->OnText(R"({"op":"sub","ch":"home"})");
    Tick();
  }
  EXPECT_EQ(socket_->sent.size(), 1u);
  client_->OnText(R"({"op":"sub","ch":"events"})");
  hub_.Tick();
  client_->OnText(R"({"op":"sub","ch":"events","args":{"level":"warn"}})");
  hub_.Tick();
  EXPECT_EQ(later_.size(), 1u) << "one at a time, whatever is asked for meanwhile";
}

TEST_F(LiveHubTest, WhatIsThrownIsAnErrorAndTheNextOneComes) {
  context_.live = []() -> std::shared_ptr<const live::LiveView> { throw std::runtime_error("a bug"); };
  client_->OnText(R"({"op":"sub","ch":"home"})");
  Tick();
  ASSERT_EQ(socket_->sent.size(), 1u);
  EXPECT_EQ(socket_->sent[0]["error"], "a bug");
}

TEST_F(LiveHubTest, UnsubscribedAndUnknownChannelsAreSilent) {
  client_->OnText(R"({"op":"sub","ch":"home","id":"mine"})");
  client_->OnText(R"({"op":"unsub","id":"mine"})");
  client_->OnText(R"({"op":"sub","ch":"moon"})");
  client_->OnText("nonsense");
  Tick();
  for (const auto& message : socket_->sent) EXPECT_TRUE(message.contains("error")) << message.dump();
  EXPECT_EQ(socket_->sent.size(), 2u);
}

TEST_F(LiveHubTest, SubscriptionsHaveABound) {
  for (int i = 0; i < 20; ++i)
    client_->OnText(R"({"op":"sub","ch":"train","id":"s)" + std::to_string(i) + R"(","args":{"run":"lab.run"}})");
  EXPECT_EQ(socket_->sent.size(), 4u) << "refusals";
  Tick();
  EXPECT_EQ(socket_->sent.size(), 20u);
}

TEST_F(LiveHubTest, WhatIsKeptForOthersIsBoundedByBytes) {
  client_->OnText(R"({"op":"sub","ch":"home"})");
  Tick();
  const std::size_t one = hub_.kept_bytes();
  ASSERT_GT(one, 1000u);
  const std::size_t room = one + one / 2;
  LiveHub small(context_, room), none(context_, 100);
  for (LiveHub* hub : {&small, &none}) {
    const auto socket = std::make_shared<FakeSocket>();
    const auto client = hub->Connect({}, socket);
    for (int i = 0; i < 10; ++i)
      client->OnText(R"({"op":"sub","ch":"home","id":"h)" + std::to_string(i) + R"(","args":{"n":)" +
                     std::to_string(i) + "}}");
    hub->Tick();
    RunLater();
    EXPECT_EQ(socket->sent.size(), 10u) << "everybody gets what is due";
    EXPECT_LE(hub->kept_bytes(), hub == &small ? room : 100u);
  }
  EXPECT_GT(small.kept_bytes(), 0u);
}

TEST_F(LiveHubTest, ABrowserThatLeftIsForgotten) {
  EXPECT_EQ(hub_.clients(), 1u);
  client_.reset();
  EXPECT_EQ(hub_.clients(), 0u);
}

}  // namespace live_hub_test
}  // namespace etude::api
