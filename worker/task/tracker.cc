// SPDX-License-Identifier: Apache-2.0
#include "worker/task/tracker.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "worker/sim/controller.h"
#include "worker/sim/saturated.h"

namespace etude::task {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;

// What bounds the reference: its speed, how fast that changes, and how fast it comes back onto the path. A new answer
// begins where the hand is, a centimetre behind the reference, and often at another speed: a reference that jumps there
// at once throws joints near a singularity beyond their limits (1.5 times, in the wrist of the UR5).
struct Bounds {
  double speed;         // m/s or rad/s
  double acceleration;  // m/s^2 or rad/s^2
};
constexpr Bounds kLinear{0.8, 8.0};
constexpr Bounds kAngular{3.0, 30.0};
constexpr double kBackOntoPath = 25;  // 1/s
// A new answer begins where the hand is. The reference leads it by what the spring needs to hold and to move it, up to
// so many control steps of the path; an answer followed from its beginning would take it back as far, each time.
constexpr int kMostAhead = 15;
constexpr double kTurnAsWay = 0.2;  // m that a turn of one rad counts as
// The fingers close above one and open below the other.
constexpr double kCloseAbove = 0.6;
constexpr double kOpenBelow = 0.4;
// The hand stands still for its fingers where the reference is slower than this: at a grasp and a release, not where
// they close on the way to a push; braked within 6 mm.
constexpr double kAllButStill = 0.3;  // m/s
// After a wait so many steps of the path go by before the next: an answer that wavers does not keep the hand for ever.
constexpr double kBetweenWaits = 10;
// Fingers that were told to move do so from some control step on, and rest when they make less than this share of their
// whole way in each of the next few.
constexpr int kBegins = 6;
constexpr int kRests = 3;
constexpr double kAtRest = 0.003;
constexpr int kMostClosing = 110;  // the Panda's take 100
constexpr int kMostOpening = 16;   // the expert's release takes 14

// Velocity that closes the gap `e` and can still be braked to nothing at its end.
Eigen::Vector3d Closing(const Eigen::Vector3d& e, const Bounds& bounds) {
  const double gap = e.norm();
  if (gap < 1e-12) return Eigen::Vector3d::Zero();
  return e * (std::min(kBackOntoPath * gap, std::sqrt(bounds.acceleration * gap)) / gap);
}

// Whether closed fingers would open at the step `first` of an answer's path, and close again behind it.
bool OpensOnlyToClose(const std::vector<Waypoint>& waypoints, int first) {
  if (ShallClose(Interpolate(waypoints, first).gripper, /*closed=*/true)) return false;
  for (int k = 0; k < kWaypoints; ++k)
    if (WaypointStep(k) > first && ShallClose(waypoints[static_cast<std::size_t>(k)].gripper, /*closed=*/false))
      return true;
  return false;
}

}  // namespace

bool ShallClose(double gripper, bool closed) { return gripper > (closed ? kOpenBelow : kCloseAbove); }

void FingerWait::Begin(bool close) {
  if (left_ == 0) {
    left_ = delay_ + (close ? kMostClosing : kMostOpening);
    steps_ = 0;
  }
  at_rest_ = 0;
}

bool FingerWait::Moving(double gripper) {
  const double moved = std::abs(gripper - std::exchange(last_, gripper));
  if (left_ == 0) return false;
  at_rest_ = ++steps_ > kBegins + delay_ && moved < kAtRest ? at_rest_ + 1 : 0;
  left_ = at_rest_ >= kRests ? 0 : left_ - 1;
  return left_ > 0;
}

void Tracker::Follow(std::vector<Waypoint> waypoints, int first) {
  if (closed_ && fingers_.moving() && OpensOnlyToClose(waypoints, first)) return;
  waypoints_ = std::move(waypoints);
  step_ = first;
  const Pose next_reference = sim::Advanced(reference_, V_WE_, 1 / kControlRate);
  const auto distance = [&](double step) {
    const Pose X_WE = Interpolate(waypoints_, step).X_WE;
    return (X_WE.p - next_reference.p).norm() + kTurnAsWay * sim::RotationVector(X_WE.q, next_reference.q).norm();
  };
  for (double here = distance(step_); step_ < first + kMostAhead; ++step_) {
    const double there = distance(step_ + 1);
    if (there >= here) break;
    here = there;
  }
}

Command Tracker::Next(double gripper) {
  Command command;
  command.target = {reference_, closed_ ? 1.0 : 0.0};
  const bool moving = fingers_.Moving(gripper);
  if (waypoints_.empty()) return command;
  const Waypoint now = Interpolate(waypoints_, step_);
  if (!moving)
    X_WE_waiting_.reset();
  else if (!X_WE_waiting_ && !Arriving())
    X_WE_waiting_ = now.X_WE;
  if (X_WE_waiting_) {
    Advance(*X_WE_waiting_, *X_WE_waiting_);
    since_wait_ = 0;
  } else {
    const double passed = Advance(now.X_WE, Interpolate(waypoints_, step_ + 1).X_WE);
    step_ += passed;
    since_wait_ += passed;
  }
  command.V_WE = V_WE_;
  const bool closed = ShallClose(now.gripper, closed_);
  const bool changed = closed != std::exchange(closed_, closed);
  const bool waits = std::exchange(commanded_, true) && (moving || since_wait_ >= kBetweenWaits);
  if (changed && waits && V_WE_.head<3>().norm() < kAllButStill) fingers_.Begin(closed_);
  command.target = {reference_, closed_ ? 1.0 : 0.0};
  return command;
}

bool Tracker::Arriving() const {
  const auto way = [&](double step) {
    return (Interpolate(waypoints_, step + 1).X_WE.p - Interpolate(waypoints_, step).X_WE.p).norm();
  };
  return way(step_ + WaypointStep(1)) < way(step_);
}

// The path's own velocity, and what closes the gap that would be left then: on the path it is followed exactly. Where
// the joints cannot follow, time on the path goes slower, so that nothing has to be made up for when they can again.
double Tracker::Advance(const Pose& now, const Pose& next) {
  const double dt = 1 / kControlRate;
  Vector6d path;
  path << (next.p - now.p) / dt, sim::RotationVector(now.q, next.q) / dt;
  const double share = ShareOf(path);
  path *= share;
  const Eigen::Vector3d gap = now.p - reference_.p - path.head<3>() * dt;
  const Eigen::Vector3d turned = sim::RotationVector(reference_.q, now.q) - path.tail<3>() * dt;
  Vector6d wanted;
  wanted << sim::Saturated(path.head<3>() + Closing(gap, kLinear), kLinear.speed),
      sim::Saturated(path.tail<3>() + Closing(turned, kAngular), kAngular.speed);
  const Vector6d change = ShareOf(wanted) * wanted - V_WE_;
  V_WE_.head<3>() += sim::Saturated(change.head<3>(), kLinear.acceleration * dt);
  V_WE_.tail<3>() += sim::Saturated(change.tail<3>(), kAngular.acceleration * dt);
  reference_.p += V_WE_.head<3>() * dt;
  const Eigen::Vector3d turn = V_WE_.tail<3>() * dt;
  if (turn.norm() > 0)
    reference_.q = (Eigen::Quaterniond(Eigen::AngleAxisd(turn.norm(), turn.normalized())) * reference_.q).normalized();
  return share;
}

}  // namespace etude::task
