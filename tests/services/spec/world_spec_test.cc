// SPDX-License-Identifier: Apache-2.0
// Tests services/spec/world_spec.cc
#include "services/spec/world_spec.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace etude {
namespace {

using ::testing::HasSubstr;

TEST(WorldSpec, ReportsWhatIsOutOfRange) {
  WorldSpec world;
  std::vector<std::string> errors;
  world.Check(errors);
  EXPECT_TRUE(errors.empty());
  world.table = "wod";
  world.light_direction = {0, 0, 1};
  world.friction = 0;
  world.background = {0, 2};
  world.Check(errors);
  EXPECT_EQ(errors.size(), 5u) << testing::PrintToString(errors);
  EXPECT_THAT(testing::PrintToString(errors), HasSubstr("did you mean 'wood'"));
}

}  // namespace
}  // namespace etude
