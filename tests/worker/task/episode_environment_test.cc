// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/episode_environment.cc, feasibility_check.cc and the placing of the obstacle
#include "worker/task/episode_environment.h"

#include <gmock/gmock.h>

#include <algorithm>

#include "services/core/check.h"
#include "tests/worker/task/relations.h"
#include "worker/task/expert.h"
#include "worker/task/feasibility_check.h"
#include "worker/task/task_stages.h"

namespace etude::task {
namespace episode_environment_test {

constexpr int kWaySamples = 60;

SceneSpec SceneWith(const std::vector<std::string>& objects, const std::string& robot = "ur5") {
  SceneSpec spec;
  spec.robot = robot;
  spec.objects = objects;
  spec.camera.width = spec.camera.height = 32;
  return spec;
}

std::unique_ptr<EpisodeEnvironment> OpenOrDie(const SceneSpec& spec) {
  auto setting = EpisodeEnvironment::Open(spec, {});
  ETUDE_CHECK(setting, "{}", setting.error().message);
  return std::move(*setting);
}

const RecordConfig kRecord{.image_stride = 1000};

struct Start {
  std::string task, target, reference = {};
  ObstaclePlace obstacle = ObstaclePlace::kInTheWay;
};

EpisodePlan PlanOf(const Start& start, std::uint64_t seed) {
  EpisodePlan plan{.seed = seed,
                   .task = ParseTask(start.task).value(),
                   .target = start.target,
                   .reference = start.reference,
                   .obstacle = start.obstacle,
                   .seeds = SeedsOf(seed)};
  if (plan.has_obstacle()) plan.avoid = {kObstacleObject};
  return plan;
}

// Where weights want the target, it stands more often; no place is given up.
TEST(EpisodeEnvironment, TargetsStandWhereWeightsWantThem) {
  const auto setting = OpenOrDie(SceneWith({"coke", "cube", "milk"}));
  const auto share_left = [&](const std::vector<double>& place_weights) {
    double left = 0, starts = 0;
    for (std::uint64_t seed = 0; seed < 120; ++seed) {
      EpisodePlan plan = PlanOf({.task = "pick", .target = "milk"}, seed);
      plan.place_weights = place_weights;
      if (!setting->Prepare(plan, RandomizationSpec()).ok()) continue;
      ++starts;
      left += setting->world.ObjectPose("milk").p.x() < 0;
    }
    EXPECT_GT(starts, 110);
    return left / starts;
  };
  std::vector<double> weights(kPlaces, 0.6);
  for (int place = 0; place < kPlaces; ++place)
    if (place % kPlaceColumns < kPlaceColumns / 2) weights[static_cast<std::size_t>(place)] = 1.7;

  const double usual = share_left({}), wanted = share_left(weights);

  EXPECT_NEAR(usual, 0.5, 0.2);
  EXPECT_GT(wanted, usual + 0.08) << "a half becomes three quarters";
  EXPECT_LT(wanted, 0.95);
}

TEST(EpisodeEnvironment, WeightedStartsAreAPureFunctionOfThePlan) {
  const auto one = OpenOrDie(SceneWith({"coke", "cube", "milk"})),
             other = OpenOrDie(SceneWith({"coke", "cube", "milk"}));
  EpisodePlan plan = PlanOf({.task = "pick", .target = "milk"}, 7);
  plan.place_weights.assign(kPlaces, 0.6);
  plan.place_weights[2] = 1.7;
  ASSERT_TRUE(other->Prepare(PlanOf({.task = "push", .target = "coke"}, 8), RandomizationSpec()).ok());
  ASSERT_TRUE(one->Prepare(plan, RandomizationSpec()).ok());
  ASSERT_TRUE(other->Prepare(plan, RandomizationSpec()).ok());
  for (const char* object : {"coke", "cube", "milk"})
    EXPECT_EQ(one->world.ObjectPose(object).p, other->world.ObjectPose(object).p) << object;
}

// Milk as the target, coke as the reference, wherever a test wants them, with the hand at home.
struct Table {
  explicit Table(const std::string& robot) : setting(OpenOrDie(SceneWith({"coke", "cube", "milk"}, robot))) {}

  Pose Upright(const std::string& name, double x, double y) const {
    return {{x, y, setting->shapes.object(name).rest_height}, Eigen::Quaterniond::Identity()};
  }

