// SPDX-License-Identifier: Apache-2.0
// Tests worker/plan/sampling.cc in a plane whose free space is known
#include "worker/plan/sampling.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace etude::plan::internal {
namespace sampling_test {

using Eigen::Vector2d;
using Eigen::VectorXd;

// A square of 2 with a wall across it that has one gap.
struct Walled {
  double gap_from = 0.6, gap_to = 0.9;

  bool IsFree(const VectorXd& q) const {
    const bool in_wall = std::abs(q[0]) < 0.1;
    return !in_wall || (q[1] > gap_from && q[1] < gap_to);
  }
  bool IsSegmentFree(const VectorXd& from, const VectorXd& to) const {
    const int pieces = std::max(1, static_cast<int>(std::ceil((to - from).norm() / 0.01)));
    for (int i = 0; i <= pieces; ++i)
      if (!IsFree(from + (to - from) * i / pieces)) return false;
    return true;
  }
};

SamplingProblem ProblemIn(const Walled& room, int max_samples) {
  return {.q_start = Vector2d(-0.8, -0.8),
          .q_goal = Vector2d(0.8, -0.8),
          .lower = Vector2d(-1, -1),
          .upper = Vector2d(1, 1),
          .is_free = [&room](const VectorXd& q) { return room.IsFree(q); },
          .is_segment_free = [&room](const VectorXd& from, const VectorXd& to) { return room.IsSegmentFree(from, to); },
          .max_samples = max_samples};
}

TEST(SamplePath, LeadsThroughTheGap) {
  const Walled room;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    Rng rng(seed);
    const SamplingProblem problem = ProblemIn(room, 5000);
    const SamplingResult result = SamplePath(problem, rng);
    ASSERT_GE(result.path.size(), 3u) << "straight ahead is a wall";
    EXPECT_EQ(result.path.front(), problem.q_start);
    EXPECT_EQ(result.path.back(), problem.q_goal);
    for (std::size_t i = 1; i < result.path.size(); ++i)
      EXPECT_TRUE(room.IsSegmentFree(result.path[i - 1], result.path[i])) << seed;
    EXPECT_LE(result.samples, 5001);
    EXPECT_GT(result.samples, 0);
  }
}

TEST(SamplePath, SpendsItsBudgetAndNoMoreWhereThereIsNoWay) {
  const Walled closed{.gap_from = 2, .gap_to = 2};
  for (const int budget : {1, 50, 400}) {
    Rng rng(1);
    int asked = 0;
    SamplingProblem problem = ProblemIn(closed, budget);
    problem.is_segment_free = [&](const VectorXd& from, const VectorXd& to) {
      ++asked;
      return closed.IsSegmentFree(from, to);
    };
    const SamplingResult result = SamplePath(problem, rng);
    EXPECT_TRUE(result.path.empty());
    EXPECT_EQ(result.samples, budget);
    EXPECT_GT(asked, 0);
  }
}

TEST(SamplePath, IsAFunctionOfTheProblemAndTheStream) {
  const Walled room;
  const auto plan = [&](std::uint64_t seed) {
    Rng rng(seed);
    return SamplePath(ProblemIn(room, 5000), rng);
  };
  const SamplingResult first = plan(3), other = plan(4), again = plan(3);
  EXPECT_EQ(first.path, again.path) << "whatever was planned in between";
  EXPECT_EQ(first.samples, again.samples);
  EXPECT_NE(first.path, other.path);
}

TEST(SamplePath, StartOrGoalInAWallHasNoPath) {
  const Walled room;
  for (const bool at_start : {true, false}) {
    Rng rng(5);
    SamplingProblem problem = ProblemIn(room, 200);
    (at_start ? problem.q_start : problem.q_goal) = Vector2d(0, 0);
    EXPECT_TRUE(SamplePath(problem, rng).path.empty()) << at_start;
  }
}

TEST(SamplePath, StaysInItsBox) {
  const Walled room{.gap_from = -2, .gap_to = 2};
  Rng rng(6);
  SamplingProblem problem = ProblemIn(room, 2000);
  problem.upper = Vector2d(1, -0.5);
  double highest = -1;
  problem.is_segment_free = [&](const VectorXd& from, const VectorXd& to) {
    highest = std::max(highest, to[1]);
    return (to - from).norm() < 0.3;  // so that many states are drawn
  };
  ASSERT_FALSE(SamplePath(problem, rng).path.empty());
  EXPECT_LE(highest, -0.5);
  EXPECT_GT(highest, -0.7) << "up to its border";
}

}  // namespace sampling_test
}  // namespace etude::plan::internal
