// SPDX-License-Identifier: Apache-2.0
// The numbers of the primitives that were tuned, in one table: metres and radians. What follows from a hand or an
// object is not here but measured by SceneGeometry (reach of fingers and palm, extents, heights). Internal to
// worker/task.
#pragma once

namespace etude::task {

/// Of a level hand that comes from the side (UR5), objects standing between it and the camera.
struct SideTuning {
  // Fingertips behind the object's axis before it reaches. Further back, the wrist of an arm that reaches for a near
  // object comes too close to the shoulder's axis.
  double behind = 0.085;
  double nearest = 0.065;          // the least of it when the hand is already on the line
  double on_line = 0.04;           // off the line at most to count as on it
  double grasp_above = 0.01;       // above the body's origin
  double lowest_hand = 0.058;      // of the level hand: its wrist needs 0.05
  double pad_half_length = 0.018;  // fingertips pass the object's axis by this,
  double pad_least = 0.010;        // at least by this,
  double far_side = 0.006;         // and stay this short of its far side
  double lift_height = 0.15;       // of the tool
  double turn_back = 0.15;         // towards the robot while turning
  double turned_reach = 0.56;      // from the base's axis that the hand can point down
  // Objects are pushed low so that they slide instead of tipping over: the tips just above the table, the hand tilted
  // so that its wrist stays clear.
  double push_height = 0.019;  // of the tool
  double push_tilt = 0.25;
  double finger_gap = 0.005;  // between fingertips and table
};

/// Of a hand that comes from above, pitched down (Panda, Jaco2; the UR5 where it carries).
struct AboveTuning {
  double deepest = 0.065;        // that the fingertips go below the object's top
  double palm_gap = 0.006;       // between palm and object
  double finger_gap = 0.010;     // between fingertips and table
  double hover = 0.03;           // between open fingertips and the object's top before the grasp
  double hover_slack = 0.02;     // nearer when the hand is already on the line
  double least_back = 0.05;      // back from the grasp at least
  double on_line = 0.04;         // off the line at most to count as on it
  double push_pitch = 1.35;      // fingertips first
  double push_leaning = 1.25;    // where the palm would be ahead: no further, for reach
  double push_height = 0.010;    // between fingertips and table
  double push_highest = 0.6;     // of the object's height, for the fingertips of a hand that cannot lean
  double push_behind = 0.035;    // between fingertips and object before the push
  double vertical = 1.4;         // pitch from which on the hand counts as pointing straight down
  double tall = 0.12;            // of an object from which on a hand that holds it is above the others
  double pad_beyond = 0.014;     // that the fingertips pass the object's axis
  double turned_below = 0.10;    // under an object while it is turned
  double turned_reach = 0.50;    // from the base's axis at least, for a hand that points away
  double turn_back = 0.12;       // towards the robot while turning
  double hand_gap = 0.015;       // between the open hand and the reference beside it
  double beside = 0.12;          // of the target left or right of the reference, at least
  double beside_most = 0.165;    // and at most
  double before = 0.16;          // of the target before or behind it: a hand fits between
  double carry_pitch = 1.05;     // at least, where something is carried: objects are set down from above
  double over_reference = 0.05;  // under the target above what it is put on or into
};

/// Of all hands.
struct StageTuning {
  double avoid_clearance = 0.05;  // wished from what is to be avoided
  double planned_speed = 0.92;    // of a joint's speed limit: what follows a motion is up to 6 % faster than planned
};

inline constexpr SideTuning kSide;
inline constexpr AboveTuning kAbove;
inline constexpr StageTuning kStages;

}  // namespace etude::task
