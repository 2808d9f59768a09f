// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/predicates/all.cc
#include "tests/worker/task/predicates/scene.h"

namespace etude::task {
namespace all_test {

TEST_F(PredicateTest, AllNeedsEveryChildNowAndNamesThoseThatAreMissing) {
  const auto all = Make("{all: [risen, grasped, released]}");
  coke().X_WO.p.z() = 0.1;
  EXPECT_FALSE(all->Observe(now));
  EXPECT_EQ(all->Words(), "coke not grasped");
  coke().grasped = true;
  EXPECT_TRUE(all->Observe(now));
  EXPECT_EQ(all->Words(), "everything holds");
}

TEST_F(PredicateTest, AllShowsEveryStepToEveryChild) {
  const auto all = Make("{all: [grasped, untouched]}");  // the second has a memory
  bread().X_WO.p.x() += 0.1;
  EXPECT_FALSE(all->Observe(now));
  bread().X_WO = bread().X_WO_start;
  coke().grasped = true;
  EXPECT_FALSE(all->Observe(now));
}

}  // namespace all_test
}  // namespace etude::task
