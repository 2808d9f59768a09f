// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/target_pushes.cc in rollouts of a policy that stays away, and of one that comes near.
#include "worker/task/target_pushes.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>

#include "services/episode/codec.h"
#include "tests/worker/task/rollout_spec.h"
#include "worker/task/attempt.h"

namespace etude::task {
namespace target_pushes_test {

CampaignSpec Pushing(const std::string& task, int count) {
  CampaignSpec spec = CheapRollout(task, "still");
  spec.rollout.replan_steps = 15;
  spec.rollout.max_steps = 160;
  spec.rollout.record = false;
  spec.rollout.pushes.count = count;
  return spec;
}

policy::Answer Go(const Eigen::Vector3d& p) {
  policy::Answer answer;
  answer.waypoints.assign(kWaypoints, Waypoint{{p, FromEuler({3.14, 0, 1.57})}, 0});
  return answer;
}

Episode RollOut(const CampaignSpec& spec, std::uint64_t index, const Eigen::Vector3d& p = {-0.11, 0.13, 0.2}) {
  auto runner = AttemptRunner::Open(spec);
  EXPECT_TRUE(runner) << runner.error().message;
  auto rollout = runner->Rollout(index, [&](const policy::Question&) { return Go(p); });
  EXPECT_TRUE(rollout) << rollout.error().message;
  return std::move(rollout->episode);
}

Eigen::Vector3d At(const Track& pose, int step) { return {pose.row(step)[0], pose.row(step)[1], pose.row(step)[2]}; }

bool InABox(const Eigen::Vector3d& p) {
  return std::ranges::any_of(LocationBoxes(), [&](const LocationBox& box) {
    return p.x() > box.x_min - 1e-3 && p.x() < box.x_max + 1e-3 && p.y() > box.y_min - 1e-3 && p.y() < box.y_max + 1e-3;
  });
}

TEST(TargetPushes, SlideTheTargetToAnotherPlaceWhereItMayStand) {
  const CampaignSpec spec = Pushing("pick", 2);
  int made = 0;
  for (std::uint64_t index = 0; index < 12; ++index) {
    const Episode episode = RollOut(spec, index);
    const Track& pose = episode.FindObject(episode.target)->pose;
    const auto& pushes = episode.details["pushes"];
    EXPECT_EQ(pushes.size() + episode.details["pushes_missed"].get<std::size_t>(), 2u);
    for (const auto& push : pushes) {
      ++made;
      const int first = push["step"].get<int>(), last = first + push["steps"].get<int>();
      EXPECT_GE(first, spec.rollout.pushes.earliest);
      EXPECT_LE(first, spec.rollout.pushes.latest);
      EXPECT_EQ(push["steps"], kTargetPushSteps);
      const Eigen::Vector3d from = At(pose, first), to = At(pose, last), later = At(pose, last + 5);
      EXPECT_NEAR(from.x(), push["from"][0].get<double>(), 1e-6);
      EXPECT_NEAR(to.x(), push["to"][0].get<double>(), 1e-3);
      EXPECT_GT((to - from).norm(), spec.rollout.pushes.least - 1e-3) << episode.target;
      EXPECT_LT((to - from).norm(), spec.rollout.pushes.most + 1e-3) << episode.target;
      EXPECT_NEAR(to.z(), from.z(), 2e-3) << "on the table";
      EXPECT_LT((later - to).norm(), 5e-3) << "it stands where it came to";
      EXPECT_TRUE(InABox(to)) << to.transpose();
      for (const auto& other : episode.objects) {
        if (other.name == episode.target) continue;
        EXPECT_LT((At(other.pose, last) - At(other.pose, 0)).norm(), 2e-3) << other.name << " stays";
        EXPECT_GT((At(other.pose, last) - to).head<2>().norm(), kMinimumDistance - 2e-3) << other.name;
      }
    }
    const auto quaternion = [&](int t) {
      return Eigen::Quaterniond(pose.row(t)[3], pose.row(t)[4], pose.row(t)[5], pose.row(t)[6]);
    };
    EXPECT_LT(AngleBetween(quaternion(0), quaternion(episode.steps() - 1)), 0.05) << episode.target << " is upright";
  }
  EXPECT_GE(made, 18) << "of 24";
}

TEST(TargetPushes, DoNothingUntilTheyBeginAndDependOnTheEpisodeOnly) {
  const CampaignSpec pushed = Pushing("pick", 1), plain = Pushing("pick", 0);
  const Episode with = RollOut(pushed, 3), again = RollOut(pushed, 3), without = RollOut(plain, 3);
  EXPECT_EQ(EncodeEpisode(with), EncodeEpisode(again));
  EXPECT_FALSE(without.details.contains("pushes"));
  ASSERT_EQ(with.details["pushes"].size(), 1u);
  const int first = with.details["pushes"][0]["step"].get<int>();
  for (int t = 0; t <= first; ++t)
    ASSERT_TRUE(std::ranges::equal(with.states.row(t), without.states.row(t))) << "the same rollout until " << t;
  EXPECT_FALSE(std::ranges::equal(with.states.row(first + 5), without.states.row(first + 5)));
}

TEST(TargetPushes, CountForNoTask) {
  // up to 15 cm in one direction is what `push` asks for, if the robot does it
  CampaignSpec spec = Pushing("push", 4);
  spec.rollout.pushes.least = 0.045;
  spec.rollout.pushes.earliest = 0;
  bool forward = false;
  for (std::uint64_t index = 0; index < 8; ++index) {
    const Episode episode = RollOut(spec, index);
    const Track& pose = episode.FindObject(episode.target)->pose;
    for (int t = 0; t < episode.steps(); ++t) forward = forward || At(pose, t).y() > At(pose, 0).y() + 0.035;
    EXPECT_EQ(episode.details["success_latched"], false) << "nobody but the wind pushed " << episode.target;
    EXPECT_FALSE(episode.success);
  }
  EXPECT_TRUE(forward) << "or the test says nothing";
}

TEST(TargetPushes, AreMissedOnceTheRobotHasTouchedTheTarget) {
  CampaignSpec spec = Pushing("pick", 3);
  spec.rollout.pushes.earliest = 120;
  spec.rollout.pushes.latest = 150;
  const Episode still = RollOut(Pushing("pick", 0), 1);
  // a finger comes down where the target stands, not on either side of it
  const Eigen::Vector3d place = At(still.FindObject(still.target)->pose, 0) + Eigen::Vector3d(0.04, 0, 0);
  const Episode episode = RollOut(spec, 1, place);  // straight into it
  ASSERT_EQ(episode.details["decisions"].back()["touched"], true) << "or the test says nothing";
  EXPECT_TRUE(episode.details["pushes"].empty());
  EXPECT_EQ(episode.details["pushes_missed"], 3);
}

}  // namespace target_pushes_test
}  // namespace etude::task
