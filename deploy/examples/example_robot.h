// SPDX-License-Identifier: Apache-2.0
// Stands in for a robot and its camera: goes where it is told and sees a grey table. Replace each function by a call
// of your robot's own interface.
#pragma once

#include <vector>

#include "services/policy/policy_types.h"

class ExampleRobot {
 public:
  /// What the policy is to know: the picture must have the size, and the joints the number, that it was trained with.
  etude::policy::Question Look(const char* instruction) const {
    etude::policy::Question question;
    question.instruction = instruction;
    question.joints = joints_;
    question.width = question.height = kSide;
    question.rgb = picture_;
    question.robot = "ur5";  // a policy of another robot refuses to answer
    // Say question.camera, too, once yours is calibrated (services/episode/camera.h): a policy that was trained with
    // another view (etude checkpoint show) then refuses, which here it cannot.
    return question;
  }
  /// Moves the hand; call it once a control step (8 ms).
  void Command(const etude::Waypoint& waypoint) { hand_ = waypoint; }
  /// Stands still where it is: a position controller does so by itself, a velocity controller must be told.
  void Hold() {}
  const etude::Waypoint& hand() const { return hand_; }

 private:
  static constexpr int kSide = 224;  // px
  std::vector<float> joints_ = std::vector<float>(7, 0.F);
  std::vector<std::uint8_t> picture_ = std::vector<std::uint8_t>(3 * kSide * kSide, 128);
  etude::Waypoint hand_{{{0.0, 0.3, 0.2}, Eigen::Quaterniond::Identity()}, 0.0};
};
