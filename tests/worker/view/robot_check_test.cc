// SPDX-License-Identifier: Apache-2.0
// Tests worker/view/robot_check.cc: what it says of a robot that has one thing wrong.
#include "worker/view/robot_check.h"

#include <gmock/gmock.h>

#include "tests/support/matchers.h"
#include "tests/support/sketch_robot.h"

namespace etude {
namespace robot_check_test {

using testing::HasSubstr;
using testing::Not;

class RobotCheck : public testing::Test {
 protected:
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

TEST_F(RobotCheck, LooksThatWeighAreANote) {
  WithoutTasks();
  EXPECT_THAT(Said(), Not(HasSubstr("visual geoms")));
  robot_.InMjcf("<geom contype=\"0\" conaffinity=\"0\" material=\"metal\" mass=\"0\"/>",
                "<geom contype=\"0\" conaffinity=\"0\" material=\"metal\"/>");
  const std::string said = Said();
  EXPECT_THAT(said, HasSubstr("note                visual geoms, which collide with nothing, carry 2.24 of 16.96 kg"));
  EXPECT_THAT(said, HasSubstr("upper 1.18 kg, turret 1.04 kg, left 0.01 kg, right 0.01 kg"));
  EXPECT_THAT(said, HasSubstr("say `masses: collision`"));
  EXPECT_THAT(said, HasSubstr("ok       masses     16.96 kg in all")) << "it is not refused";
  robot_.InMjcf("material=\"metal\"/></default>", "material=\"metal\" density=\"400\"/></default>");
  EXPECT_THAT(Said(), Not(HasSubstr("visual geoms"))) << "0.9 of 15.6 kg are little";
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

TEST_F(RobotCheck, SaysThatHomeIsNearASingularity) {
  WithoutTasks();
  EXPECT_THAT(Said(), Not(HasSubstr("singularity")));
  robot_.InYaml("home: [0, -0.15, 1.95, 0, 1.3416, 0]", "home: [0, -0.15, 1.95, 0, 0.01, 0]");
  EXPECT_THAT(Said(), HasSubstr("note                home is near a singularity"));
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
}

}  // namespace robot_check_test
}  // namespace etude
