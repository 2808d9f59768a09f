// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/play.cc with a session by hand: what a program reads of it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <thread>

#include "services/bus/topic.h"
#include "services/core/command.h"
#include "services/core/config.h"
#include "services/play/client.h"
#include "tests/support/etude_command.h"
#include "tests/support/temporary_folder.h"

namespace etude::play {
namespace play_commands_test {

using namespace std::chrono_literals;

constexpr std::uint32_t kDomain = 66;

// A session in which every sentence ends as it is told.
class FakeSession {
 public:
  explicit FakeSession(std::string outcome, const std::string& name = "by-hand",
                       const std::string& scene = R"({"campaign": "lab", "tasks": ["pick", "push"],
                           "campaign_objects": ["coke", "pepsi"], "objects": [{"name": "coke"}, {"name": "pepsi"}]})")
      : participant_(bus::Participant::Open({kDomain, ""}).value()),
        commands_(bus::Reader<bus::PlayCommand>::Open(participant_, bus::kPlayPartition).value()),
        states_(bus::Writer<bus::PlayState>::Open(participant_, bus::kPlayPartition).value()) {
    state_.session = name;
    state_.run = "nobody@0011";
    state_.phase = "rest";
    state_.scene_json = scene;
    thread_ = std::jthread([this, outcome = std::move(outcome)](const std::stop_token& stop) {
      while (!stop.stop_requested()) {
        commands_.Wait(20ms);
        for (const auto& command : commands_.Take()) {
          state_.command_id = command.command_id;
          state_.sentence = OrderedJson::parse(command.arguments_json).value("sentence", "");
          state_.outcome = outcome, state_.reason = "as it was told", state_.step = 212, state_.checkpoint_step = 750;
        }
        EXPECT_TRUE(states_.Write(state_));
      }
    });
  }

 private:
  bus::Participant participant_;
  bus::Reader<bus::PlayCommand> commands_;
  bus::Writer<bus::PlayState> states_;
  bus::PlayState state_;
  std::jthread thread_;
};

class PlayCommands : public testing::Test {
 protected:
  // stdout is one object: what else is in the file are the lines of the log
  OrderedJson Say(const std::string& sentence, int exit_code) {
    const auto said = RunEtude({"play", "say", "by-hand", sentence, "--json", "--domain", std::to_string(kDomain)},
                               folder_ / "output.txt");
    EXPECT_EQ(said.exit_code, exit_code) << said.text;
    const auto begin = said.text.find("{\n"), end = said.text.rfind("\n}");
    if (begin == std::string::npos || end == std::string::npos || end < begin) return {};
    return OrderedJson::parse(said.text.substr(begin, end + 2 - begin), nullptr, false);
  }
  TemporaryFolder folder_;
};

TEST_F(PlayCommands, ASentenceIsOneObjectWithWhatItMeansAndHowItEnded) {
  const FakeSession session("success");
  const auto json = Say("push the pepsi", kExitOk);
  ASSERT_TRUE(json.is_object());
  EXPECT_EQ(json["session"], "by-hand");
  EXPECT_EQ(json["sentence"], "push the pepsi");
  EXPECT_EQ(json["means"]["task"], "push");
  EXPECT_EQ(json["means"]["target"], "pepsi");
  EXPECT_EQ(json["unseen_by"], "campaign") << "nobody serves a checkpoint that says its words";
  EXPECT_EQ(json["outcome"], "success");
  EXPECT_EQ(json["steps"], 212);
  EXPECT_EQ(json["checkpoint_step"], 750);
}

TEST_F(PlayCommands, OneThatIsNotDoneIsAnObjectToo) {
  const FakeSession session("timeout");
  const auto json = Say("sing to me", kExitFailure);
  ASSERT_TRUE(json.is_object());
  EXPECT_TRUE(json["means"].is_null());
  EXPECT_NE(json["why_not"], "");
  EXPECT_EQ(json["outcome"], "timeout");
  EXPECT_EQ(json["reason"], "as it was told");
}

// before, one scene of another kind ended the list of all, and what peers say moved the reader's cursor
TEST_F(PlayCommands, TheListHasEverySessionWhateverOnesSceneIs) {
  const FakeSession session("success"), odd("success", "odd\x1b[2J", "[]");
  const auto listed = RunEtude({"play", "list", "--domain", std::to_string(kDomain)}, folder_ / "output.txt");
  EXPECT_EQ(listed.exit_code, kExitOk) << listed.text;
  EXPECT_THAT(listed.text, testing::HasSubstr("by-hand  rest"));
  EXPECT_THAT(listed.text, testing::HasSubstr("odd"));
  EXPECT_THAT(listed.text, testing::Not(testing::HasSubstr("\x1b")));
}

}  // namespace play_commands_test
}  // namespace etude::play
