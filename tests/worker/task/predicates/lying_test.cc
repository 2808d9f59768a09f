// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/predicates/lying.cc
#include "tests/worker/task/predicates/scene.h"

namespace etude::task {
namespace lying_test {

TEST_F(PredicateTest, LyingTellsUprightFromLying) {
  const auto lying = Make("lying");
  EXPECT_FALSE(lying->Observe(now));
  for (const Eigen::Vector3d& rpy : {Eigen::Vector3d(-kQuarter, 0, 0), Eigen::Vector3d(0, kQuarter, 0)}) {
    coke().X_WO = At(0, 0.3, 0.025, rpy);
    EXPECT_TRUE(lying->Observe(now)) << rpy.transpose();
    coke().X_WO.p.z() = 0.2;
    EXPECT_FALSE(lying->Observe(now)) << "in the air";
  }
}

TEST_F(PredicateTest, LyingLeansAsFarAsWasSaid) {
  coke().X_WO = At(0, 0.3, 0.025, {kQuarter - 0.3, 0, 0});
  EXPECT_TRUE(Make("{lying: {within: 0.31 rad}}")->Observe(now));
  EXPECT_FALSE(Make("{lying: {within: 0.29 rad}}")->Observe(now));
}

}  // namespace lying_test
}  // namespace etude::task
