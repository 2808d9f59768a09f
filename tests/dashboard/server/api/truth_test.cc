// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/api/truth.cc
#include "dashboard/server/api/truth.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "services/episode/trajectory_label.h"
#include "tests/support/synthetic_episode.h"

namespace etude::api {
namespace truth_test {

constexpr int kStep = 10;

class TruthTest : public testing::Test {
 protected:
  TruthTest() {
    const ObjectTrack& target = *episode_.FindObject(episode_.target);
    p_target_ = {target.pose.row(kStep)[0], target.pose.row(kStep)[1], target.pose.row(kStep)[2]};
    const auto hand = episode_.eef_pos.row(kStep);
    p_hand_ = {hand[0], hand[1], hand[2]};
  }
  void Say(const std::string& module, const std::string& entity, const std::string& quantity, OrderedJson value) {
    insight_.modules[module] = {{"entity", entity}, {"quantity", quantity}, {"value", std::move(value)}};
  }
  OrderedJson Truth(const TruthScope& scope = {}) { return TruthJson(episode_, kStep, insight_, scope); }
  static OrderedJson List(const Eigen::Vector3d& p) { return {p.x(), p.y(), p.z()}; }

  Episode episode_ = MakeSyntheticEpisode(SyntheticSpec(), 3);
  policy::Insight insight_;
  Eigen::Vector3d p_target_, p_hand_;
};

TEST_F(TruthTest, ErrorsAreDistancesFromWhatTheRecordHolds) {
  const auto pixel = episode_.FindObject(episode_.target)->pixel.row(kStep);
  Say("LANG", "target", "class", episode_.target);
  Say("TAR2D", "target", "pixel", {pixel[0] + 3.0, pixel[1] - 4.0});
  Say("TAR3D", "target", "position", List(p_target_ + Eigen::Vector3d(0.03, 0, -0.04)));
  Say("DISP", "target", "displacement", List(p_target_ - p_hand_ + Eigen::Vector3d(0, 0.01, 0)));
  const auto truth = Truth();
  EXPECT_EQ(truth["errors"]["LANG"]["error"], 0);
  EXPECT_NEAR(truth["errors"]["TAR2D"]["error"].get<double>(), 5, 1e-4);
  EXPECT_EQ(truth["errors"]["TAR2D"]["unit"], "px");
  EXPECT_NEAR(truth["errors"]["TAR3D"]["error"].get<double>(), 0.05, 1e-6);
  EXPECT_NEAR(truth["errors"]["DISP"]["error"].get<double>(), 0.01, 1e-6);
  EXPECT_NEAR(truth["positions"]["hand"][2].get<double>(), p_hand_.z(), 1e-6);
  EXPECT_EQ(truth["pixels"].size(), episode_.objects.size() + 1);
}

TEST_F(TruthTest, APoseIsOffAndTurned) {
  OrderedJson said = List(p_hand_);
  const auto row = episode_.eef_quat.row(kStep);
  const Eigen::Quaterniond q(row[0], row[1], row[2], row[3]);
  for (const double number : ToRotation6D(q * Eigen::AngleAxisd(0.25, Eigen::Vector3d::UnitX())))
    said.push_back(number);
  Say("EE3D", "ee", "pose", said);
  const auto error = Truth()["errors"]["EE3D"];
  EXPECT_NEAR(error["error"].get<double>(), 0, 1e-6);
  EXPECT_NEAR(error["turned_rad"].get<double>(), 0.25, 1e-6);
}

TEST_F(TruthTest, ANameIsRightOrWrong) {
  Say("LANG", "target", "class", episode_.target == "coke" ? "milk" : "coke");
  EXPECT_EQ(Truth()["errors"]["LANG"]["error"], 1);
  EXPECT_EQ(Truth()["errors"]["LANG"]["truth"], episode_.target);
}

TEST_F(TruthTest, WaypointsAreThoseToImitate) {
  const TrajectoryLabel label = LabelTrajectory(episode_, kStep);
  for (int k = 0; k < kWaypoints; ++k) {
    insight_.waypoints.push_back(FromVector(label.values.data() + k * kWaypointSize));
    insight_.waypoints.back().X_WE.p.z() += 0.02;
  }
  const auto truth = Truth();
  ASSERT_EQ(truth["waypoints"].size(), static_cast<std::size_t>(kWaypoints));
  EXPECT_NEAR(truth["waypoints"][11][0].get<double>(), label.values[11 * kWaypointSize], 1e-9);
  EXPECT_NEAR(truth["waypoints_error_m"].get<double>(), 0.02, 1e-6);

  episode_.supervise[kStep + 15] = 0;
  EXPECT_LT(Truth()["waypoints"].size(), static_cast<std::size_t>(kWaypoints)) << "nobody imitates a disturbance";
}

TEST_F(TruthTest, WhatIsNotKnownHasNoError) {
  Say("TAR3D", "target", "position", List(p_target_));
  Say("EE3D", "ee", "position", List(p_hand_));
  Say("REF3D", "reference", "position", List(p_target_));
  Say("OTHERS", "others", "pixel", {1, 2});
  Say("ODD", "target", "position", "here");
  insight_.modules["CTRL"] = OrderedJson::object();
  const auto spoken = Truth();
  EXPECT_TRUE(spoken["errors"].contains("TAR3D"));
  for (const char* module : {"REF3D", "OTHERS", "ODD", "CTRL"})
    EXPECT_FALSE(spoken["errors"].contains(module)) << module;
  EXPECT_TRUE(spoken["waypoints_error_m"].is_null()) << "none are planned";

  const auto other = Truth({.as_spoken = false});
  EXPECT_FALSE(other["errors"].contains("TAR3D")) << "of another sentence the target is not known";
  EXPECT_TRUE(other["errors"].contains("EE3D"));
  EXPECT_TRUE(other["waypoints"].empty());
  EXPECT_TRUE(Truth({.demonstrated = false})["waypoints"].empty()) << "a policy's own commands";
}

TEST_F(TruthTest, ARecordWithoutTracksHasNone) {
  episode_.eef_quat = {};
  episode_.actions_abs = {};
  for (auto& object : episode_.objects) object.pose = {};
  Say("TAR3D", "target", "position", {0, 0, 0});
  const auto truth = Truth();
  EXPECT_TRUE(truth["positions"].empty());
  EXPECT_TRUE(truth["errors"].empty());
  EXPECT_TRUE(truth["waypoints"].empty());
}

}  // namespace truth_test
}  // namespace etude::api
