// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/predicates/grasped.cc
#include "tests/worker/task/predicates/scene.h"

namespace etude::task {
namespace grasped_test {

TEST_F(PredicateTest, GraspedIsWhatTheFingersSay) {
  const auto grasped = Make("grasped");
  coke().touched = true;
  EXPECT_FALSE(grasped->Observe(now)) << "one finger only";
  EXPECT_EQ(grasped->Words(), "coke not grasped");
  coke().grasped = true;
  EXPECT_TRUE(grasped->Observe(now));
  EXPECT_FALSE(Make("{grasped: {object: milk}}")->Observe(now));
}

}  // namespace grasped_test
}  // namespace etude::task
