// SPDX-License-Identifier: Apache-2.0
// The numbers of the primitives that were tuned, in one table: metres and radians. Internal to worker/task.
//
// Derived, and so not here (SceneGeometry measures it): how far fingers and palm reach beyond the tool in any
// direction, open and closed; sizes, tops and heights of objects however they are turned; from these the places of a
// grasp, of a touch, of a hand that is just off the table; pitches, base and speed of the arm.
//
// Tuned, each for a reason that is beside it:
//   [hand]   a hand's shape bounds it. Found with the hands that come along; the first to look at for another one
//   [arm]    an arm's reach, or the room of its wrist, bounds it
//   [object] friction and shape of the objects bound it: what tips over, jams or slips
//   [judge]  what counts as success bounds it (worker/task/predicates)
//   [margin] room for the error of control, or of a place that was seen
// None of them is what its bound gives to the last digit (the UR5's pads are 18.75 mm long from their middle, not 18),
// and every episode that was collected depends on each: a formula in the place of one is another content version.
#pragma once

namespace etude::task {

/// Of a level hand that comes from the side (UR5), objects standing between it and the camera.
struct SideTuning {
  // [arm] Fingertips behind the object's axis before it reaches. Further back, the wrist of an arm that reaches for a
  // near object comes too close to the shoulder's axis.
  double behind = 0.085;
  double nearest = 0.065;          // [object] the least of it when the hand is already on the line
  double grasp_above = 0.01;       // [object] above the body's origin
  double lowest_hand = 0.058;      // [hand] of the level hand: its wrist needs 0.05
  double pad_half_length = 0.018;  // [hand] fingertips pass the object's axis by this: pads centred on it,
  double pad_least = 0.010;        // [object] at least by this,
  double far_side = 0.006;         // [object] and stay this short of its far side: laid down, it meets the table first
  double lift_height = 0.15;       // [judge] of the tool: over 0.10 m for every object
  double lift_room = 0.05;         // [judge] under what is held at least, where that is taller
  double turn_back = 0.15;         // [arm] towards the robot while turning
  double turned_reach = 0.56;      // [arm] from the base's axis that the hand can point down
  // [object] Objects are pushed low so that they slide instead of tipping over: the tips just above the table, the hand
  // tilted so that its wrist stays clear [hand].
  double push_height = 0.019;  // of the tool
  double push_tilt = 0.25;
  double finger_gap = 0.005;  // [margin] between fingertips and table
  double push_room = 0.015;   // [margin] between closed fingertips and a deep object before the push
};

/// Of a hand that comes from above, pitched down (Panda, Jaco2; the UR5 where it carries).
struct AboveTuning {
  double deepest = 0.065;        // [hand] that the fingertips go below the object's top
  double palm_gap = 0.006;       // [margin] between palm and object
  double finger_gap = 0.010;     // [margin] between fingertips and table
  double hover = 0.03;           // [margin] between open fingertips and the object's top before the grasp
  double hover_slack = 0.02;     // [margin] nearer when the hand is already on the line
  double least_back = 0.05;      // [margin] back from the grasp at least
  double push_pitch = 1.35;      // [hand] fingertips first
  double push_leaning = 1.25;    // [arm] where the palm would be ahead: no further, for reach
  double push_height = 0.010;    // [object] between fingertips and table: low, so that nothing tips over
  double push_highest = 0.6;     // [object] of the object's height, for the fingertips of a hand that cannot lean
  double push_behind = 0.035;    // [margin] between fingertips and object before the push
  double vertical = 1.4;         // [hand] pitch from which on the palm is over the object's axis, not beside it
  double tall = 0.12;            // [object] from which height on a hand that holds it is above the others
  double pad_beyond = 0.014;     // [hand] that the fingertips pass the object's axis
  double turned_below = 0.10;    // [hand] under an object while it is turned
  double turned_reach = 0.50;    // [arm] from the base's axis at least, for a hand that points away
  double turn_back = 0.12;       // [arm] towards the robot while turning
  double hand_gap = 0.015;       // [margin] between the open hand and the reference beside it
  double beside = 0.12;          // [judge] of the target left or right of the reference: the middle of what counts,
  double beside_most = 0.165;    // [judge] and at most so far, well within it, for a hand that is wide
  double before = 0.16;          // [hand] of the target before or behind it: a hand fits between
  double carry_pitch = 1.05;     // [object] at least, where something is carried: it is set down from above
  double over_reference = 0.05;  // [margin] under the target above what it is put on or into
};

/// Of all hands.
struct StageTuning {
  double on_line = 0.04;        // [margin] off the line of an approach at most to count as on it
  double held_back = 0.03;      // [object] that friction of what is pushed may keep a soft arm from the push's goal
  double planned_speed = 0.92;  // of a joint's speed limit: what follows a motion is up to 6 % faster than planned
};

inline constexpr SideTuning kSide;
inline constexpr AboveTuning kAbove;
inline constexpr StageTuning kStages;

}  // namespace etude::task
