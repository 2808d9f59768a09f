// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <numbers>

#include "services/core/check.h"
#include "worker/task/criteria.h"
#include "worker/task/goals.h"

namespace etude::task {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using Part = Shapes::Part;

constexpr double kDeepest = 0.065;      // m that the fingertips go below the object's top
constexpr double kPalmGap = 0.006;      // m between palm and object
constexpr double kFingerGap = 0.010;    // m between fingertips and table
constexpr double kHover = 0.03;         // m between open fingertips and the object's top before the grasp
constexpr double kHoverSlack = 0.02;    // m nearer when the hand is already on the line
constexpr double kOnLine = 0.04;        // m off the line at most to count as on it
constexpr double kLiftedBelow = 0.10;   // m under a lifted object
constexpr double kCarriedBelow = 0.19;  // m under an object that is carried over the others
constexpr double kPushPitch = 1.35;     // rad: fingertips first
constexpr double kPushLeaning = 1.25;   // rad where the palm would be ahead: no further, for reach
constexpr double kPushHeight = 0.010;   // m between fingertips and table
constexpr double kPushBehind = 0.035;   // m between fingertips and object before the push
constexpr double kPushFurther = 0.11;   // m that the object is pushed
constexpr double kPushLess = 0.06;      // m where a neighbour is in the way further on
constexpr double kLaidTilt = 0.28;      // rad off level of the hand that lays an object down: its palm needs the room
constexpr double kVertical = 1.4;       // rad from which on the hand counts as pointing straight down
constexpr double kTall = 0.12;          // m of an object from which on a hand that holds it is above the others
constexpr double kPadBeyond = 0.014;    // m that the fingertips pass the object's axis
constexpr double kTurnedReach = 0.50;   // m from the base's axis at least, for a hand that points away
constexpr double kTurnBack = 0.12;      // m towards the robot while turning
constexpr double kPlaceGap = 0.002;     // m between object and table when it is released
constexpr double kHandGap = 0.015;      // m between the open hand and the reference beside it
constexpr double kBesideMost = 0.165;   // m
constexpr double kRetreat = 0.12;       // m

// How the hand comes at things and carries them.
struct Grip {
  double pitch = 0;  // rad, see Hand()
  double yaw = 0;    // rad about the vertical: 0 closes along x, pi/2 along y

