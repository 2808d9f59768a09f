// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/predicates/any.cc
#include "tests/worker/task/predicates/scene.h"

namespace etude::task {
namespace any_test {

TEST_F(PredicateTest, AnyNeedsOneChildAndShowsEveryStepToAll) {
  const auto any = Make("{any: [grasped, untouched]}");
  coke().grasped = true;
  bread().X_WO.p.x() += 0.1;
  EXPECT_TRUE(any->Observe(now));
  bread().X_WO = bread().X_WO_start;
  coke().grasped = false;
  EXPECT_FALSE(any->Observe(now)) << "the second saw the bread move while the first held";
}

}  // namespace any_test
}  // namespace etude::task
