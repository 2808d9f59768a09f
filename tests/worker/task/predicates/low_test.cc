// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/predicates/low.cc
#include "tests/worker/task/predicates/scene.h"

namespace etude::task {
namespace low_test {

TEST_F(PredicateTest, LowIsLowerThanWasSaid) {
  const auto low = Make("{low: {below: 8 cm}}");
  EXPECT_TRUE(low->Observe(now));
  coke().X_WO.p.z() = 0.081;
  EXPECT_FALSE(low->Observe(now));
  EXPECT_THAT(low->Words(), testing::HasSubstr("0.081 m"));
}

}  // namespace low_test
}  // namespace etude::task
