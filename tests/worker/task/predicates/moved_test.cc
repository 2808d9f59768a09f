// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/predicates/moved.cc
#include "tests/worker/task/predicates/scene.h"

namespace etude::task {
namespace moved_test {

TEST_F(PredicateTest, MovedCountsOnlyAlongItsDirection) {
  const auto pushed = Make("{moved: {by: 3 cm, along: +y}}");
  coke().X_WO.p = {0.3, 0.2, 0.04};
  EXPECT_FALSE(pushed->Observe(now)) << "aside and back";
  coke().X_WO.p = {0, 0.331, 0.04};
  EXPECT_TRUE(pushed->Observe(now));
}

TEST_F(PredicateTest, MovedKnowsTheSidesOfThePictureAndAnyDirection) {
  coke().X_WO.p = {0.05, 0.3, 0.04};
  EXPECT_TRUE(Make("{moved: {along: left}}")->Observe(now)) << "the camera looks from +y: its left is +x";
  EXPECT_FALSE(Make("{moved: {along: right}}")->Observe(now));
  EXPECT_FALSE(Make("{moved: {along: front}}")->Observe(now));
  EXPECT_TRUE(Make("moved")->Observe(now));
  EXPECT_FALSE(Make("{moved: {by: 6 cm}}")->Observe(now));
}

}  // namespace moved_test
}  // namespace etude::task
