// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/predicates/inside.cc
#include "tests/worker/task/predicates/scene.h"

namespace etude::task {
namespace inside_test {

class Inside : public PredicateTest {
 protected:
  Inside() {
    milk().half_extent = {0.08, 0.06, 0.05};  // a box
    milk().X_WO.p.z() = 0.05;
  }
};

TEST_F(Inside, IsWithinTheWallsAndBelowTheRim) {
  const auto inside = Make("inside");
  EXPECT_FALSE(inside->Observe(now));
  coke().X_WO.p = milk().X_WO.p + Eigen::Vector3d(0.05, 0.03, 0);
  EXPECT_TRUE(inside->Observe(now)) << inside->Words();
  coke().X_WO.p.x() = milk().X_WO.p.x() + 0.081;
  EXPECT_FALSE(inside->Observe(now)) << "outside";
  coke().X_WO.p = milk().X_WO.p + Eigen::Vector3d(0, 0, 0.05 + 0.04 - 0.009);
  EXPECT_FALSE(inside->Observe(now)) << "only over the rim: " << inside->Words();
}

TEST_F(Inside, TurnsWithTheBox) {
  milk().X_WO.q = FromEuler({0, 0, kQuarter});
  const auto inside = Make("inside");
  coke().X_WO.p = milk().X_WO.p + Eigen::Vector3d(0, 0.07, 0);
  EXPECT_TRUE(inside->Observe(now)) << inside->Words();
  coke().X_WO.p = milk().X_WO.p + Eigen::Vector3d(0.07, 0, 0);
  EXPECT_FALSE(inside->Observe(now));
}

}  // namespace inside_test
}  // namespace etude::task