  std::optional<std::string> Try(const std::string& task, const std::map<std::string, Eigen::Vector2d>& places,
                                 const std::string& target = "milk") {
    setting->checker.ClearObjects();
    for (const auto& [name, p] : places) setting->checker.SetObject(name, Upright(name, p.x(), p.y()));
    const TaskName parsed = ParseTask(task).value();
    const Eigen::VectorXd q = setting->scene->arm().q_home;
    StageContext now{.shapes = &setting->shapes,
                     .target = target,
                     .X_WO = Upright(target, places.at(target).x(), places.at(target).y()),
                     .X_WE = setting->planner.kinematics().X_WE(q)};
    if (parsed.relation()) {
      now.reference = "coke";
      now.X_WR = Upright("coke", places.at("coke").x(), places.at("coke").y());
    }
    const auto refused =
        CheckFeasible(StagesOf(parsed, setting->shapes), now, {&setting->planner.kinematics(), &setting->checker, q});
    if (!refused) return std::nullopt;
    EXPECT_THAT(refused->reason, testing::MatchesRegex("[a-z_ ]+: [a-z_]+")) << "no names, no numbers";
    return refused->detail;
  }

  std::unique_ptr<EpisodeEnvironment> setting;
};

class RehearseOn : public testing::TestWithParam<const char*> {};

TEST_P(RehearseOn, AcceptsAFreeScene) {
  Table table(GetParam());
  for (const char* task : {"pick", "push", "put_down", "rotate", "place_left"}) {
    // not every arm can do everything everywhere
    std::vector<std::string> refusals;
    int accepted = 0;
    for (const double x : {-0.2, -0.1, 0.0, 0.1}) {
      const auto refused = table.Try(task, {{"milk", {x, 0.29}}, {"coke", {x - 0.25, 0.25}}, {"cube", {0.4, 0.2}}});
      refusals.push_back(refused.value_or(""));
      accepted += !refused;
    }
    EXPECT_GE(accepted, 1) << task << ": " << testing::PrintToString(refusals);
  }
}

TEST_P(RehearseOn, RefusesWhatIsOutOfReach) {
  Table table(GetParam());
  const auto refused = table.Try("pick", {{"milk", {0.3, 1.2}}, {"coke", {0.05, 0.28}}, {"cube", {0.4, 0.2}}});
  ASSERT_TRUE(refused);
  EXPECT_THAT(*refused, testing::AnyOf(testing::HasSubstr("out of reach"), testing::HasSubstr("too stretched")));
}

TEST_P(RehearseOn, RefusesANeighbourWithoutRoomForTheHand) {
  Table table(GetParam());
  // the fingers close along x: nothing fits between two that nearly touch
  const auto refused =
      table.Try("pick", {{"coke", {0.0, 0.28}}, {"cube", {0.055, 0.28}}, {"milk", {-0.06, 0.28}}}, "coke");
  ASSERT_TRUE(refused);
  EXPECT_THAT(*refused, testing::AnyOf(testing::HasSubstr("cube"), testing::HasSubstr("milk")));
}

TEST_P(RehearseOn, RefusesATakenPlaceBesideTheReference) {
  Table table(GetParam());
  const Eigen::Vector3d left = DirectionOf("place_left") * 0.12;
  const std::map<std::string, Eigen::Vector2d> places{
      {"milk", {0.0, 0.25}}, {"coke", {-0.25, 0.25}}, {"cube", {-0.25 + left.x(), 0.25}}};
  const auto refused = table.Try("place_left", places);
  ASSERT_TRUE(refused);
  EXPECT_THAT(*refused, testing::HasSubstr("cube"));
  EXPECT_FALSE(table.Try("pick", places)) << "to pick it up nothing is in the way";
}

INSTANTIATE_TEST_SUITE_P(Robots, RehearseOn, testing::Values("ur5", "panda", "jaco2"),
                         [](const auto& info) { return std::string(info.param); });

TEST(Prepare, IsAFunctionOfTheSeed) {
  const SceneSpec spec = SceneWith({"coke", "cube", "milk", "basketball"});
  const auto setting = OpenOrDie(spec), fresh = OpenOrDie(spec);
  const RandomizationSpec randomization;
  const auto start = [&](EpisodeEnvironment& in, const std::string& task, std::uint64_t seed) {
    const SceneDraws draws = in.Prepare(PlanOf({task, "coke"}, seed), randomization);
    EXPECT_TRUE(draws.ok()) << draws.failure;
    return in.world.StateVector();
  };
  for (const char* task : {"pick+obstacle", "push+obstacle"}) {
    const auto first = start(*setting, task, 5), other = start(*setting, task, 6);
    EXPECT_NE(first, other);
    EXPECT_EQ(start(*setting, task, 5), first) << "whatever was there before";
    EXPECT_EQ(start(*fresh, task, 5), first);
  }
}

TEST(Prepare, SaysHowTheSceneWasFound) {
  const auto setting = OpenOrDie(SceneWith({"coke", "cube", "milk", "bread"}));
  int first = 0, invalid = 0;
  for (std::uint64_t seed = 0; seed < 12; ++seed) {
    EpisodePlan plan = PlanOf({"place_left", "coke", "milk"}, seed);
    const SceneDraws draws = setting->Prepare(plan, {});
    ASSERT_TRUE(draws.ok()) << draws.failure;
    const std::vector<float> state = setting->world.StateVector();
    EXPECT_EQ(draws.Json()["draws"], draws.rejected.size() + 1);
    for (const auto& [reason, detail] : draws.rejected) {
      EXPECT_FALSE(reason.empty());
      EXPECT_FALSE(detail.empty());
    }
    first += draws.rejected.empty();

    plan.first_draw = true;
    const SceneDraws unfiltered = setting->Prepare(plan, {});
    EXPECT_EQ(unfiltered.ok(), draws.rejected.empty()) << "only what was taken at the first draw";
    EXPECT_EQ(unfiltered.Json()["draws"], 1u);
    if (unfiltered.ok()) {
      EXPECT_EQ(setting->world.StateVector(), state);
    }
    invalid += !unfiltered.ok();
  }
  EXPECT_GT(first, 0);
  EXPECT_GT(invalid, 0) << "this task is refused in some of the scenes";
}

TEST(Prepare, StartsAtRestWithTheRelationStillToDo) {
  const auto setting = OpenOrDie(SceneWith({"coke", "cube", "milk", "bread"}));
  for (std::uint64_t seed = 0; seed < 12; ++seed) {
    const char* task = seed % 2 == 0 ? "place_left" : "place_behind";
    const SceneDraws draws = setting->Prepare(PlanOf({task, "coke", "milk"}, seed), {});
    ASSERT_TRUE(draws.ok()) << draws.failure;
    const Pose coke = setting->world.ObjectPose("coke"), milk = setting->world.ObjectPose("milk");
    EXPECT_FALSE(IsBeside(task, coke.p, milk.p)) << seed;
    const auto& arm = setting->scene->arm().bodies;
    for (const char* object : {"coke", "cube", "milk", "bread"}) {
      for (const auto& body : setting->world.ContactsOf(object))
        EXPECT_THAT(arm, testing::Not(testing::Contains(body))) << seed << " " << object;
    }
    EXPECT_LT(setting->world.v().norm(), 0.05);
  }
}

// Whether the hand would come within `margin` (m) of the ball on its straight way to the first goal.
bool BallIsInTheWay(EpisodeEnvironment& setting, const EpisodePlan& plan, double margin) {
  sim::Kinematics& kinematics = setting.planner.kinematics();
  setting.checker.ClearObjects();
  setting.checker.SetGripper(0);
  setting.checker.Allow({});
  setting.checker.SetObject(kObstacleObject, setting.world.ObjectPose(kObstacleObject));
  Eigen::VectorXd q = setting.world.q();
  const Pose start = kinematics.X_WE(q);
  const StageContext now{
      .shapes = &setting.shapes, .target = plan.target, .X_WO = setting.world.ObjectPose(plan.target), .X_WE = start};
  const Pose goal = StagesOf(plan.task, setting.shapes).front().goal(now);
  for (int i = 0; i <= kWaySamples; ++i) {
    const double s = static_cast<double>(i) / kWaySamples;
    const auto next = kinematics.Solve({start.p + s * (goal.p - start.p), start.q.slerp(s, goal.q)}, q);
    if (!next) return false;
    q = *next;
    for (const auto& near : setting.checker.Distances(q, margin))
      if (near.body_b == kObstacleObject) return true;
  }
  return false;
}

class ObstacleOn : public testing::TestWithParam<const char*> {};

TEST_P(ObstacleOn, BlocksTheStraightWayOrStandsClearOfIt) {
  const auto setting = OpenOrDie(SceneWith({"coke", "cube", "milk", "basketball"}, GetParam()));
  for (const char* task : {"pick+obstacle", "push+obstacle", "put_down+obstacle"}) {
    for (std::uint64_t seed = 0; seed < 6; ++seed) {
      EpisodePlan plan = PlanOf({task, "coke"}, seed);
      SceneDraws draws = setting->Prepare(plan, {});
      ASSERT_TRUE(draws.ok()) << draws.failure;
      EXPECT_TRUE(BallIsInTheWay(*setting, plan, 0.005)) << task << " " << seed;
      plan.obstacle = ObstaclePlace::kAside;
      draws = setting->Prepare(plan, {});
      ASSERT_TRUE(draws.ok()) << draws.failure;
      EXPECT_FALSE(BallIsInTheWay(*setting, plan, 0.03)) << task << " " << seed;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Robots, ObstacleOn, testing::Values("ur5", "panda", "jaco2"),
                         [](const auto& info) { return std::string(info.param); });

EpisodeRunner RunnerOf(EpisodeEnvironment& setting, const EpisodePlan& plan) {
  auto runner =
      EpisodeRunner::Open({&setting.world, &setting.renderer, &setting.shapes, &setting.checker}, plan, kRecord);
  EXPECT_TRUE(runner.has_value()) << runner.error().message;
  return std::move(*runner);
}

// The ball hangs above its place in the way when the approach is planned, and falls there while the hand comes. Where
// it falls onto the hand nothing helps; elsewhere the rest of the way is planned anew.
TEST(Expert, PlansAnewWhenTheBallComesIntoTheWay) {
  constexpr double kHeight = 0.35;  // m: 0.27 s
  const auto setting = OpenOrDie(SceneWith({"coke", "cube", "milk", "basketball"}));
  RandomizationSpec randomization;
  randomization.disturbance_probability = 0;
  int avoided = 0;
  for (std::uint64_t seed = 0; seed < 8; ++seed) {
    const EpisodePlan plan = PlanOf({"pick+obstacle", "coke"}, seed);
    const SceneDraws draws = setting->Prepare(plan, randomization);
    ASSERT_TRUE(draws.ok()) << draws.failure;
    const Pose landing = setting->world.ObjectPose(kObstacleObject);
    setting->world.SetObject(kObstacleObject, {landing.p + Eigen::Vector3d(0, 0, kHeight), landing.q});
    setting->world.Forward();
    auto session = RunnerOf(*setting, plan);
    Expert expert(&session, &setting->planner, &setting->checker, randomization);
    const Verdict verdict = expert.Run();
    if (!verdict.ok()) {
      EXPECT_FALSE(verdict.reason.empty());
      EXPECT_THAT(verdict.outcome, testing::AnyOf(AttemptOutcome::kCollision, AttemptOutcome::kPlanFailed))
          << verdict.reason;
      continue;
    }
    const Pose ball = setting->world.ObjectPose(kObstacleObject);
    EXPECT_LT((ball.p - landing.p).norm(), 0.02) << seed << ": it was touched";
    avoided += expert.Statistics()["replans"].get<int>() >= 1;
  }
  EXPECT_GE(avoided, 4);
}

TEST(Expert, PlansOnceWhenNothingMoves) {
  const auto setting = OpenOrDie(SceneWith({"coke", "cube", "milk", "basketball"}));
  const EpisodePlan plan = PlanOf({"pick+obstacle", "coke"}, 1);
  const SceneDraws draws = setting->Prepare(plan, {});
  ASSERT_TRUE(draws.ok()) << draws.failure;
  auto session = RunnerOf(*setting, plan);
  RandomizationSpec randomization;
  randomization.disturbance_probability = 0;
  Expert expert(&session, &setting->planner, &setting->checker, randomization);
  const Verdict verdict = expert.Run();
  EXPECT_TRUE(verdict.ok()) << verdict.reason;
  EXPECT_EQ(expert.Statistics()["replans"].get<int>(), 0);
}

// ten centimetres from its middle were its wall, and physics threw them apart
TEST(EpisodeEnvironment, TheObstacleStandsInNoWall) {
  const auto setting = OpenOrDie(SceneWith({"cube", "open_box", kObstacleObject}));
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    const auto draws = setting->Prepare(
        PlanOf({.task = "pick+obstacle", .target = "cube", .obstacle = ObstaclePlace::kAside}, seed), {});
    EXPECT_EQ(draws.failure.find("settling"), std::string::npos) << seed << ": " << draws.failure;
  }
}

}  // namespace episode_environment_test
}  // namespace etude::task
