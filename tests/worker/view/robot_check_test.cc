// SPDX-License-Identifier: Apache-2.0
<<<<<<< HEAD
// Tests worker/view/robot_check.cc: what it says of a robot that has one thing wrong.
=======
// Tests worker/view/robot_check.cc with a robot that comes along and copies of it that cannot collect
>>>>>>> more-tests
#include "worker/view/robot_check.h"

#include <gmock/gmock.h>

<<<<<<< HEAD
#include "tests/support/matchers.h"
#include "tests/support/sketch_robot.h"
    =======
#include <filesystem>

#include "tests/support/matchers.h"
#include "tests/support/replace_in_file.h"
#include "tests/support/temporary_folder.h"
    >>>>>>> more-tests

    namespace etude {
  namespace {

  using testing::HasSubstr;
  using testing::Not;

  class RobotCheck : public testing::Test {
   protected:
<<<<<<< HEAD
    /// What is printed; a home out of reach of most places keeps the tasks from being tried where they do not matter.
    std::string Said(Status* status = nullptr) {
      testing::internal::CaptureStdout();
      const Status checked = CheckRobot(robot_.yaml(), {});
      if (status) *status = checked;
      return testing::internal::GetCapturedStdout();
    }
    void WithoutTasks() { robot_.InYaml("position: [0, -0.2, 0]", "position: [0, -1.0, 0]"); }

    SketchRobot robot_;
  };

  TEST_F(RobotCheck, SaysThatTheToolIsInsideAFinger) {
    WithoutTasks();
    robot_.InMjcf("<site name=\"grip\" pos=\"0 0 0.10\"/>", "<site name=\"grip\" pos=\"0.048 0 0.10\"/>");
    Status status;
    EXPECT_THAT(Said(&status), HasSubstr("MISSING  tool       its origin is inside left"));
    EXPECT_THAT(status, MessageHas("tool"));
  }

  TEST_F(RobotCheck, TheToolMayNotBeInsideAHalfClosedFingerEither) {
    WithoutTasks();
    robot_.InMjcf("<site name=\"grip\" pos=\"0 0 0.10\"/>", "<site name=\"grip\" pos=\"0.028 0 0.10\"/>");
    EXPECT_THAT(Said(), HasSubstr("half closed"));
  }

  TEST_F(RobotCheck, ImplausibleMassesAreANoteForThoseWhoTrustThem) {
    WithoutTasks();
    robot_.InMjcf("<geom type=\"mesh\" mesh=\"upper_beam\" mass=\"4\"/>",
                  "<geom type=\"mesh\" mesh=\"upper_beam\" mass=\"400\"/>");
    EXPECT_THAT(Said(), HasSubstr("MISSING  masses     upper has 400 kg: mend them, or say `masses: trust`"));
    robot_.InYaml("name: sketch\n", "name: sketch\nmasses: trust\n");
    const std::string trusted = Said();
    EXPECT_THAT(trusted, HasSubstr("masses are trusted: upper has 400 kg"));
    EXPECT_THAT(trusted, Not(HasSubstr("MISSING  masses")));
  }

  TEST_F(RobotCheck, NamesTheWeakJointAndDoesNotCallItsControlGood) {
    robot_.InMjcf("<position joint=\"bend\" kp=\"2000\" forcerange=\"-120 120\"/>",
                  "<position joint=\"bend\" kp=\"2000\" forcerange=\"-5 5\"/>");
    Status status;
    const std::string said = Said(&status);
    EXPECT_THAT(said, HasSubstr("MISSING  control"));
    EXPECT_THAT(said, HasSubstr("bend demands more than 5 N m in "));
    EXPECT_THAT(said, HasSubstr("raise `torque`"));
    EXPECT_THAT(said, Not(HasSubstr("ok       control")));
    EXPECT_THAT(status, HasCode(Code::kInvalidArgument));
  }

  TEST_F(RobotCheck, FiveJointsDoWhatNeedsNoTurningOver) {
    robot_.WithoutRoll();
    Status status;
    const std::string said = Said(&status);
    EXPECT_THAT(status, IsOk()) << said;
    EXPECT_THAT(said, HasSubstr("rotate is not for 5 joints"));
    EXPECT_THAT(said, HasSubstr("ok       pick"));
    EXPECT_THAT(said, HasSubstr("ok       push"));
    EXPECT_THAT(said, Not(HasSubstr("MISSING")));
=======
    RobotCheck() {
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

  TEST_F(RobotCheck, AHomeInTheTableIsMissingAndNoTaskIsTried) {
    EXPECT_THAT(CheckWith("home: [0, -0.15, 1.95", "home: [0, 1.6, 1.95"), MessageHas("cannot collect yet: home"));
    EXPECT_THAT(said_, HasSubstr("MISSING  home"));
    EXPECT_THAT(said_, HasSubstr("touches"));
    EXPECT_THAT(said_, HasSubstr("ok       joints     6: turn "));
    EXPECT_THAT(said_, Not(HasSubstr("demonstrations"))) << "every one would fail for the same reason";
  }

  TEST_F(RobotCheck, ABaseThatIsTooFarReachesNoObjects) {
    EXPECT_THAT(CheckWith("position: [0, -0.2, 0]", "position: [0, -0.9, 0]"), MessageHas("reach"));
    EXPECT_THAT(said_, HasSubstr("MISSING  reach"));
    EXPECT_THAT(said_, HasSubstr("ok       home"));
  }

  TEST_F(RobotCheck, AGripperThatIsTooWeakNeverCloses) {
    EXPECT_THAT(CheckWith("force: 50 ", "force: 0.01 "), MessageHas("gripper"));
    EXPECT_THAT(said_, HasSubstr("MISSING  gripper"));
  }

  TEST_F(RobotCheck, WhatItsFileSaysWrongIsSaidFirst) {
    EXPECT_THAT(CheckWith("home:", "hom:"), MessageHas("did you mean 'home'?"));
    EXPECT_THAT(said_, Not(HasSubstr("compiles")));
    EXPECT_THAT(CheckRobot("sketchh", {}), MessageHas("did you mean 'sketch'?"));
    EXPECT_THAT(CheckRobot((folder_ / "none.yaml").string(), {}), HasCode(Code::kNotFound));
>>>>>>> more-tests
  }

  }  // namespace
}  // namespace etude
