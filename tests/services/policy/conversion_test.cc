// SPDX-License-Identifier: Apache-2.0
// Tests services/policy/conversion.cc
#include "services/policy/conversion.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "services/core/rng.h"
#include "services/episode/action.h"

namespace etude::policy {
namespace conversion_test {

constexpr std::size_t kNumbers = static_cast<std::size_t>(kWaypoints) * kWaypointSize;

TEST(ObservationOf, HasThePictureAndTheJoints) {
  const std::vector<std::uint8_t> picture{1, 2, 3, 4, 5, 6};
  Question question;
  question.instruction = "push the can";
  question.joints = {0.5f, -1.5f};
  question.width = 2, question.height = 1;
  question.rgb = picture;
  question.robot = "ur5";
  const bus::Observation observation = ObservationOf(question);
  EXPECT_EQ(observation.instruction, "push the can");
  EXPECT_EQ(observation.joints, question.joints);
  EXPECT_EQ(observation.width, 2u);
  EXPECT_EQ(observation.height, 1u);
  EXPECT_EQ(std::vector<std::uint8_t>(observation.image.begin(), observation.image.end()), picture);
  EXPECT_EQ(observation.robot, "ur5");
  EXPECT_TRUE(observation.intrinsics.empty()) << "no camera was said";
  EXPECT_TRUE(observation.camera_pose.empty());
}

// a pinhole camera by the numbers that are sent sees each point where Camera::Project puts it
TEST(ObservationOf, ItsCameraIsThePinholeThatTookThePicture) {
  Rng rng(1);
  for (int trial = 0; trial < 50; ++trial) {
    Camera camera;
    camera.width = 320, camera.height = 200;
    camera.fovy = rng.Uniform(0.4, 1.6);
    camera.X_WC.p = {rng.Normal(), rng.Normal(), rng.Normal()};
    camera.X_WC.q = Eigen::Quaterniond(rng.Normal(), rng.Normal(), rng.Normal(), rng.Normal()).normalized();
    Question question;
    question.camera = camera;
    const bus::Observation sent = ObservationOf(question);
    ASSERT_EQ(sent.intrinsics.size(), 4u);
    ASSERT_EQ(sent.camera_pose.size(), 7u);
    const auto at = [&](std::size_t i) { return static_cast<double>(sent.camera_pose[i]); };
    const Pose X_WC{{at(0), at(1), at(2)}, Eigen::Quaterniond(at(3), at(4), at(5), at(6)).normalized()};
    const Eigen::Vector3d p_C(rng.Uniform(-1, 1), rng.Uniform(-1, 1), rng.Uniform(-3, -1));  // it looks along -z
    const double fx = sent.intrinsics[0], fy = sent.intrinsics[1], cx = sent.intrinsics[2], cy = sent.intrinsics[3];
    const Eigen::Vector2d pinhole(cx + fx * p_C.x() / -p_C.z(), cy - fy * p_C.y() / -p_C.z());
    EXPECT_LT((camera.Project(X_WC * p_C) - pinhole).norm(), 1e-2) << trial;
  }
}

TEST(AreWaypoints, AreAsManyNumbersAsThereMustBeAllOfThemFinite) {
  std::vector<float> numbers(kNumbers, 0.5f);
  EXPECT_TRUE(AreWaypoints(numbers));
  EXPECT_FALSE(AreWaypoints({}));
  EXPECT_FALSE(AreWaypoints(std::span(numbers).first(kNumbers - 1)));
  for (const float bad :
       {std::nanf(""), std::numeric_limits<float>::infinity(), -std::numeric_limits<float>::infinity()})
    for (const std::size_t i : {std::size_t{0}, kNumbers / 2, kNumbers - 1}) {
      numbers[i] = bad;
      EXPECT_FALSE(AreWaypoints(numbers)) << i;
      numbers[i] = 0.5f;
    }
  numbers.push_back(0.5f);
  EXPECT_FALSE(AreWaypoints(numbers));
}

TEST(WaypointsOf, AreThoseThatWereWritten) {
  Rng rng(2);
  std::vector<Waypoint> waypoints;
  std::vector<float> numbers;
  for (int k = 0; k < kWaypoints; ++k) {
    Waypoint waypoint{{{rng.Normal(), rng.Normal(), rng.Normal()},
                       Eigen::Quaterniond(rng.Normal(), rng.Normal(), rng.Normal(), rng.Normal()).normalized()},
                      static_cast<double>(k % 2)};
    const auto row = ToVector(waypoint);
    numbers.insert(numbers.end(), row.begin(), row.end());
    waypoints.push_back(waypoint);
  }
  ASSERT_TRUE(AreWaypoints(numbers));
  const auto read = WaypointsOf(numbers);
  ASSERT_EQ(read.size(), waypoints.size());
  for (std::size_t k = 0; k < read.size(); ++k) {
    EXPECT_LT((read[k].X_WE.p - waypoints[k].X_WE.p).norm(), 1e-6) << k;
    EXPECT_LT(AngleBetween(read[k].X_WE.q, waypoints[k].X_WE.q), 1e-3) << k;
    EXPECT_EQ(read[k].gripper, waypoints[k].gripper) << k;
  }
}

TEST(QuestionAt, IsWhatWasSeenAndWantedAtThatStep) {
  Episode episode;
  episode.instruction = "pick up the can";
  episode.robot = "panda";
  episode.joint_pos = {2, {0, 1, 2, 3, 4, 5}};
  episode.gripper_qpos = {1, {10, 11, 12}};
  episode.eef_pos = {3, std::vector<float>(9)};
  episode.cameras.emplace_back().camera.width = 8;
  episode.cameras[0].camera.height = 4;
  const std::vector<std::uint8_t> rgb(96, 7);
  const Question question = QuestionAt(episode, 1, rgb);
  EXPECT_EQ(question.joints, (std::vector<float>{2, 3, 11})) << "the arm's joints, then the gripper's";
  EXPECT_EQ(question.instruction, "pick up the can");
  EXPECT_EQ(question.robot, "panda");
  EXPECT_EQ(question.width, 8);
  EXPECT_EQ(question.height, 4);
  EXPECT_EQ(question.rgb.data(), rgb.data());
}

}  // namespace conversion_test
}  // namespace etude::policy
