// SPDX-License-Identifier: Apache-2.0
#include "worker/task/standstill.h"

#include <gtest/gtest.h>

#include <cmath>
#include <utility>
#include <vector>

namespace etude::task {
namespace standstill_test {

Pose At(double x, double turned = 0) {
  Pose X_WE;
  X_WE.p.x() = x;
  X_WE.q = FromEuler({turned, 0, 0});
  return X_WE;
}

// Steps of the questions at which it is seen, of a hand asked each 30 steps.
template <typename Motion>
std::vector<int> Seen(const Motion& motion, int steps = 600) {
  Standstill standstill;
  std::vector<int> seen;
  for (int step = 0; step <= steps; step += 30) {
    const auto& [X_WE, gripper] = motion(step);
    if (standstill.At(step, X_WE, gripper)) seen.push_back(step);
  }
  return seen;
}

TEST(Standstill, IsAHandThatStaysOrGoesRoundInASmallCircle) {
  EXPECT_EQ(Seen([](int) { return std::pair(At(0.3), 0.0); }), (std::vector{240, 510}));
  EXPECT_EQ(Seen([](int step) { return std::pair(At(0.3 + 0.01 * std::sin(step)), 0.1); }), (std::vector{240, 510}));
}

TEST(Standstill, IsNoneOfAHandThatGoesTurnsOrGrasps) {
  EXPECT_TRUE(Seen([](int step) { return std::pair(At(2e-4 * step), 0.0); }).empty()) << "2.5 cm/s";
  EXPECT_TRUE(Seen([](int step) { return std::pair(At(0, 2e-3 * step), 0.0); }).empty()) << "0.25 rad/s";
  EXPECT_TRUE(Seen([](int step) { return std::pair(At(0), step / 210 % 2 ? 0.7 : 0.0); }).empty());
}

TEST(Standstill, IsCountedFromWhereTheHandCameToStand) {
  EXPECT_EQ(Seen([](int step) { return std::pair(At(step < 120 ? 1e-3 * step : 0.2), 0.0); }, 400), std::vector{360});
}

}  // namespace standstill_test
}  // namespace etude::task
