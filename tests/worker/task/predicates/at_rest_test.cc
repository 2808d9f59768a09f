// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/predicates/at_rest.cc
#include "tests/worker/task/predicates/scene.h"

namespace etude::task {
namespace at_rest_test {

TEST_F(PredicateTest, AtRestIsSlowerThanWasSaid) {
  const auto at_rest = Make("{at_rest: {slower_than: 3 cm/s}}");
  coke().speed = 0.029;
  EXPECT_TRUE(at_rest->Observe(now));
  coke().speed = 0.031;
  EXPECT_FALSE(at_rest->Observe(now));
  EXPECT_THAT(at_rest->Words(), testing::HasSubstr("0.031 m/s"));
}

}  // namespace at_rest_test
}  // namespace etude::task
