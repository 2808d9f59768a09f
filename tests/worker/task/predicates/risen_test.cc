// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/predicates/risen.cc
#include "tests/worker/task/predicates/scene.h"

namespace etude::task {
namespace risen_test {

TEST_F(PredicateTest, RisenNeedsMoreThanWasSaid) {
  const auto risen = Make("{risen: {by: 3 cm}}");
  EXPECT_FALSE(risen->Observe(now));
  coke().X_WO.p.z() = 0.0699;
  EXPECT_FALSE(risen->Observe(now));
  coke().X_WO.p.z() = 0.0701;
  EXPECT_TRUE(risen->Observe(now));
  coke().X_WO.p.z() = 0.04;
  EXPECT_FALSE(risen->Observe(now)) << "a state, not a memory";
}

TEST_F(PredicateTest, RisenCountsFromTheTableWhenAsked) {
  const auto risen = Make("{risen: {by: 10 cm, from: table, object: milk}}");
  milk().X_WO.p.z() = 0.099;
  EXPECT_FALSE(risen->Observe(now));
  milk().X_WO.p.z() = 0.101;
  EXPECT_TRUE(risen->Observe(now));
  EXPECT_THAT(risen->Words(), testing::HasSubstr("milk above the table by 0.101 m"));
}

}  // namespace risen_test
}  // namespace etude::task
