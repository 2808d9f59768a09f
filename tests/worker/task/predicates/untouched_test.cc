// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/predicates/untouched.cc
#include "tests/worker/task/predicates/scene.h"

namespace etude::task {
namespace untouched_test {

TEST_F(PredicateTest, UntouchedRemembersThatSomethingWasMovedAndBack) {
  const auto untouched = Make("untouched");
  bread().X_WO.p.x() += 0.019;
  EXPECT_TRUE(untouched->Observe(now));
  bread().X_WO.p.x() += 0.002;
  EXPECT_FALSE(untouched->Observe(now));
  bread().X_WO = bread().X_WO_start;
  EXPECT_FALSE(untouched->Observe(now));
  EXPECT_THAT(untouched->Words(), testing::HasSubstr("bread was moved by 0.021 m"));
}

TEST_F(PredicateTest, UntouchedOthersAreNeitherTargetNorReference) {
  const auto others = Make("untouched"), reference = Make("{untouched: {objects: reference}}");
  coke().X_WO.p.x() += 1;
  milk().X_WO.p.x() += 1;
  EXPECT_TRUE(others->Observe(now));
  EXPECT_FALSE(reference->Observe(now));
}

}  // namespace untouched_test
}  // namespace etude::task
