// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/distractor_placing.cc, and attempts in worlds that change from episode to episode
#include <gmock/gmock.h>

#include <algorithm>
#include <map>
#include <numeric>

#include "services/campaign/spec_file.h"
#include "services/core/check.h"
#include "services/spec/object_names.h"
#include "worker/task/attempt.h"
#include "worker/task/distractor_placing.h"

namespace etude::task {
namespace random_world_test {

CampaignSpec Robust() {
  auto spec = campaign::LoadSpec({.file = "deploy/campaigns/robust.yaml", .episodes = {}, .seed = {}, .overrides = {}});
  ETUDE_CHECK(spec, "{}", spec.error().message);
  return std::move(*spec);
}

CampaignSpec Small(CampaignSpec spec) {
  spec.image_stride = 125;  // the pictures cost more than everything else
  spec.camera.width = spec.camera.height = 64;
  return spec;
}

AttemptRunner OpenOrDie(const CampaignSpec& spec) {
  auto runner = AttemptRunner::Open(spec);
  ETUDE_CHECK(runner, "{}", runner.error().message);
  return std::move(*runner);
}

/// Pixels (u, v) of a body in a segmentation.
std::vector<Eigen::Vector2d> PixelsOf(const std::vector<std::int32_t>& ids, int width, std::int32_t id) {
  std::vector<Eigen::Vector2d> pixels;
  for (std::size_t i = 0; i < ids.size(); ++i)
    if (ids[i] == id) pixels.emplace_back(static_cast<double>(i % width) + 0.5, static_cast<double>(i / width) + 0.5);
  return pixels;
}

TEST(RandomWorld, EveryObjectIsInThePictureWhereItsCameraSaysAndSeen) {
  CampaignSpec spec = Robust();
  AttemptRunner runner = OpenOrDie(spec);
  int objects = 0, found = 0;
  std::vector<std::int32_t> ids(static_cast<std::size_t>(spec.camera.width) * spec.camera.height);
  for (std::uint64_t index = 0; index < 40; ++index) {
    const auto scene = runner.Show(index, 0);
    ASSERT_TRUE(scene) << scene.error().message;
    const Camera& camera = scene->renderer->camera();
    EXPECT_EQ(camera.fovy, ToCamera(*scene->plan.world.camera).fovy);
    scene->renderer->RenderSegmentation(*scene->world, ids);
    for (const auto& object : scene->world->scene().objects()) {
      const Eigen::Vector2d pixel = camera.Project(scene->world->ObjectPose(object.name).p);
      const auto pixels = PixelsOf(ids, camera.width, scene->world->BodyId(object.name));
      ++objects;
      ASSERT_GT(pixels.size(), 8u) << object.name << " is hidden in episode " << index;
      const Eigen::Vector2d sum = std::accumulate(pixels.begin(), pixels.end(), Eigen::Vector2d(0, 0));
      found += (sum / static_cast<double>(pixels.size()) - pixel).norm() < 5;
      const bool at_the_edge = std::ranges::any_of(pixels, [&](const auto& p) {
        return p.x() < 1 || p.y() < 1 || p.x() > camera.width - 1 || p.y() > camera.height - 1;
      });
      EXPECT_FALSE(at_the_edge) << object.name << " is cut off in episode " << index;
    }
  }
  EXPECT_GT(found, 0.97 * objects) << "some stand half behind another one";
}

TEST(RandomWorld, AnEpisodeRecordsTheCameraThatItWasTakenWith) {
  CampaignSpec spec = Small(Robust());
  AttemptRunner runner = OpenOrDie(spec);
  const auto result = runner.Demonstrate(1, 0).value();
  ASSERT_EQ(result.outcome, AttemptOutcome::kSuccess) << result.reason;
  const Episode& episode = result.episode;
  const EpisodePlan plan = PlanEpisode(spec, 1, 0);
  const Camera camera = ToCamera(*plan.world.camera);
  EXPECT_EQ(episode.cameras[0].camera.X_WC.p, camera.X_WC.p);
  EXPECT_EQ(episode.cameras[0].camera.X_WC.q.coeffs(), camera.X_WC.q.coeffs());
  EXPECT_EQ(episode.cameras[0].camera.fovy, camera.fovy);
  EXPECT_EQ(episode.details["world"], ToJson(plan.world));
  const auto hand = episode.eef_pos.row(7), pixel = episode.eef_pixel.row(7);
  EXPECT_LT((camera.Project({hand[0], hand[1], hand[2]}) - Eigen::Vector2d(pixel[0], pixel[1])).norm(), 1e-3);
  EXPECT_GT((ToCamera(spec.camera).Project({hand[0], hand[1], hand[2]}) - Eigen::Vector2d(pixel[0], pixel[1])).norm(),
            0.5)
      << "not the campaign's";
  std::vector<std::string> names;
  for (const auto& object : episode.objects) names.push_back(object.name);
  EXPECT_EQ(names, SceneNames(plan.scene.objects)) << "distractors are recorded as the objects are";
}

TEST(RandomWorld, AQuestionToAPolicyCarriesTheCamera) {
  CampaignSpec spec = Small(Robust());
  spec.mode = "rollout";
  spec.rollout.run = "nobody";
  spec.rollout.max_steps = 2;
  AttemptRunner runner = OpenOrDie(spec);
  std::optional<Camera> asked;
  const auto rollout = runner.Rollout(2, [&](const policy::Question& question) -> Result<policy::Answer> {
    asked = question.camera;
    return policy::Answer{};
  });
  ASSERT_TRUE(rollout) << rollout.error().message;
  ASSERT_TRUE(asked);
  EXPECT_EQ(asked->X_WC.p, ToCamera(*PlanEpisode(spec, 2, 0).world.camera).X_WC.p);
  EXPECT_EQ(rollout->episode.cameras[0].camera.fovy, asked->fovy);
}

TEST(RandomWorld, WithoutDistractorsTheEpisodeIsTheSameButForItsLooks) {
  CampaignSpec off = Small(Robust()), on = off;
  off.randomization.world = {};
  on.randomization.world.distractors = 0;
  AttemptRunner plain = OpenOrDie(off), dressed = OpenOrDie(on);
  for (std::uint64_t index = 0; index < 4; ++index) {
    const auto before = plain.Demonstrate(index, 0).value(), after = dressed.Demonstrate(index, 0).value();
    ASSERT_EQ(before.outcome, AttemptOutcome::kSuccess) << before.reason;
    EXPECT_EQ(before.episode.states.values, after.episode.states.values);
    EXPECT_EQ(before.episode.actions_abs.values, after.episode.actions_abs.values);
    EXPECT_EQ(before.episode.instruction, after.episode.instruction);
    EXPECT_NE(before.episode.cameras[0].streams, after.episode.cameras[0].streams);
    EXPECT_FALSE(before.episode.details.contains("world"));
  }
}

TEST(RandomWorld, DistractorsLeaveTheObjectsWhereTheyWere) {
  CampaignSpec with = Small(Robust()), without = with;
  without.randomization.world.distractors = 0;
  AttemptRunner crowded = OpenOrDie(with), plain = OpenOrDie(without);
  int same = 0, scenes = 0;
  for (std::uint64_t index = 0; index < 30; ++index) {
    if (PlanEpisode(with, index, 0).distractors.empty()) continue;
    const auto before = plain.Show(index, 0), after = crowded.Show(index, 0);
    ASSERT_TRUE(before && after);
    ++scenes;
    same +=
        (before->world->ObjectPose(before->plan.target).p - after->world->ObjectPose(before->plan.target).p).norm() <
        1e-3;
  }
  EXPECT_GE(scenes, 10);
  EXPECT_GE(same, 0.8 * scenes) << "another start is drawn only where they find no place";
}

TEST(RandomWorld, TheExpertSucceedsAndTouchesNoDistractor) {
  CampaignSpec spec = Small(Robust());
  spec.randomization.world.distractor_balls = 0.5;
  AttemptRunner runner = OpenOrDie(spec);
  int successes = 0, with_distractors = 0;
  std::map<std::string, int> failures;
  const int scenes = 60;
  for (std::uint64_t index = 0; index < scenes; ++index) {
    const auto result = runner.Demonstrate(index, 0).value();
    if (result.outcome != AttemptOutcome::kSuccess) {
      ++failures[result.reason];
      continue;
    }
    ++successes;
    const EpisodePlan plan = PlanEpisode(spec, index, 0);
    with_distractors += !plan.distractors.empty();
    EXPECT_TRUE(result.episode.details["violations"].empty());
    for (const auto& disturbed : result.episode.details["disturbed_objects"])
      EXPECT_FALSE(IsDistractor(disturbed.get<std::string>())) << index << " " << disturbed;
  }
  RecordProperty("successes", successes);
  EXPECT_GE(successes, 0.97 * scenes) << testing::PrintToString(failures);
  EXPECT_GT(with_distractors, 20);
}

TEST(RandomWorld, TouchingADistractorIsAViolation) {
  CampaignSpec spec = Small(Robust());
  std::uint64_t index = 0;
  while (PlanEpisode(spec, index, 0).distractors.empty()) ++index;
  AttemptRunner runner = OpenOrDie(spec);
  spec.mode = "rollout";
  spec.rollout.run = "clumsy";
  spec.rollout.max_steps = 250;
  spec.rollout.latency_ms = 0;
  AttemptRunner rollouts = OpenOrDie(spec);
  const auto scene = rollouts.Show(index, 0);
  ASSERT_TRUE(scene) << scene.error().message;
  const std::string distractor = scene->plan.distractors.front();
  const Eigen::Vector3d place = scene->world->ObjectPose(distractor).p;
  const Eigen::Quaterniond q = scene->world->X_WE().q;
  const auto rollout = rollouts.Rollout(index, [&](const policy::Question&) -> Result<policy::Answer> {
    policy::Answer answer;
    answer.waypoints.assign(kWaypoints, Waypoint{{place, q}, 0});
    return answer;
  });
  ASSERT_TRUE(rollout) << rollout.error().message;
  const std::string violations = rollout->episode.details["violations"].dump();
  EXPECT_THAT(violations, testing::HasSubstr("-" + distractor));
}

// Objects of a size as they are, on an empty table.
struct Table {
  std::vector<sim::ObjectInfo> infos;
  std::vector<PlacedObject> objects;
};

Table TableWith(const std::vector<std::pair<std::string, Eigen::Vector2d>>& objects) {
  Table table;
  for (const auto& [name, p] : objects) {
    table.infos.push_back({name, {0.03, 0.03, 0.05}, 0.05, 0.1});
    table.objects.push_back({name, {{p.x(), p.y(), 0.05}, Eigen::Quaterniond::Identity()}});
  }
  return table;
}

std::shared_ptr<const sim::Scene> SceneWithDistractors() {
  SceneSpec spec;
  spec.objects = {"cube", "coke", "distractor_lemon_00", "distractor_mug_00"};
  return sim::Scene::Build(spec).value();
}

TEST(PlaceDistractors, KeepsItsRulesOverManySeeds) {
  const auto scene = SceneWithDistractors();
  collide::Checker checker(scene);
  const Table table = TableWith({{"cube", {0.0, 0.3}}, {"coke", {0.25, 0.3}}});
  const std::vector<sim::ObjectInfo> things{{"distractor_lemon_00", {0.03, 0.025, 0.03}, 0.03, 0.1},
                                            {"distractor_mug_00", {0.04, 0.03, 0.04}, 0.04, 0.1}};
  const PlacedScene placed{
      .infos = &table.infos, .objects = &table.objects, .roles = {"cube", ""}, .yaw = 0.3, .feasible = [] {
        return true;
      }};
  for (std::uint64_t seed = 0; seed < 500; ++seed) {
    Rng rng(seed);
    const auto found = PlaceDistractors(things, placed, checker, rng);
    ASSERT_TRUE(found) << seed;
    ASSERT_EQ(found->size(), 2u);
    EXPECT_GT(((*found)[0].X_WO.p - (*found)[1].X_WO.p).head<2>().norm(), 0.1);
    for (const auto& thing : *found) {
      const Eigen::Vector3d p = thing.X_WO.p;
      EXPECT_LE(std::abs(p.x()), 0.45);
      EXPECT_GE(p.y(), 0.06);
      EXPECT_LE(p.y(), 0.42);
      EXPECT_GT(std::abs(p.x()), 0.1) << "not before or behind the target";
      const Eigen::Vector2d d = (p - table.objects[1].X_WO.p).head<2>();
      EXPECT_GT(d.norm(), 0.1);
      EXPECT_FALSE(std::abs(d.x()) < 0.07 && d.y() > 0 && d.y() < 0.2) << "before the can";
    }
  }
}

TEST(PlaceDistractors, LooksForAnotherArrangementWhereTheTaskCannotBeDone) {
  const auto scene = SceneWithDistractors();
  collide::Checker checker(scene);
  const Table table = TableWith({{"cube", {0.0, 0.3}}});
  const std::vector<sim::ObjectInfo> things{{"distractor_lemon_00", {0.03, 0.025, 0.03}, 0.03, 0.1}};
  int asked = 0;
  PlacedScene placed{.infos = &table.infos, .objects = &table.objects, .roles = {"cube"}};
  placed.feasible = [&] { return ++asked == 5; };
  Rng rng(1);
  EXPECT_TRUE(PlaceDistractors(things, placed, checker, rng));
  EXPECT_EQ(asked, 5);
  placed.feasible = [] { return false; };
  EXPECT_FALSE(PlaceDistractors(things, placed, checker, rng));
  EXPECT_TRUE(PlaceDistractors({}, placed, checker, rng)->empty()) << "nothing to place, nothing to ask";
}

}  // namespace random_world_test
}  // namespace etude::task