  Quaterniond q() const { return Quaterniond(Eigen::AngleAxisd(yaw, Vector3d::UnitZ())) * Hand(pitch); }
  Vector3d approach() const { return Eigen::AngleAxisd(yaw, Vector3d::UnitZ()) * ApproachOf(pitch); }
};

// A hand is wider than it is thick: beside another object it goes lengthwise between the two, unless what it holds is
// so tall that it passes above the other one.
Grip GripFor(const Situation& now, double pitch, const TaskName& task) {
  const bool sideways = task.base == "place_left" || task.base == "place_right";
  const bool low = 2 * now.shapes->object(now.target).half_extent.z() < kTall;
  return {pitch, sideways && low && pitch > kVertical ? std::numbers::pi / 2 : 0};
}

double TopOf(const Situation& now) {
  return (now.X_WO * now.shapes->Centre(now.target)).z() + now.shapes->object(now.target).half_extent.z();
}

double Below(const Situation& now, Part part, bool closed, const Quaterniond& q_WE) {
  return now.shapes->Reach(part, closed, q_WE, -Vector3d::UnitZ());
}

// Lowest z of E at which the hand is off the table, whatever its fingers do.
double LowestHand(const Situation& now, const Quaterniond& q_WE) {
  return now.shapes->FurthestReach(q_WE, -Vector3d::UnitZ()) + kFingerGap;
}

// The fingertips at the object's axis, as deep as object, palm and table allow.
Pose AtGrasp(const Situation& now, const Grip& grip) {
  const Quaterniond q = grip.q();
  const Vector3d a = grip.approach();
  const double top = TopOf(now), ahead = now.shapes->ahead_closed();
  const double tips = top - kDeepest - ahead * a.z();  // z of E with the tips that deep
  const double palm = top + kPalmGap - now.shapes->palm_ahead() * a.z();
  // the palm is beside the axis of an object that is approached at an angle
  const double above_palm = grip.pitch > kVertical ? palm : tips;
  const double z = std::max({tips, above_palm, LowestHand(now, q)});
  // pads, not their very tips, around the axis
  const Eigen::Vector2d xy = now.X_WO.p.head<2>() + (kPadBeyond - ahead) * a.head<2>();
  return {{xy.x(), xy.y(), z}, q};
}

// Back along the approach until the open fingers clear the object's top.
Pose BeforeGrasp(const Situation& now, const Grip& grip) {
  const Pose at = AtGrasp(now, grip);
  const Vector3d a = grip.approach();
  const double clear = TopOf(now) + kHover + Below(now, Part::kFingers, false, at.q);
  const double far = std::max(0.05, (clear - at.p.z()) / std::sin(grip.pitch));
  const Vector3d from = now.X_WE.p - at.p;
  const double back = -from.dot(a);
  const bool on_line = (from + back * a).norm() < kOnLine;
  const double distance = on_line ? std::clamp(back - 0.01, far - kHoverSlack, far) : far;
  return {at.p - distance * a, at.q};
}

// Straight up, until there is `room` under what is held.
Pose Raised(const Situation& now, const Grip& grip, double room) {
  const Quaterniond q = grip.q();
  const double below = now.X_EO ? HeldBelow(now, q) : Below(now, Part::kHand, true, q);
  return {{now.X_WE.p.x(), now.X_WE.p.y(), std::max(now.X_WE.p.z(), below + room)}, q};
}

// A palm that is as low as the object's top must not be ahead of the fingertips: it would tip the object over, or press
// it to the table until it jams. Then the hand leans further forward.
bool PalmIsClear(const Situation& now, const Quaterniond& q) {
  const auto palm = [&](const Vector3d& direction) { return now.shapes->Reach(Part::kPalm, true, q, direction); };
  const double fingertips = Below(now, Part::kHand, true, q);
  const double height = kPushHeight + fingertips - palm(-Vector3d::UnitZ());
  return height > TopOf(now) ||
         palm(Vector3d::UnitY()) <= now.shapes->Reach(Part::kFingers, true, q, Vector3d::UnitY());
}

Quaterniond PushingHand(const Situation& now) {
  for (double pitch = kPushPitch; pitch > kPushLeaning; pitch -= 0.05)
    if (PalmIsClear(now, Hand(pitch))) return Hand(pitch);
  return Hand(kPushLeaning);
}

Pose Pushing(const Situation& now, double further) {
  const Quaterniond q = PushingHand(now);
  const double half_depth = now.shapes->object(now.target).half_extent.y();
  const double touching = now.X_WO.p.y() - half_depth - now.shapes->Reach(Part::kFingers, true, q, Vector3d::UnitY());
  return {{now.X_WO.p.x(), touching + further, Below(now, Part::kHand, true, q) + kPushHeight}, q};
}

// A quarter of a turn: where the hand comes to point back at the robot it moves towards it by what is left to turn, and
// where it comes to point away it needs room for the wrist behind it.
Pose Turned(const Situation& now, double tilt) {
  const bool back = now.shapes->turned_pitch() > std::numbers::pi / 2;
  const double pitch = now.shapes->turned_pitch() + (back ? -tilt : tilt);
  const Eigen::Vector2d from_base = now.X_WE.p.head<2>() - now.shapes->base();
  double y = now.X_WE.p.y();
  if (back) {
    const double left = AngleBetween(now.X_WE.q, Hand(pitch)) / (std::numbers::pi / 2);
    y -= kTurnBack * std::clamp(left, 0.0, 1.0);
  } else {
    const double x = from_base.x();
    y = std::max(y, now.shapes->base().y() + std::sqrt(std::max(0.0, kTurnedReach * kTurnedReach - x * x)));
  }
  const double below = std::max(HeldBelow(now, Hand(pitch)), HeldBelow(now, now.X_WE.q));
  return {{now.X_WE.p.x(), y, std::max(now.X_WE.p.z(), below + kLiftedBelow)}, Hand(pitch)};
}

// Down until the object, the fingers or the palm touch.
Pose Lowered(const Situation& now, const Quaterniond& q) {
  const double z = std::max(HeldBelow(now, q) + kPlaceGap, LowestHand(now, q));
  return {{now.X_WE.p.x(), now.X_WE.p.y(), z}, q};
}

// Where the target goes: far enough for the open hand to fit beside the reference.
Vector3d PlaceBeside(const Situation& now, const Quaterniond& q_WE, const std::string& relation) {
  if (relation == "place_front" || relation == "place_behind") return now.X_WR.p + kBefore * DirectionOf(relation);
  const double hand = now.shapes->Reach(Part::kHand, false, q_WE, DirectionOf(relation));
  const double reference = now.shapes->object(now.reference).half_extent.head<2>().maxCoeff();
  return now.X_WR.p + std::clamp(hand + reference + kHandGap, kBeside, kBesideMost) * DirectionOf(relation);
}

Pose Beside(const Situation& now, const Grip& grip, const std::string& relation) {
  ETUDE_CHECK(now.X_EO.has_value());
  const Quaterniond q = grip.q();
  const Vector3d p_EO_W = q * now.X_EO->p;
  const Vector3d place = PlaceBeside(now, q, relation);
  return {{place.x() - p_EO_W.x(), place.y() - p_EO_W.y(), 0}, q};
}

Pose Carried(const Situation& now, const Grip& grip, const std::string& relation) {
  Pose goal = Beside(now, grip, relation);
  goal.p.z() = std::max(now.X_WE.p.z(), HeldBelow(now, goal.q) + kCarriedBelow);
  return goal;
}

Pose SetDown(const Situation& now, const Grip& grip, const std::string& relation) {
  Pose goal = Beside(now, grip, relation);
  goal.p.z() = Lowered(now, goal.q).p.z();
  return goal;
}

}  // namespace

