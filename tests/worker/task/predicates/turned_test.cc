// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/predicates/turned.cc
#include "tests/worker/task/predicates/scene.h"

namespace etude::task {
namespace turned_test {

TEST_F(PredicateTest, TurnedCountsEitherWayAboutXOnly) {
  const auto turned = Make("turned");
  for (const auto& [rpy, holds] : {std::pair{Eigen::Vector3d(kQuarter, 0, 0), true},
                                   {Eigen::Vector3d(-kQuarter, 0, 0), true},
                                   {Eigen::Vector3d(kQuarter - 0.48, 0, 0), true},
                                   {Eigen::Vector3d(kQuarter - 0.52, 0, 0), false},
                                   {Eigen::Vector3d(-kQuarter, 0.4, 0.4), false},
                                   {Eigen::Vector3d(0, kQuarter, 0), false},
                                   {Eigen::Vector3d(0, 0, kQuarter), false}}) {
    coke().X_WO = At(0, 0.3, 0.15, rpy);
    EXPECT_EQ(turned->Observe(now), holds) << rpy.transpose();
  }
}

TEST_F(PredicateTest, TurnedIsMeasuredAgainstTheYawAtTheStart) {
  const auto turned = Make("turned");
  for (const double yaw : {-0.3, 0.0, 0.3, 1.2}) {
    coke().X_WO_start = At(0, 0.3, 0.04, {0, 0, yaw});
    coke().X_WO = {{0, 0.3, 0.15}, FromEuler({-kQuarter, 0, 0}) * coke().X_WO_start.q};
    EXPECT_TRUE(turned->Observe(now)) << yaw;
  }
}

}  // namespace turned_test
}  // namespace etude::task
