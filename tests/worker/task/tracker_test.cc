// SPDX-License-Identifier: Apache-2.0
#include "worker/task/tracker.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <deque>
#include <limits>
#include <vector>

#include "worker/task/rollout.h"

namespace etude::task {
namespace tracker_test {

std::vector<Waypoint> Line(const Eigen::Vector3d& from, const Eigen::Vector3d& velocity, double gripper = 0) {
  std::vector<Waypoint> waypoints(kWaypoints);
  for (int k = 0; k < kWaypoints; ++k) {
    waypoints[k].X_WE.p = from + velocity * (WaypointStep(k) / kControlRate);
    waypoints[k].gripper = gripper;
  }
  return waypoints;
}

TEST(Tracker, FollowsALineWithItsVelocity) {
  Tracker tracker({}, false);
  tracker.Follow(Line({0, 0, 0}, {0.2, 0, 0}));
  Command command;
  for (int i = 0; i <= 50; ++i) command = tracker.Next(0);
  // it began at rest: what it lacked then is made up for
  EXPECT_NEAR(command.target.X_WE.p.x(), 0.2 * 50 / kControlRate, 2e-4);
  EXPECT_NEAR(command.V_WE[0], 0.2, 2e-3);
  EXPECT_NEAR(command.V_WE.tail<5>().norm(), 0, 1e-9);
}

TEST(Tracker, NeverJumps) {
  Tracker tracker({}, false);
  auto far = Line({1, 0, 0}, {9, 0, 0});
  for (auto& waypoint : far) waypoint.X_WE.q = FromEuler({2, 0, 0});
  tracker.Follow(far);
  Pose last;
  for (int i = 0; i < 100; ++i) {
    const Command command = tracker.Next(0);
    EXPECT_LE((command.target.X_WE.p - last.p).norm(), 0.8 / kControlRate + 1e-9);
    EXPECT_LE(AngleBetween(command.target.X_WE.q, last.q), 3.0 / kControlRate + 1e-6);
    EXPECT_LE(command.V_WE.head<3>().norm(), 0.8 + 1e-9);
    last = command.target.X_WE;
  }
}

TEST(Tracker, GoesNoFasterThanTheJointsCan) {
  // a hand whose joints can follow 0.1 m/s
  Tracker tracker({}, false, [](const Eigen::Matrix<double, 6, 1>& V_WE) {
    return std::min(1.0, 0.1 / std::max(1e-9, V_WE.head<3>().norm()));
  });
  tracker.Follow(Line({0.05, 0, 0}, {0.4, 0, 0}));
  Eigen::Vector3d before = Eigen::Vector3d::Zero();
  for (int i = 0; i < 60; ++i) {
    const Command command = tracker.Next(0);
    EXPECT_LE((command.target.X_WE.p - before).norm() * kControlRate, 0.1 + 1e-9);
    EXPECT_LE(command.V_WE.head<3>().norm(), 0.1 + 1e-9);
    before = command.target.X_WE.p;
  }
  EXPECT_NEAR(before.x(), 60 * 0.1 / kControlRate, 2e-3) << "and as fast as they can, once it has started";
}

// Positions of a reference by numerical differences: what the hand gets to feel.
struct Motion {
  double most_acceleration = 0;  // m/s^2
  double farthest = 0, last = 0;
  Motion(Tracker& tracker, int steps, double from, double speed) : last(from) {
    for (int i = 0; i < steps; ++i) {
      const double x = tracker.Next(0).target.X_WE.p.x();
      const double now = (x - last) * kControlRate;
      most_acceleration = std::max(most_acceleration, std::abs(now - speed) * kControlRate);
      farthest = std::max(farthest, x);
      speed = now;
      last = x;
    }
  }
};

TEST(Tracker, StartsAndArrivesGently) {
  Tracker tracker({}, false);
  tracker.Follow(Line({0.2, 0, 0}, {0, 0, 0}));
  const Motion motion(tracker, 200, 0, 0);
  EXPECT_NEAR(motion.most_acceleration, 8, 1e-6);
  EXPECT_NEAR(motion.last, 0.2, 1e-4) << "and arrives";
  EXPECT_LE(motion.farthest, 0.2 + 1e-3) << "without going past it";
}

// A picture knows no speed: the next answer begins where the hand was, behind the reference, and slower.
TEST(Tracker, ANewAnswerNeitherThrowsTheHandBackNorStopsItAtOnce) {
  Tracker tracker({}, false);
  tracker.Follow(Line({0, 0, 0}, {0.5, 0, 0}));
  double x = 0, speed = 0;
  for (int i = 0; i < 60; ++i) {
    const double next = tracker.Next(0).target.X_WE.p.x();
    speed = (next - x) * kControlRate;
    x = next;
  }
  ASSERT_NEAR(speed, 0.5, 5e-3);
  tracker.Follow(Line({x - 0.01, 0, 0}, {0.3, 0, 0}));
  const Motion motion(tracker, 60, x, speed);
  EXPECT_LE(motion.most_acceleration, 8 + 1e-6);
  EXPECT_NEAR(motion.last, x + 0.3 * 60 / kControlRate, 4e-3) << "and is on the new path soon";
}

// The hand hangs 8 mm behind, as its spring holds a weight: answers that begin where it is do not take the reference
// back.
TEST(Tracker, AnAnswerIsFollowedFromWhereTheReferenceIs) {
  Tracker tracker({}, false);
  double x = 0;
  for (int answer = 0; answer < 10; ++answer) {
    tracker.Follow(Line({x - 0.008, 0, 0}, {0.1, 0, 0}));
    for (int i = 0; i < 30; ++i) {
      const double next = tracker.Next(0).target.X_WE.p.x();
      EXPECT_GE(next, x - 1e-4);
      x = next;
    }
  }
  EXPECT_NEAR(x, 0.1 * 300 / kControlRate, 5e-3) << "as fast as the path";
}

TEST(Tracker, DoesNotSkipWhatLiesFarAheadOnThePath) {
  Tracker tracker({}, false);
  // there and back again: the end of the path is where the reference is
  std::vector<Waypoint> loop(kWaypoints);
  for (int k = 0; k < kWaypoints; ++k) loop[k].X_WE.p.x() = 0.01 + 0.02 * std::min(k, kWaypoints - 2 - k);
  tracker.Follow(loop);
  double most = 0;
  for (int i = 0; i < kHorizonSteps; ++i) most = std::max(most, tracker.Next(0).target.X_WE.p.x());
  EXPECT_GT(most, 0.1);
}

// a joint is slow for a while: the hand comes later, and no faster than the path itself
TEST(Tracker, DoesNotRushAfterThePathWhenTheJointsCanFollowAgain) {
  double limit = 0.1;
  Tracker tracker({}, false, [&](const Eigen::Matrix<double, 6, 1>& V_WE) {
    return std::min(1.0, limit / std::max(1e-9, V_WE.head<3>().norm()));
  });
  tracker.Follow(Line({0, 0, 0}, {0.4, 0, 0}));
  double before = 0, most = 0;
  for (int i = 0; i < 60; ++i) {
    if (i == 30) limit = 10;
    const double x = tracker.Next(0).target.X_WE.p.x();
    most = std::max(most, (x - before) * kControlRate);
    before = x;
  }
  EXPECT_GT(most, 0.35);
  EXPECT_LE(most, 0.4 * 1.2) << "what speeding up took is made up for, and no more";
}

TEST(Tracker, HoldsTheLastWaypointWhenTheAnswerRunsOut) {
  Tracker tracker({}, false);
  tracker.Follow(Line({0, 0, 0}, {0.1, 0, 0}));
  Command command;
  for (int i = 0; i < 400; ++i) command = tracker.Next(0);
  EXPECT_NEAR(command.target.X_WE.p.x(), 0.1 * (kHorizonSteps - 1) / kControlRate, 1e-9);
  EXPECT_NEAR(command.V_WE.norm(), 0, 1e-9);
}

// Fingers that go so much of their way a step, so many steps after they were told.
struct Fingers {
  double stops_at = 1, a_step = 0.03;  // those of the UR5's hand; the Panda's make 0.01
  int delay = 0;
  double closed = 0;
  std::deque<bool> under_way = {};
  double Next(bool close) {
    under_way.push_back(close);
    if (static_cast<int>(under_way.size()) > delay) {
      closed = under_way.front() ? std::min(stops_at, closed + a_step) : std::max(0.0, closed - a_step);
      under_way.pop_front();
    }
    return closed;
  }
};

// An answer's heights at its waypoints, with fingers that close `at` one.
std::vector<Waypoint> Heights(const std::vector<double>& z, int at) {
  auto waypoints = Line({0, 0, 0}, {0, 0, 0});
  for (int k = 0; k < kWaypoints; ++k) {
    waypoints[k].X_WE.p.z() = z[std::min<std::size_t>(k, z.size() - 1)];
    waypoints[k].gripper = k >= at;
  }
  return waypoints;
}

// Where the hand is in each of so many steps, and how far its fingers are closed.
struct Grasp {
  std::vector<double> z, closed;
  Grasp(Tracker& tracker, Fingers fingers, int steps) {
    bool close = false;
    for (int i = 0; i < steps; ++i) {
      const Command command = tracker.Next(fingers.Next(close));
      close = command.target.gripper > 0.5;
      z.push_back(command.target.X_WE.p.z());
      closed.push_back(fingers.closed);
    }
  }
  int StepWhereClosed(double to) const {
    return static_cast<int>(std::ranges::find_if(closed, [&](double now) { return now >= to; }) - closed.begin());
  }
};

TEST(Tracker, AHandThatGraspsStandsUntilItsFingersRest) {
  for (const Fingers& fingers :
       {Fingers{.stops_at = 0.6}, Fingers{.stops_at = 0.9, .a_step = 0.01}, Fingers{.stops_at = 0.6, .delay = 20}}) {
    Tracker tracker({}, false, nullptr, fingers.delay);
    tracker.Follow(Heights({0, 0, 0.001, 0.01, 0.05, 0.1}, 1));  // up before the fingers can be
    const Grasp grasp(tracker, fingers, 250);
    const int grasped = grasp.StepWhereClosed(fingers.stops_at);
    ASSERT_LT(grasped, 150);
    EXPECT_LT(grasp.z[grasped], 1e-3) << fingers.a_step << " " << fingers.delay;
    EXPECT_GT(grasp.z.back(), 0.09) << "and then it rises";
  }
}

TEST(Tracker, FingersThatAreTooEarlyCloseWhereTheHandArrives) {
  Tracker tracker({Eigen::Vector3d(0, 0, 0.05)}, false);
  tracker.Follow(Heights({0.05, 0.04, 0.02, 0.005, 0, 0, 0.03, 0.08}, 2));  // two waypoints before it is there
  const Grasp grasp(tracker, {.stops_at = 0.6}, 200);
  EXPECT_LT(grasp.z[grasp.StepWhereClosed(0.6)], 3e-3) << "told at 0.02 m";
  EXPECT_GT(grasp.z.back(), 0.07);
}

TEST(Tracker, AnAnswerThatComesWhileTheFingersCloseDoesNotRaiseTheHand) {
  Tracker tracker({}, false);
  tracker.Follow(Heights({0, 0, 0.01, 0.05}, 1));
  Fingers fingers{.stops_at = 0.6};
  bool close = false;
  for (int i = 0; i < 60 && fingers.closed < 0.6; ++i) {
    if (i == 20) tracker.Follow(Heights({0.01, 0.02, 0.05, 0.1}, 0));
    const Command command = tracker.Next(fingers.Next(close));
    close = command.target.gripper > 0.5;
    EXPECT_LT(command.target.X_WE.p.z(), 2e-3) << i;
  }
  EXPECT_EQ(fingers.closed, 0.6);
}

// One that shows the grasp as it begins: open, and closed only later.
TEST(Tracker, AnAnswerThatComesWhileTheFingersCloseDoesNotOpenThemToCloseThemAgain) {
  Tracker tracker({}, false);
  tracker.Follow(Heights({0, 0, 0, 0.01, 0.05}, 1));
  Fingers fingers{.stops_at = 0.6, .a_step = 0.01};
  bool close = false;
  int step = 0;
  for (; step < 120 && fingers.closed < 0.6; ++step) {
    if (step > 0 && step % 30 == 0) tracker.Follow(Heights({0, 0.01, 0, 0, 0.05}, 2));
    const Command command = tracker.Next(fingers.Next(close));
    close = command.target.gripper > 0.5;
  }
  EXPECT_LT(step, 90) << "each answer opened them";
}

TEST(Tracker, AnAnswerThatComesWhileTheFingersCloseCanOpenThem) {
  Tracker tracker({}, false);
  tracker.Follow(Heights({0}, 1));
  Fingers fingers{.stops_at = 0.6, .a_step = 0.01};
  bool close = false;
  for (int i = 0; i < 30; ++i) close = tracker.Next(fingers.Next(close)).target.gripper > 0.5;
  ASSERT_TRUE(close);
  tracker.Follow(Heights({0}, kWaypoints));
  EXPECT_EQ(tracker.Next(fingers.Next(close)).target.gripper, 0) << "it does not want to grasp any more";
}

TEST(Tracker, FingersThatCloseOnTheWayDoNotStopTheHand) {
  Tracker with({}, false), without({}, false);
  const auto open = Line({0, 0, 0}, {0.4, 0, 0}), closed = Line({0, 0, 0}, {0.4, 0, 0}, 1);
  with.Follow(open);
  without.Follow(open);
  for (int i = 0; i < 30; ++i) with.Next(0), without.Next(0);
  with.Follow(closed, 30);
  without.Follow(open, 30);
  Fingers fingers;
  for (int i = 0; i < 30; ++i)
    EXPECT_EQ(with.Next(fingers.Next(true)).target.X_WE.p, without.Next(0).target.X_WE.p) << i;
}

// As for a push: the expert sets off at once, too.
TEST(Tracker, FingersThatCloseFromTheStartDoNotKeepTheHand) {
  Tracker tracker({}, false);
  tracker.Follow(Heights({0, 0.02, 0.06, 0.1}, 0));
  const Grasp push(tracker, {}, 40);
  EXPECT_GT(push.z.back(), 0.09);
}

TEST(Tracker, AWaveringAnswerDoesNotKeepTheHandForEver) {
  Tracker tracker({}, false);
  Fingers fingers;
  bool close = false;
  double z = 0;
  for (int i = 0; i < 1500; ++i) {
    if (i % 30 == 0) {
      auto answer = Line({0, 0, z}, {0, 0, 0.1}, i / 30 % 2);
      for (int k = 0; k < 2; ++k) answer[k].X_WE.p.z() = z;  // still where the fingers are told
      tracker.Follow(answer);
    }
    const Command command = tracker.Next(fingers.Next(close));
    close = command.target.gripper > 0.5;
    z = command.target.X_WE.p.z();
  }
  EXPECT_GT(z, 0.015);
}

TEST(FingerWait, IsForNoLongerThanTheyMoveAndNeverForEver) {
  const auto steps_until_rest = [](double stops_at, double jitter, bool close = true) {
    FingerWait wait;
    wait.Begin(close);
    Fingers fingers{.stops_at = stops_at, .closed = close ? 0.0 : 1.0};
    for (int i = 1;; ++i)
      if (!wait.Moving(fingers.Next(close) + (i % 2 ? jitter : 0))) return i;
  };
  EXPECT_EQ(steps_until_rest(0.6, 0), 20 + 3);
  EXPECT_LE(steps_until_rest(0, 0), 10) << "closed as far as they go already";
  EXPECT_EQ(steps_until_rest(0.6, 0.01), 110) << "they tremble";
  EXPECT_EQ(steps_until_rest(0, 0, false), 16) << "the expert does not wait for all of an opening";
}

TEST(FingerWait, IsNoLongerForAWaveringCommand) {
  FingerWait wait;
  EXPECT_FALSE(wait.Moving(0)) << "before any command";
  double gripper = 0;
  int steps = 0;
  do {
    const bool close = steps / 15 % 2 == 0;
    if (steps % 15 == 0) wait.Begin(close);
    gripper += close ? 0.03 : -0.03;
    ++steps;
  } while (wait.Moving(gripper));
  EXPECT_EQ(steps, 110);
}

TEST(Tracker, GripperHasHysteresis) {
  Tracker tracker({}, false);
  const auto closed_at = [&](double gripper) {
    tracker.Follow(Line({0, 0, 0}, {0, 0, 0}, gripper));
    return tracker.Next(0).target.gripper > 0.5;
  };
  EXPECT_FALSE(closed_at(0.55));
  EXPECT_TRUE(closed_at(0.65));
  EXPECT_TRUE(closed_at(0.45));
  EXPECT_FALSE(closed_at(0.35));
}

TEST(RefusalOf, AcceptsASaneAnswer) { EXPECT_EQ(RefusalOf({Line({0, 0.3, 0.1}, {0, 0, 0})}), ""); }

TEST(RefusalOf, NamesWhatIsWrong) {
  EXPECT_NE(RefusalOf({}), "");
  policy::Answer nan{Line({0, 0, 0}, {0, 0, 0})};
  nan.waypoints[3].X_WE.p.y() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(RefusalOf(nan), "waypoint 3 is not finite");
  policy::Answer infinite{Line({0, 0, 0}, {0, 0, 0})};
  infinite.waypoints[11].gripper = std::numeric_limits<double>::infinity();
  EXPECT_NE(RefusalOf(infinite), "");
  EXPECT_NE(RefusalOf({Line({0, 5, 0}, {0, 0, 0})}), "");
  policy::Answer squeezed{Line({0, 0, 0}, {0, 0, 0})};
  squeezed.waypoints[0].X_WE.q.coeffs() *= 0.5;
  EXPECT_NE(RefusalOf(squeezed), "");
}

}  // namespace tracker_test
}  // namespace etude::task
