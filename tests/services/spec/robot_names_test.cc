// SPDX-License-Identifier: Apache-2.0
// Tests services/spec/robot_names.cc
#include "services/spec/robot_names.h"

#include <gmock/gmock.h>

#include "services/spec/campaign_spec.h"

namespace etude {
namespace robot_names_test {

using ::testing::HasSubstr;

TEST(RobotNames, AreThoseOfTheFilesThatComeAlong) {
  for (const char* name : {"ur5", "panda", "jaco2", "sketch"}) {
    const auto file = FindRobot(name);
    ASSERT_TRUE(file) << file.error().message;
    EXPECT_TRUE(std::filesystem::is_regular_file(*file)) << file->string();
  }
}

TEST(RobotNames, AFileOfOnesOwnIsTakenAsItIs) { EXPECT_EQ(*FindRobot("my/arm.yaml"), Path("my/arm.yaml")); }

TEST(RobotNames, AnUnknownOneIsRefusedWithTheNearest) {
  const auto missing = FindRobot("ur55");
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().code, Code::kInvalidArgument);
  EXPECT_THAT(missing.error().message, HasSubstr("did you mean 'ur5'?"));
  CampaignSpec spec;
  spec.robots = {"ur55"};
  EXPECT_THAT(spec.Validate().error().message, HasSubstr("robots: 'ur55' is not known, did you mean 'ur5'?"));
}

}  // namespace robot_names_test
}  // namespace etude
