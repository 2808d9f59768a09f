// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/predicates/upright.cc
#include "tests/worker/task/predicates/scene.h"

namespace etude::task {
namespace upright_test {

TEST_F(PredicateTest, UprightLeansByLessThanThirtyDegreesWhateverItsYaw) {
  const auto upright = Make("upright");
  for (const double yaw : {0.0, 1.0, 3.0}) {
    coke().X_WO = At(0, 0.3, 0.04, {0.51, 0, yaw});
    EXPECT_TRUE(upright->Observe(now)) << yaw;
    coke().X_WO = At(0, 0.3, 0.04, {0.54, 0, yaw});
    EXPECT_FALSE(upright->Observe(now)) << yaw;
  }
  coke().X_WO = At(0, 0.3, 0.04, {std::numbers::pi, 0, 0});
  EXPECT_FALSE(upright->Observe(now)) << "on its head";
}

}  // namespace upright_test
}  // namespace etude::task
