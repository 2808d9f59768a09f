// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/predicates/beside.cc
#include "tests/worker/task/predicates/scene.h"

namespace etude::task {
namespace beside_test {

class Beside : public PredicateTest {
 protected:
  void PutAt(const Eigen::Vector3d& d) { coke().X_WO.p = milk().X_WO.p + d; }
};

TEST_F(Beside, IsAsSeenInThePictureAndNeverTwoSides) {
  for (const auto& [d, side] : {std::pair{Eigen::Vector3d(0.12, 0, 0), "left"},
                                {Eigen::Vector3d(-0.12, 0, 0), "right"},
                                {Eigen::Vector3d(0, 0.12, 0), "front"},
                                {Eigen::Vector3d(0, -0.12, 0), "behind"}}) {
    PutAt(d);
    for (const std::string asked : {"left", "right", "front", "behind"})
      EXPECT_EQ(Make("{beside: {side: " + asked + "}}")->Observe(now), asked == side) << asked << " " << side;
  }
}

TEST_F(Beside, HasBoundsAlongAndAcross) {
  const auto beside = Make("{beside: {side: left}}");
  for (const auto& [along, aside, holds] : {std::tuple{0.041, 0.0, true},
                                            {0.039, 0.0, false},
                                            {0.199, 0.0, true},
                                            {0.201, 0.0, false},
                                            {0.12, 0.049, true},
                                            {0.12, -0.049, true},
                                            {0.12, 0.051, false},
                                            {0.12, -0.051, false},
                                            {-0.12, 0.0, false}}) {
    PutAt({along, aside, 0.3});  // height does not count
    EXPECT_EQ(beside->Observe(now), holds) << along << " " << aside;
  }
}

TEST_F(Beside, FollowsTheReferenceWhenItWasMoved) {
  PutAt({0.12, 0, 0});
  milk().X_WO.p += Eigen::Vector3d(-0.2, 0, 0);
  EXPECT_FALSE(Make("beside")->Observe(now));
}

}  // namespace beside_test
}  // namespace etude::task
