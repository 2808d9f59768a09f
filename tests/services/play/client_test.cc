// SPDX-License-Identifier: Apache-2.0
// Tests services/play/client.cc against a session by hand, over real DDS: commands are answered once, however often
// they are said.
#include "services/play/client.h"

#include <gtest/gtest.h>

#include <set>
#include <thread>

#include "services/bus/topic.h"
#include "services/play/arguments.h"

namespace etude::play {
namespace client_test {

using namespace std::chrono_literals;

constexpr std::uint32_t kDomain = 65;

bus::Participant Open() { return bus::Participant::Open({kDomain, ""}).value(); }

// A session that refuses to nudge, and does not hear the first commands.
class FakeSession {
 public:
  FakeSession(const bus::Participant& participant, std::string name, int deaf)
      : name_(std::move(name)),
        deaf_(deaf),
        commands_(bus::Reader<bus::PlayCommand>::Open(participant, bus::kPlayPartition).value()),
        states_(bus::Writer<bus::PlayState>::Open(participant, bus::kPlayPartition).value()),
        thread_([this](const std::stop_token& stop) {
          while (!stop.stop_requested()) {
            commands_.Wait(20ms);
            for (const auto& command : commands_.Take())
              if (command.session == name_) Hear(command);
            Say();
          }
          state_.phase = "ended";
          Say();
        }) {}
  ~FakeSession() {
    thread_.request_stop();
    thread_.join();
  }

 private:
  void Hear(const bus::PlayCommand& command) {
    if (deaf_-- > 0) return;
    state_.command_id = command.command_id;
    state_.refusal = command.action == bus::PlayAction::kNudge ? "it is held" : "";
    state_.sentence = command.arguments_json;
  }
  void Say() {
    state_.session = name_;
    if (state_.phase.empty()) state_.phase = "rest";
    EXPECT_TRUE(states_.Write(state_));
  }

  const std::string name_;
  int deaf_;
  bus::PlayState state_;
  bus::Reader<bus::PlayCommand> commands_;
  bus::Writer<bus::PlayState> states_;
  std::jthread thread_;
};

TEST(PlayClient, FindsASessionAndIsAnswered) {
  const auto there = Open(), here = Open();
  const FakeSession session(there, "one", 0);
  auto client = Client::Open(here);
  ASSERT_TRUE(client);
  const auto found = client->Find("one", 10s);
  ASSERT_TRUE(found) << found.error().message;
  const auto answered = client->Command("one", bus::PlayAction::kSay, {{"sentence", "hi"}}, 10s);
  ASSERT_TRUE(answered) << answered.error().message;
  EXPECT_EQ(answered->sentence, R"({"sentence":"hi"})");
}

TEST(PlayClient, SaysACommandAgainUntilItIsHeard) {
  const auto there = Open(), here = Open();
  const FakeSession session(there, "deaf", 2);
  auto client = Client::Open(here);
  ASSERT_TRUE(client && client->Find("deaf", 10s));
  EXPECT_TRUE(client->Command("deaf", bus::PlayAction::kStop, OrderedJson::object(), 10s));
}

TEST(PlayClient, TellsWhyACommandIsRefused) {
  const auto there = Open(), here = Open();
  const FakeSession session(there, "held", 0);
  auto client = Client::Open(here);
  ASSERT_TRUE(client && client->Find("held", 10s));
  const auto refused = client->Command("held", bus::PlayAction::kNudge, OrderedJson::object(), 10s);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, Code::kInvalidArgument);
  EXPECT_EQ(refused.error().message, "it is held");
}

TEST(PlayClient, ForgetsASessionThatEnded) {
  const auto there = Open(), here = Open();
  auto client = Client::Open(here);
  ASSERT_TRUE(client);
  {
    const FakeSession session(there, "short", 0);
    ASSERT_TRUE(client->Find("short", 10s));
  }
  const auto deadline = MonotonicClock::now() + 10s;
  while (client->Listen(100ms).contains("short") && MonotonicClock::now() < deadline) {
  }
  EXPECT_FALSE(client->Listen(0ns).contains("short"));
  const auto gone = client->Find("short", 0ns);
  ASSERT_FALSE(gone);
  EXPECT_EQ(gone.error().code, Code::kNotFound);
}

TEST(PlayClient, GetsTheNewestPictureOfItsSessionAlone) {
  const auto there = Open(), here = Open();
  auto one = bus::Writer<bus::PlayFrame>::Open(there, FramePartition("one"));
  auto other = bus::Writer<bus::PlayFrame>::Open(there, FramePartition("other"));
  auto frames = Frames::Open(here, "one");
  ASSERT_TRUE(one && other && frames);
  ASSERT_TRUE(one->WaitForReaders(1, 10s));
  EXPECT_EQ(other->matched_readers(), 0);
  bus::PlayFrame frame;
  frame.session = "one";
  frame.number = 3;
  frame.image = {1, 2, 3};
  ASSERT_TRUE(one->Write(frame));
  const auto taken = frames->Take(10s);
  ASSERT_TRUE(taken);
  EXPECT_EQ(taken->number, 3u);
  EXPECT_EQ(taken->image, frame.image);
  EXPECT_FALSE(Frames::Open(here, "a/b"));
}

TEST(PlayArguments, RefuseWhatTheyDoNotKnow) {
  const auto nudge = ReadArguments<NudgeArguments>({{"object", "coke"}, {"dx", 0.02}});
  ASSERT_TRUE(nudge);
  EXPECT_EQ(nudge->object, "coke");
  EXPECT_EQ(nudge->dx, 0.02);
  EXPECT_FALSE(ReadArguments<NudgeArguments>({{"object", "coke"}, {"dz", 0.02}}));
  EXPECT_FALSE(ReadArguments<SayArguments>({{"sentence", "x"}, {"max_steps", "many"}}));
  EXPECT_FALSE(ReadArguments<ObjectArguments>(OrderedJson::array()));
}

TEST(PlayActions, HaveNames) {
  ASSERT_TRUE(ActionOf("nudge"));
  EXPECT_EQ(*ActionOf("nudge"), bus::PlayAction::kNudge);
  const auto none = ActionOf("nugde");
  ASSERT_FALSE(none);
  EXPECT_NE(none.error().message.find("nudge"), std::string::npos);
  EXPECT_TRUE(IsSessionName("play-1a"));
  EXPECT_FALSE(IsSessionName(""));
  EXPECT_FALSE(IsSessionName("a/b"));
  EXPECT_FALSE(IsSessionName("*"));
}

}  // namespace client_test
}  // namespace etude::play
