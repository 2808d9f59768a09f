// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/predicates/released.cc
#include "tests/worker/task/predicates/scene.h"

namespace etude::task {
namespace released_test {

TEST_F(PredicateTest, ReleasedIsNotTouchedByAnyBodyOfTheRobot) {
  const auto released = Make("released");
  EXPECT_TRUE(released->Observe(now));
  coke().touched = true;
  EXPECT_FALSE(released->Observe(now));
  EXPECT_EQ(released->Words(), "coke touched by the robot");
}

}  // namespace released_test
}  // namespace etude::task
