// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/predicates/on.cc
#include "tests/worker/task/predicates/scene.h"

namespace etude::task {
namespace on_test {

class On : public PredicateTest {
 protected:
  void Stack() {
    coke().X_WO.p = milk().X_WO.p + Eigen::Vector3d(0.01, 0, 0.10);
    coke().contacts = {"milk"};
  }
};

TEST_F(On, StandsOnTheOtherAndNotOnTheTable) {
  const auto on = Make("on");
  EXPECT_FALSE(on->Observe(now));
  Stack();
  EXPECT_TRUE(on->Observe(now)) << on->Words();
  coke().contacts = {"milk", "world"};
  EXPECT_FALSE(on->Observe(now)) << "leans";
  coke().contacts = {"left_finger"};
  EXPECT_FALSE(on->Observe(now)) << "held just above";
}

TEST_F(On, HasBoundsInHeightAndAside) {
  const auto on = Make("on");
  Stack();
  coke().X_WO.p.x() += 0.025;
  EXPECT_FALSE(on->Observe(now));
  Stack();
  coke().X_WO.p.z() += 0.02;
  EXPECT_FALSE(on->Observe(now));
}

TEST_F(On, MeasuresTheBoxAsItIsTurned) {
  const auto on = Make("on");
  Stack();
  coke().X_WO = {milk().X_WO.p + Eigen::Vector3d(0, 0, 0.06 + 0.025), FromEuler({kQuarter, 0, 0})};
  EXPECT_TRUE(on->Observe(now)) << "a can on its side: " << on->Words();
}

}  // namespace on_test
}  // namespace etude::task
