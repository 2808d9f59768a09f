// SPDX-License-Identifier: Apache-2.0
// Tests worker/view/robot_check.cc with a robot that comes along and copies of it that cannot collect
#include <gmock/gmock.h>

#include <filesystem>

#include "services/core/config.h"
#include "tests/support/matchers.h"
#include "tests/support/replace_in_file.h"
#include "tests/support/temporary_folder.h"
#include "worker/view/robot_check.h"

namespace etude {
namespace robot_check_missing_test {

using testing::HasSubstr;
using testing::Not;

class MissingOfARobot : public testing::Test {
 protected:
  MissingOfARobot() {
    std::filesystem::copy("deploy/robots/sketch", folder_ / "sketch", std::filesystem::copy_options::recursive);
    std::filesystem::copy("deploy/robots/sketch.yaml", file_);
  }
  // Checks the sketch with `from` in its file replaced; keeps what is said.
  Status CheckWith(const std::string& from, const std::string& to) {
    ReplaceInFile(file_, from, to);
    testing::internal::CaptureStdout();
    const Status status = CheckRobot(file_.string(), {});
    said_ = testing::internal::GetCapturedStdout();
    return status;
  }

  TemporaryFolder folder_;
  Path file_ = folder_ / "mine.yaml";
  std::string said_;
};

TEST_F(MissingOfARobot, AHomeInTheTableIsMissingAndNoTaskIsTried) {
  EXPECT_THAT(CheckWith("home: [0, -0.15, 1.95", "home: [0, 1.6, 1.95"), MessageHas("cannot collect yet: home"));
  EXPECT_THAT(said_, HasSubstr("MISSING  home"));
  EXPECT_THAT(said_, HasSubstr("touches"));
  EXPECT_THAT(said_, HasSubstr("ok       joints     6: turn "));
  EXPECT_THAT(said_, Not(HasSubstr("demonstrations"))) << "every one would fail for the same reason";
}

TEST_F(MissingOfARobot, AsJsonIsOneObject) {
  ReplaceInFile(file_, "home: [0, -0.15, 1.95", "home: [0, 1.6, 1.95");
  testing::internal::CaptureStdout();
  const Status status = CheckRobot(file_.string(), {}, {.as_json = true});
  const auto json = OrderedJson::parse(testing::internal::GetCapturedStdout(), nullptr, false);
  EXPECT_THAT(status, MessageHas("cannot collect yet: home"));
  ASSERT_TRUE(json.is_object());
  EXPECT_EQ(json["can_collect"], false);
  ASSERT_FALSE(json["missing"].empty());
  EXPECT_EQ(json["missing"][0], "home") << "and its control, which the table blocks";
  const auto check = [&](const char* what) {
    for (const auto& row : json["checks"])
      if (row["what"] == what) return row;
    return OrderedJson();
  };
  EXPECT_EQ(check("joints")["ok"], true);
  EXPECT_EQ(check("home")["ok"], false);
  EXPECT_THAT(check("home")["text"].get<std::string>(), HasSubstr("touches"));
}

TEST_F(MissingOfARobot, ABaseThatIsTooFarReachesNoObjects) {
  EXPECT_THAT(CheckWith("position: [0, -0.2, 0]", "position: [0, -0.9, 0]"), MessageHas("reach"));
  EXPECT_THAT(said_, HasSubstr("MISSING  reach"));
  EXPECT_THAT(said_, HasSubstr("ok       home"));
}

TEST_F(MissingOfARobot, AGripperThatIsTooWeakNeverCloses) {
  EXPECT_THAT(CheckWith("force: 50 ", "force: 0.01 "), MessageHas("gripper"));
  EXPECT_THAT(said_, HasSubstr("MISSING  gripper"));
}

TEST_F(MissingOfARobot, WhatItsFileSaysWrongIsSaidFirst) {
  EXPECT_THAT(CheckWith("home:", "hom:"), MessageHas("did you mean 'home'?"));
  EXPECT_THAT(said_, Not(HasSubstr("compiles")));
  EXPECT_THAT(CheckRobot("sketchh", {}), MessageHas("did you mean 'sketch'?"));
  EXPECT_THAT(CheckRobot((folder_ / "none.yaml").string(), {}), HasCode(Code::kNotFound));
}

}  // namespace robot_check_missing_test
}  // namespace etude
