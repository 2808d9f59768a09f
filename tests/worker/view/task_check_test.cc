// SPDX-License-Identifier: Apache-2.0
// Tests worker/view/task_check.cc
#include "worker/view/task_check.h"

#include <gmock/gmock.h>

#include "services/core/config.h"
#include "tests/support/matchers.h"
#include "tests/support/sketch_robot.h"
#include "tests/support/temporary_folder.h"

namespace etude {
namespace task_check_test {

constexpr const char* kFetch = R"(
name: fetch
summary: Take hold of the target and raise it high.
words: {verbs: [fetch]}
stages: [approach, reach, grasp, lift: {room: 0.2}, hold]
success: {all: [{risen: {by: 5 cm}}, grasped]}
)";

class TaskCheck : public testing::Test {
 protected:
  Status Check(const std::string& text, const std::string& robot = "ur5") {
    const std::string file = (folder_.path() / "fetch.yaml").string();
    EXPECT_THAT(WriteFileAtomically(file, std::string_view(text)), IsOk());
    return CheckTaskFile(file, {.robots = {robot}, .attempts = 1}, {});
  }

  TemporaryFolder folder_;
};

TEST_F(TaskCheck, SaysWhatATaskOfTheUsersMeansAndTriesIt) {
  testing::internal::CaptureStdout();
  const Status status = Check(kFetch);
  const std::string said = testing::internal::GetCapturedStdout();
  EXPECT_THAT(status, IsOk()) << said;
  for (const char* part :
       {"Take hold of the target and raise it high", "\"fetch red object\"", "lift (room 0.2)",
        "risen: the object's origin is higher", "start", "latched", "ur5: 1 of 1 demonstrations succeed"})
    EXPECT_THAT(said, testing::HasSubstr(part));
}

// they have to stand in every scene: the check drew some objects for each, and was refused its own scenes
TEST_F(TaskCheck, TriesATaskWhosePredicatesNameObjects) {
  std::string text = kFetch;
  text.replace(text.find("grasped]"), 8,
               "{untouched: {objects: mug_00, within: 1 m}}, {untouched: {objects: bottle, within: 1 m}}]");
  testing::internal::CaptureStdout();
  const Status status = Check(text);
  const std::string said = testing::internal::GetCapturedStdout();
  EXPECT_THAT(said, testing::HasSubstr("of 1 demonstrations succeed")) << (status ? "" : status.error().message);
}

TEST_F(TaskCheck, AsJsonIsOneObject) {
  const std::string file = (folder_.path() / "fetch.yaml").string();
  ASSERT_THAT(WriteFileAtomically(file, std::string_view(kFetch)), IsOk());
  testing::internal::CaptureStdout();
  const Status status = CheckTaskFile(file, {.robots = {"ur5"}, .attempts = 1, .as_json = true}, {});
  const auto json = OrderedJson::parse(testing::internal::GetCapturedStdout(), nullptr, false);
  EXPECT_THAT(status, IsOk());
  ASSERT_TRUE(json.is_object());
  EXPECT_EQ(json["summary"], "Take hold of the target and raise it high.");
  EXPECT_EQ(json["sentences"].size(), 3u);
  EXPECT_EQ(json["stages"][3], "lift (room 0.2)");
  ASSERT_EQ(json["robots"].size(), 1u);
  EXPECT_EQ(json["robots"][0]["robot"], "ur5");
  EXPECT_EQ(json["robots"][0]["succeeded"], 1);
  EXPECT_EQ(json["robots"][0]["works"], true);
}

// the first that could not be opened ended the check, and with --json nothing was said at all
TEST_F(TaskCheck, ARobotThatCannotDoItKeepsNoOtherFromBeingTried) {
  SketchRobot sketch;
  sketch.WithoutRoll();
  testing::internal::CaptureStdout();
  (void)CheckTaskFile("rotate", {.robots = {sketch.yaml(), "panda"}, .attempts = 1, .as_json = true}, {});
  const auto json = OrderedJson::parse(testing::internal::GetCapturedStdout(), nullptr, false);
  ASSERT_TRUE(json.is_object());
  ASSERT_EQ(json["robots"].size(), 2u);
  EXPECT_EQ(json["robots"][0]["works"], false);
  EXPECT_EQ(json["robots"][1]["attempts"], 1);
}

}  // namespace task_check_test

// A file that makes no sense is refused before anything is tried.
class WrongTask : public testing::TestWithParam<std::pair<const char*, const char*>> {};

TEST_P(WrongTask, IsRefusedWithWhatIsWrong) {
  TemporaryFolder folder;
  const auto& [line, message] = GetParam();
  const std::string file = (folder.path() / "wrong.yaml").string();
  const std::string text = std::string(
                               "{name: wrong, words: {verbs: [fetch]}, stages: [approach, reach, grasp, lift, "
                               "hold], success: grasped, ") +
                           line + "}";
  ASSERT_THAT(WriteFileAtomically(file, std::string_view(text)), IsOk());
  const Status status = CheckTaskFile(file, {.robots = {"ur5"}, .attempts = 1}, {});
  EXPECT_THAT(status, HasCode(Code::kInvalidArgument));
  EXPECT_THAT(status, MessageHas(message));
}

INSTANTIATE_TEST_SUITE_P(Every, WrongTask,
                         testing::Values(std::pair("summry: x", "did you mean 'summary'"),
                                         std::pair("latched: grasd", "did you mean 'grasped'"),
                                         std::pair("latched: {risen: {of: target}}", "risen"),
                                         std::pair("latched: {beside: {side: left}}", "reference"),
                                         std::pair("reference: {needed: true, only: [no_such_thing]}",
                                                   "words.places")));

}  // namespace etude