double HeldBelow(const Situation& now, const Quaterniond& q_WE) {
  ETUDE_CHECK(now.X_EO.has_value());
  const Pose X_WO = Pose{Vector3d::Zero(), q_WE} * *now.X_EO;  // for a hand at the origin
  return now.shapes->HeightOnTable(now.target, X_WO.q) - X_WO.p.z();
}

TaskGoals AboveGoals(double pitch, const TaskName& task) {
  TaskGoals goals;
  const auto grip = [=](const Situation& now) { return GripFor(now, pitch, task); };
  const double room = task.relation() ? kCarriedBelow : kLiftedBelow;
  goals.before_grasp = [=](const Situation& now) { return BeforeGrasp(now, grip(now)); };
  goals.at_grasp = [=](const Situation& now) { return AtGrasp(now, grip(now)); };
  goals.lifted = [=](const Situation& now) { return Raised(now, grip(now), room); };
  goals.before_push = [](const Situation& now) { return Pushing(now, -kPushBehind); };
  goals.pushed = [](const Situation& now) { return Pushing(now, kPushFurther); };
  goals.pushed_less = [](const Situation& now) { return Pushing(now, kPushLess); };
  const double tilt = task.base == "rotate" ? 0 : kLaidTilt;
  goals.turned = [=](const Situation& now) { return Turned(now, tilt); };
  goals.laid = [](const Situation& now) { return Lowered(now, now.X_WE.q); };
  if (task.relation()) {
    const std::string relation = task.base;
    goals.carried = [=](const Situation& now) { return Carried(now, grip(now), relation); };
    goals.set_down = [=](const Situation& now) { return SetDown(now, grip(now), relation); };
  }
  const bool back = task.relation();
  goals.retreated = [=](const Situation& now) {
    const Vector3d away = back ? Vector3d(-grip(now).approach()) : Vector3d::UnitZ();
    return Pose{now.X_WE.p + kRetreat * away, now.X_WE.q};
  };
  return goals;
}

}  // namespace etude::task
