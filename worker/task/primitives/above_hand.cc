// SPDX-License-Identifier: Apache-2.0
#include "worker/task/primitives/above_hand.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "services/core/check.h"

namespace etude::task::above {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using Part = SceneGeometry::Part;

// A palm that is as low as the object's top must not be ahead of the fingertips: it would tip the object over, or press
// it to the table until it jams. Then the hand leans further forward.
bool PalmIsClear(const StageContext& now, const Quaterniond& q) {
  const auto palm = [&](const Vector3d& direction) { return now.shapes->Reach(Part::kPalm, true, q, direction); };
  const double fingertips = Below(now, Part::kHand, true, q);
  const double height = kAbove.push_height + fingertips - palm(-Vector3d::UnitZ());
  return height > TopOfTarget(now) ||
         palm(Vector3d::UnitY()) <= now.shapes->Reach(Part::kFingers, true, q, Vector3d::UnitY());
}

Quaterniond PushingHand(const StageContext& now) {
  if (!now.shapes->turns_any_way()) return Hand(now.shapes->natural_pitch());
  for (double pitch = kAbove.push_pitch; pitch > kAbove.push_leaning; pitch -= 0.05)
    if (PalmIsClear(now, Hand(pitch))) return Hand(pitch);
  return Hand(kAbove.push_leaning);
}

// z of E while it pushes. A hand that cannot lean goes higher where that takes its palm over the object, as long as the
// fingertips stay below most of it: higher up they would tip it over.
double PushingHeight(const StageContext& now, const Quaterniond& q) {
  const double tips = now.shapes->Reach(Part::kHand, true, q, -Vector3d::UnitZ());
  const double low = tips + kAbove.push_height;
  if (now.shapes->turns_any_way() || PalmIsClear(now, q)) return low;
  const double top = TopOfTarget(now);
  const double over = top + kAbove.palm_gap + now.shapes->Reach(Part::kPalm, true, q, -Vector3d::UnitZ());
  return over - tips < kAbove.push_highest * top ? std::max(low, over) : low;
}

double TopOf(const StageContext& now, const std::string& object, const Pose& X_WO) {
  return (X_WO * now.shapes->Centre(object)).z() + now.shapes->object(object).half_extent.z();
}

// Where the target goes: far enough for the open hand to fit beside the reference.
Vector3d PlaceOf(const StageContext& now, const Quaterniond& q_WE, Whereto to) {
  if (to == Whereto::kOnTop || to == Whereto::kInside) return now.X_WR.p;
  const Vector3d direction = DirectionOf(to);
  if (to == Whereto::kFront || to == Whereto::kBehind) return now.X_WR.p + kAbove.before * direction;
  const double hand = now.shapes->Reach(Part::kHand, false, q_WE, direction);
  const double reference = now.shapes->object(now.reference).half_extent.head<2>().maxCoeff();
  return now.X_WR.p + std::clamp(hand + reference + kAbove.hand_gap, kAbove.beside, kAbove.beside_most) * direction;
}

}  // namespace

// A hand is wider than it is thick: beside another object it goes lengthwise between the two, unless what it holds is
// so tall that it passes above the other one.
Grip GripFor(const StageContext& now, const Manner& manner) {
  const bool low = 2 * now.shapes->object(now.target).half_extent.z() < kAbove.tall;
  return {manner.pitch, manner.lengthwise && low && manner.pitch > kAbove.vertical ? std::numbers::pi / 2 : 0};
}

double TopOfTarget(const StageContext& now) { return TopOf(now, now.target, now.X_WO); }
double TopOfReference(const StageContext& now) { return TopOf(now, now.reference, now.X_WR); }

double Below(const StageContext& now, Part part, bool closed, const Quaterniond& q_WE) {
  return now.shapes->Reach(part, closed, q_WE, -Vector3d::UnitZ());
}

double LowestHand(const StageContext& now, const Quaterniond& q_WE) {
  return now.shapes->FurthestReach(q_WE, -Vector3d::UnitZ()) + kAbove.finger_gap;
}

Pose AtGrasp(const StageContext& now, const Grip& grip) {
  const Quaterniond q = grip.q();
  const Vector3d a = grip.approach();
  const double top = TopOfTarget(now), ahead = now.shapes->ahead_closed();
  const double tips = top - kAbove.deepest - ahead * a.z();  // z of E with the tips that deep
  const double palm = top + kAbove.palm_gap - now.shapes->palm_ahead() * a.z();
  // the palm is beside the axis of an object that is approached at an angle
  const double above_palm = grip.pitch > kAbove.vertical ? palm : tips;
  const double z = std::max({tips, above_palm, LowestHand(now, q)});
  // pads, not their very tips, around the axis
  const Eigen::Vector2d xy = now.X_WO.p.head<2>() + (kAbove.pad_beyond - ahead) * a.head<2>();
  return {{xy.x(), xy.y(), z}, q};
}

Pose Pushing(const StageContext& now, double further) {
  const Quaterniond q = PushingHand(now);
  const double half_depth = now.shapes->object(now.target).half_extent.y();
  const double touching = now.X_WO.p.y() - half_depth - now.shapes->Reach(Part::kFingers, true, q, Vector3d::UnitY());
  return {{now.X_WO.p.x(), touching + further, PushingHeight(now, q)}, q};
}

Pose AtPlace(const StageContext& now, const Grip& grip, Whereto to) {
  ETUDE_CHECK(now.X_EO.has_value());
  const Quaterniond q = grip.q();
  const Vector3d p_EO_W = q * now.X_EO->p;
  const Vector3d place = PlaceOf(now, q, to);
  return {{place.x() - p_EO_W.x(), place.y() - p_EO_W.y(), 0}, q};
}

double PlaceHeight(const StageContext& now, const Quaterniond& q_WE, Whereto to, double gap) {
  const double on_table = std::max(HeldBelow(now, q_WE) + gap, LowestHand(now, q_WE));
  if (to == Whereto::kOnTop) return TopOfReference(now) + on_table;
  // the fingers stay above the rim: what they hold falls the rest of the way
  if (to == Whereto::kInside)
    return std::max(TopOfReference(now) + LowestHand(now, q_WE), HeldBelow(now, q_WE) + kAbove.finger_gap + gap);
  return on_table;
}

}  // namespace etude::task::above
