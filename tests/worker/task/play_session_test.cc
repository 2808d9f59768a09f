// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/play_session.cc, play_moves.cc, play_home.cc and play_scene.cc in real scenes, with scripted
// policies.
#include "worker/task/play_session.h"

#include <gmock/gmock.h>

#include "tests/support/matchers.h"
#include "tests/worker/task/playback.h"
#include "tests/worker/task/rollout_spec.h"
#include "worker/task/attempt.h"

namespace etude::task {
namespace play_session_test {

using testing::HasSubstr;

CampaignSpec SpecOf(const std::string& task) {
  CampaignSpec spec = CheapRollout(task, "oracle");
  spec.randomization.disturbance_probability = 0;
  spec.rollout.max_steps = 900;
  return spec;
}

// Wants the hand where it is.
policy::AskFunction Still(const PlaySession& session) {
  return [&session](const policy::Question&) -> Result<policy::Answer> {
    policy::Answer answer;
    answer.waypoints.assign(kWaypoints, Waypoint{session.world().X_WE(), 0});
    return answer;
  };
}

std::unique_ptr<PlaySession> Open(const CampaignSpec& spec, std::uint64_t index = 0) {
  auto session = PlaySession::Open(spec, index);
  EXPECT_TRUE(session) << session.error().message;
  return std::move(*session);
}

std::vector<std::uint8_t> PictureOf(PlaySession& session) {
  const auto picture = session.Picture();
  return {picture.begin(), picture.end()};
}

Eigen::Vector3d Place(const PlaySession& session, const std::string& object) {
  return session.world().ObjectPose(object).p;
}

Sentence SentenceOf(const EpisodePlan& plan, int max_steps = 0) {
  return {.text = "do it",
          .task = plan.task.text(),
          .target = plan.target,
          .reference = plan.reference,
          .max_steps = max_steps};
}

// Where the object of the scene has the most room, so that it may be nudged.
const char* const kTask = "push";

TEST(PlaySession, ASentenceInAFreshSceneIsTheRolloutThatAnEvaluationMakes) {
  const CampaignSpec spec = SpecOf("pick");
  auto runner = AttemptRunner::Open(spec);
  ASSERT_TRUE(runner);
  const auto demonstration = runner->Demonstrate(0, 0).value();
  ASSERT_EQ(demonstration.outcome, AttemptOutcome::kSuccess) << demonstration.reason;
  const auto rollout = runner->Rollout(0, Playback(demonstration.episode, spec.rollout.replan_steps));
  ASSERT_TRUE(rollout);
  auto session = Open(spec);
  int hooked = 0;
  const auto verdict =
      session->Say(SentenceOf(session->plan()), Playback(demonstration.episode, spec.rollout.replan_steps), [&] {
        ++hooked;
        return true;
      });
  ASSERT_TRUE(verdict) << verdict.error().message;
  EXPECT_EQ(verdict->outcome, rollout->outcome);
  EXPECT_EQ(session->step(), rollout->episode.steps());
  EXPECT_GE(hooked, session->step());
  const OrderedJson judge = session->JudgeJson();
  EXPECT_EQ(judge["done"], rollout->outcome == AttemptOutcome::kSuccess);
  EXPECT_FALSE(session->answer().waypoints.empty());
}

// Episode 0 as the expert demonstrates it.
Episode DemonstrationOf(const CampaignSpec& spec) {
  auto runner = AttemptRunner::Open(spec);
  EXPECT_TRUE(runner) << runner.error().message;
  auto demonstration = runner->Demonstrate(0, 0).value();
  EXPECT_EQ(demonstration.outcome, AttemptOutcome::kSuccess) << demonstration.reason;
  return std::move(demonstration.episode);
}

TEST(PlaySession, GoesOnInTheSameSceneAndComesHomeFirst) {
  const CampaignSpec spec = SpecOf("pick");
  auto session = Open(spec);
  const Episode demonstration = DemonstrationOf(spec);
  const Playback playback(demonstration, spec.rollout.replan_steps);
  const Pose home = session->world().X_WE();
  ASSERT_TRUE(session->Say(SentenceOf(session->plan()), playback, nullptr));
  ASSERT_GT((session->world().X_WE().p - home.p).norm(), 0.05);
  bool homing = false;
  const auto second = session->Say(SentenceOf(session->plan(), 5), Still(*session), [&] {
    homing = homing || std::string(session->doing()) == "homing";
    return true;
  });
  ASSERT_TRUE(second) << second.error().message;
  EXPECT_EQ(second->outcome, AttemptOutcome::kTimeout);
  EXPECT_TRUE(homing);
  EXPECT_LT((session->world().X_WE().p - home.p).norm(), 0.05);
}

// Wants what is held over a place, higher than it is now and turned as it is.
policy::AskFunction Over(const PlaySession& session, const Eigen::Vector3d& place) {
  return [&session, place, now = session.world().X_WE()](const policy::Question&) -> Result<policy::Answer> {
    const Eigen::Vector3d object = Place(session, session.plan().target);
    Eigen::Vector3d by(place.x() - object.x(), place.y() - object.y(), 0);
    constexpr double kFarthest = 0.03, kHigher = 0.08;  // m, in one answer; m
    if (by.norm() > kFarthest) by *= kFarthest / by.norm();
    Pose X_WE = now;
    X_WE.p.z() += kHigher;
    X_WE.p.head<2>() = (session.world().X_WE().p + by).head<2>();
    policy::Answer answer;
    answer.waypoints.assign(kWaypoints, Waypoint{X_WE, 1});
    return answer;
  };
}

TEST(PlaySession, OnTheWayHomeWhatIsHeldIsNotPressedOntoWhatStandsUnderIt) {
  const CampaignSpec spec = SpecOf("pick");
  auto session = Open(spec);
  const Episode demonstration = DemonstrationOf(spec);
  const Playback playback(demonstration, spec.rollout.replan_steps);
  // lower than a hand lifts
  const std::string target = session->plan().target, other = target == "bread" ? "cube" : "bread";
  ASSERT_TRUE(session->Say(SentenceOf(session->plan()), playback, nullptr));
  ASSERT_TRUE(session->world().Grasped(target));
  // judged by nobody, who would say that it is done as it begins
  const Sentence over{.text = "over there", .max_steps = 900, .home = false};
  ASSERT_TRUE(session->Say(over, Over(*session, Place(*session, other)), nullptr));
  ASSERT_LT((Place(*session, target) - Place(*session, other)).head<2>().norm(), 0.02);
  ASSERT_TRUE(session->world().Grasped(target));

  // how far it is pushed through the fingers
  const auto in_hand = [&] { return session->world().X_WE().p.z() - Place(*session, target).z(); };
  const double held = in_hand();
  double slipped = 0;
  ASSERT_TRUE(session->Say(SentenceOf(session->plan(), 5), Still(*session), [&] {
    if (std::string(session->doing()) == "homing" && session->world().Grasped(target))
      slipped = std::max(slipped, std::abs(in_hand() - held));
    return true;
  }));

  EXPECT_LT(slipped, 0.01);
  EXPECT_FALSE(session->world().Grasped(target));
}

TEST(PlaySession, PutsObjectsWhereTheyAreWanted) {
  auto session = Open(SpecOf(kTask));
  const Status set = session->SetScene(0, {{"coke", -0.5, 0.6, 0.2}});
  ASSERT_TRUE(set) << set.error().message;
  EXPECT_NEAR(Place(*session, "coke").x(), -0.5, 0.01);
  EXPECT_NEAR(Place(*session, "coke").y(), 0.6, 0.01);
}

// Three objects of the scene: the one that is its episode's, and two others.
struct Cast {
  std::string target, placed, hidden;
};

Cast CastOf(const PlaySession& session) {
  const std::string target = session.plan().target;
  if (target == "coke") return {target, "milk", "bread"};
  return {target, "coke", target == "milk" ? "bread" : "milk"};
}

TEST(PlaySession, PlacingAnObjectLeavesAllOthersAsTheyAre) {
  auto session = Open(SpecOf(kTask));
  const Cast cast = CastOf(*session);
  const Eigen::Vector3d first = Place(*session, cast.target);
  ASSERT_TRUE(session->Nudge(cast.target, 0, 0.05));
  ASSERT_TRUE(session->Hide(cast.hidden));
  const Eigen::Vector3d pushed = Place(*session, cast.target);
  ASSERT_GT((pushed - first).norm(), 0.03);

  const Status placed = session->Place({{cast.placed, -0.5, 0.6, 0.2}});

  ASSERT_TRUE(placed) << placed.error().message;
  EXPECT_LT((Place(*session, cast.placed).head<2>() - Eigen::Vector2d(-0.5, 0.6)).norm(), 0.01);
  EXPECT_LT((Place(*session, cast.target) - pushed).norm(), 0.002);
  EXPECT_TRUE(session->hidden(cast.hidden));
  ASSERT_TRUE(session->Reset());
  EXPECT_LT((Place(*session, cast.placed).head<2>() - Eigen::Vector2d(-0.5, 0.6)).norm(), 0.01) << "it was put there";
  EXPECT_LT((Place(*session, cast.target) - first).norm(), 0.01);
  EXPECT_FALSE(session->hidden(cast.hidden));
}

TEST(PlaySession, RefusesToPlaceWhereThereIsNoRoomAndMovesNothing) {
  auto session = Open(SpecOf(kTask));
  const Cast cast = CastOf(*session);
  ASSERT_TRUE(session->Nudge(cast.target, 0, 0.05));
  ASSERT_TRUE(session->Hide(cast.hidden));
  const auto before = PictureOf(*session);
  const Eigen::Vector3d at = Place(*session, cast.target);
  const auto code = [&](const ObjectPlace& place) { return session->Place({place}).error().code; };
  EXPECT_EQ(code({cast.placed, at.x(), at.y(), 0}), Code::kInvalidArgument) << "where the target is now";
  EXPECT_EQ(code({cast.placed, 2, 0.5, 0}), Code::kInvalidArgument);
  EXPECT_EQ(code({"duck", -0.5, 0.6, 0}), Code::kInvalidArgument);
  EXPECT_EQ(code({cast.hidden, -0.5, 0.6, 0}), Code::kUnavailable);
  EXPECT_EQ(PictureOf(*session), before);
}

TEST(PlaySession, ResetsToTheEpisodesSceneWhereWhatWasPlacedHasNoRoomInIt) {
  auto session = Open(SpecOf(kTask));
  const auto first = PictureOf(*session);
  const Cast cast = CastOf(*session);
  const Eigen::Vector3d at = Place(*session, cast.target);
  ASSERT_TRUE(session->Hide(cast.target));
  const Status placed = session->Place({{cast.placed, at.x(), at.y(), 0}});
  ASSERT_TRUE(placed) << placed.error().message;
  ASSERT_TRUE(session->Reset());
  EXPECT_EQ(PictureOf(*session), first);
}

TEST(PlaySession, SaysWhyAnObjectCannotStandThereAndKeepsTheScene) {
  auto session = Open(SpecOf(kTask));
  const auto before = PictureOf(*session);
  const Eigen::Vector3d milk = Place(*session, "milk");
  const auto refuse = [&](const std::vector<ObjectPlace>& places, const char* why) {
    const Status set = session->SetScene(0, places);
    ASSERT_FALSE(set);
    EXPECT_EQ(set.error().code, Code::kInvalidArgument);
    EXPECT_THAT(set.error().message, HasSubstr(why));
    EXPECT_EQ(PictureOf(*session), before);
  };
  refuse({{"coke", 2, 0.5, 0}}, "not on the table");
  refuse({{"coke", milk.x(), milk.y(), 0}}, "in one place");
  refuse({{"cok", 0, 0.5, 0}}, "coke");
  refuse({{"coke", NAN, 0.5, 0}}, "not finite");
}

TEST(PlaySession, StopsWhereTheHookSays) {
  auto session = Open(SpecOf(kTask));
  int steps = 0;
  const auto verdict = session->Say(SentenceOf(session->plan()), Still(*session), [&] { return ++steps <= 10; });
  ASSERT_TRUE(verdict);
  EXPECT_EQ(verdict->outcome, AttemptOutcome::kStopped);
  EXPECT_EQ(session->step(), 10);
}

TEST(PlaySession, NudgesWithoutTheJudgeTakingItForTheRobot) {
  auto session = Open(SpecOf(kTask));
  const std::string target = session->plan().target;
  const Eigen::Vector3d before = Place(*session, target);
  int steps = 0;
  bool nudged = false;
  const auto verdict = session->Say(SentenceOf(session->plan(), 250), Still(*session), [&] {
    // more than the three centimetres that a push takes
    if (++steps == 20) nudged = session->Nudge(target, 0, 0.05).has_value();
    return true;
  });
  ASSERT_TRUE(verdict);
  ASSERT_TRUE(nudged);
  EXPECT_NEAR(Place(*session, target).y() - before.y(), 0.05, 0.015);
  EXPECT_EQ(verdict->outcome, AttemptOutcome::kTimeout) << verdict->reason;
}

// also of what nobody spoke of: a person's hand is no robot's
TEST(PlaySession, WhatAPersonMovesIsNotDisturbedByTheRobot) {
  auto session = Open(SpecOf(kTask));
  std::string other;
  for (const auto& object : session->plan().scene.objects)
    if (object != session->plan().target) other = object;
  int steps = 0;
  bool nudged = false;
  const auto verdict = session->Say(SentenceOf(session->plan(), 250), Still(*session), [&] {
    if (++steps == 20)
      for (const double dx : {0.06, -0.06})
        for (const double dy : {0.0, 0.06, -0.06})
          if (!nudged) nudged = session->Nudge(other, dx, dy).has_value();
    return true;
  });
  ASSERT_TRUE(verdict);
  ASSERT_TRUE(nudged);
  EXPECT_TRUE(session->JudgeJson()["disturbed"].empty()) << session->JudgeJson().dump();
}

TEST(PlaySession, ANudgeThatWasAcceptedArrivesAfterTheSentence) {
  auto session = Open(SpecOf(kTask));
  const std::string target = session->plan().target;
  const Eigen::Vector3d before = Place(*session, target);
  int steps = 0;
  bool nudged = false;
  ASSERT_TRUE(session->Say(SentenceOf(session->plan(), 30), Still(*session), [&] {
    if (++steps == 25) nudged = session->Nudge(target, 0, 0.05).has_value();
    return true;
  }));
  ASSERT_TRUE(nudged);
  EXPECT_NEAR(Place(*session, target).y() - before.y(), 0.05, 0.015);
}

TEST(PlaySession, AsksThePolicyToTheSentencesEndWhateverTheCampaignGives) {
  CampaignSpec spec = SpecOf(kTask);
  spec.rollout.max_steps = 5;
  auto session = Open(spec);
  int asked = 0;
  const auto still = Still(*session);
  const auto count = [&](const policy::Question& question) {
    ++asked;
    return still(question);
  };
  ASSERT_TRUE(session->Say(SentenceOf(session->plan(), 4 * spec.rollout.replan_steps), count, nullptr));
  EXPECT_GE(asked, 3);
  EXPECT_FALSE(session->Check(SentenceOf(session->plan(), kMostSentenceSteps + 1)));
}

TEST(PlaySession, NudgesAtRestAndRefusesWhatCannotBe) {
  auto session = Open(SpecOf(kTask));
  ASSERT_TRUE(session->SetScene(0, {{"coke", -0.5, 0.6, 0}}));
  const Eigen::Vector3d before = Place(*session, "coke");
  ASSERT_TRUE(session->Nudge("coke", -0.03, 0));
  EXPECT_NEAR(Place(*session, "coke").x() - before.x(), -0.03, 0.005);
  EXPECT_EQ(session->Nudge("coke", 1, 0).error().code, Code::kInvalidArgument);
  EXPECT_EQ(session->Nudge("cok", 0.01, 0).error().code, Code::kInvalidArgument);
  EXPECT_EQ(session->Nudge("coke", NAN, 0).error().code, Code::kInvalidArgument);
}

// before, both ends were free, and what stood between was taken along as the robot's doing
TEST(PlaySession, NudgesNothingThroughWhatStandsInTheWay) {
  auto session = Open(SpecOf(kTask));
  ASSERT_TRUE(session->SetScene(0, {{"coke", -0.5, 0.6, 0}, {"cube", -0.42, 0.6, 0}}));
  const Eigen::Vector3d cube = Place(*session, "cube");
  EXPECT_FALSE(session->Nudge("coke", 0.15, 0));
  EXPECT_LT((Place(*session, "cube") - cube).norm(), 1e-4);
  EXPECT_TRUE(session->Nudge("coke", -0.05, 0));
}

TEST(PlaySession, RefusesRolloutsThatNoEvaluationWouldMake) {
  CampaignSpec spec = SpecOf(kTask);
  spec.rollout.execution = "author";
  EXPECT_THAT(PlaySession::Open(spec, 0), MessageHas("authors"));
}

TEST(PlaySession, HidesAndShowsAndResets) {
  auto session = Open(SpecOf(kTask));
  const auto first = PictureOf(*session);
  const Eigen::Vector3d before = Place(*session, "milk");
  ASSERT_TRUE(session->Hide("milk"));
  EXPECT_TRUE(session->hidden("milk"));
  EXPECT_NE(PictureOf(*session), first);
  EXPECT_GT(Place(*session, "milk").y(), 2) << "behind the camera";
  EXPECT_EQ(session->Hide("milk").error().code, Code::kUnavailable);
  const Sentence about{.text = "push the milk", .task = "push", .target = "milk", .reference = "", .max_steps = 5};
  const auto refused = session->Say(about, Still(*session), nullptr);
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("hidden"));
  ASSERT_TRUE(session->Show("milk"));
  EXPECT_LT((Place(*session, "milk") - before).norm(), 0.01);
  EXPECT_FALSE(session->Show("milk"));
  ASSERT_TRUE(session->Hide("bread"));
  ASSERT_TRUE(session->Reset());
  EXPECT_EQ(PictureOf(*session), first) << "the same bytes";
}

// before, it stood in the middle of that camera's picture
TEST(PlaySession, HidesBehindACameraThatLooksTheOtherWay) {
  CampaignSpec spec = SpecOf(kTask);
  spec.camera.position = {0, -1.2, 1.0};
  spec.camera.euler = {1.0, 0, 0};
  auto session = Open(spec);
  ASSERT_TRUE(session->Hide("milk"));
  EXPECT_LT(Place(*session, "milk").y(), -2) << "behind the camera";
}

TEST(PlaySession, OutlivesAPolicyThatFails) {
  auto session = Open(SpecOf(kTask));
  const auto failed = session->Say(
      SentenceOf(session->plan()),
      [](const policy::Question&) -> Result<policy::Answer> { return Fail(Code::kUnavailable, "nobody serves"); },
      nullptr);
  ASSERT_TRUE(failed);
  EXPECT_EQ(failed->outcome, AttemptOutcome::kPolicyError);
  EXPECT_THAT(failed->reason, HasSubstr("nobody serves"));
  const auto again = session->Say(SentenceOf(session->plan(), 5), Still(*session), nullptr);
  ASSERT_TRUE(again);
  EXPECT_EQ(again->outcome, AttemptOutcome::kTimeout);
}

TEST(PlaySession, RunsWhatHasNoMeaningToItsLimitUnjudged) {
  auto session = Open(SpecOf(kTask));
  const auto verdict = session->Say({.text = "sing", .task = "", .target = "", .reference = "", .max_steps = 5},
                                    Still(*session), nullptr);
  ASSERT_TRUE(verdict) << verdict.error().message;
  EXPECT_EQ(verdict->outcome, AttemptOutcome::kTimeout);
  EXPECT_EQ(session->JudgeJson()["judged"], false);
  EXPECT_FALSE(session->Check({.text = "", .task = "", .target = "", .reference = ""}));
  EXPECT_FALSE(session->Check({.text = "x", .task = "pusch", .target = "coke", .reference = ""}));
  EXPECT_FALSE(session->Check({.text = "x", .task = "push", .target = "duck", .reference = ""}));
  EXPECT_FALSE(session->Check({.text = "x", .task = "place_left", .target = "coke", .reference = "coke"}));
}

TEST(PlayPlaces, OverlapAsSeenFromAbove) {
  const sim::ObjectInfo box{.name = "a", .half_extent = {0.05, 0.02, 0.05}};
  const ObjectPlace at{"a", 0, 0.5, 0};
  EXPECT_TRUE(Overlap(box, at, box, {"b", 0.09, 0.5, 0}));
  EXPECT_FALSE(Overlap(box, at, box, {"b", 0.11, 0.5, 0}));
  EXPECT_FALSE(Overlap(box, at, box, {"b", 0, 0.55, 0}));
  EXPECT_TRUE(Overlap(box, at, box, {"b", 0, 0.55, M_PI_2})) << "turned, it is longer that way";
}

}  // namespace play_session_test
}  // namespace etude::task
