// SPDX-License-Identifier: Apache-2.0
// Tests services/spec/episode_world.cc
#include "services/spec/episode_world.h"

#include <gmock/gmock.h>

#include <functional>
#include <map>
#include <set>

#include "services/spec/episode_plan.h"
#include "services/spec/object_names.h"

namespace etude {
namespace episode_world_test {

WorldRandomizationSpec Everything() {
  WorldRandomizationSpec world;
  world.camera_position = 0.1;
  world.camera_aim = 0.08;
  world.camera_roll = 0.06;
  world.fovy_deg = 12;
  world.light_brightness = 0.3;
  world.light_colour = 0.2;
  world.light_direction = 0.4;
  world.tables = {"wood", "stone", "plain"};
  world.table_scale = 1;
  world.table_colour = 0.3;
  world.background = 0.5;
  world.object_colour = 0.2;
  world.object_gloss = 0.3;
  world.distractors = 2;
  return world;
}

CampaignSpec Random() {
  CampaignSpec spec;
  spec.randomization.world = Everything();
  return spec;
}

TEST(DrawWorld, SwitchedOffNothingIsDrawn) {
  const CampaignSpec spec;
  for (std::uint64_t i = 0; i < 50; ++i) {
    const EpisodePlan plan = PlanEpisode(spec, i, 0);
    EXPECT_EQ(plan.world, EpisodeWorld{});
    EXPECT_TRUE(plan.distractors.empty());
    EXPECT_EQ(plan.scene, SceneSpec(spec));
  }
}

TEST(DrawWorld, SwitchedOnItChangesNothingElse) {
  CampaignSpec off, on = Random();
  off.tasks = on.tasks = {"pick", "place_left", "push+obstacle", "put_down"};
  off.objects_per_scene = on.objects_per_scene = 3;
  for (std::uint64_t i = 0; i < 60; ++i) {
    const EpisodePlan before = PlanEpisode(off, i, 1), after = PlanEpisode(on, i, 1);
    EXPECT_EQ(before.task.text(), after.task.text());
    EXPECT_EQ(before.target, after.target);
    EXPECT_EQ(before.reference, after.reference);
    EXPECT_EQ(before.avoid, after.avoid);
    EXPECT_EQ(before.obstacle, after.obstacle);
    EXPECT_EQ(before.seed, after.seed);
    EXPECT_EQ(before.seeds.scene, after.seeds.scene);
    EXPECT_EQ(before.seeds.disturbance, after.seeds.disturbance);
    std::vector<std::string> objects = after.scene.objects;
    objects.resize(objects.size() - after.distractors.size());
    EXPECT_EQ(before.scene.objects, objects) << "the distractors are the last";
  }
}

// A key switched off, and what it draws.
struct Key {
  const char* name;
  std::function<void(WorldRandomizationSpec&)> off;
  std::function<void(EpisodeWorld&)> forget;
};

const std::vector<Key>& Keys() {
  static const std::vector<Key> keys{
      {"light_direction", [](auto& w) { w.light_direction = 0; }, [](auto& w) { w.sun_shift = {}; }},
      {"tables", [](auto& w) { w.tables.clear(); }, [](auto& w) { w.table.clear(); }},
      {"table_scale", [](auto& w) { w.table_scale = 0; }, [](auto& w) { w.table_scale = 1; }},
      {"table_colour", [](auto& w) { w.table_colour = 0; },
       [](auto& w) {
         w.table_colour = {1, 1, 1};
       }},
      {"background", [](auto& w) { w.background = 0; }, [](auto& w) { w.background.reset(); }},
      {"object_colour", [](auto& w) { w.object_colour = 0; }, [](auto& w) { w.colour.clear(); }},
      {"object_gloss", [](auto& w) { w.object_gloss = 0; }, [](auto& w) { w.gloss.clear(); }},
      {"camera", [](auto& w) { w.camera_position = w.camera_aim = w.camera_roll = w.fovy_deg = 0; },
       [](auto& w) { w.camera.reset(); }},
      {"light", [](auto& w) { w.light_brightness = w.light_colour = 0; },
       [](auto& w) {
         w.light = {1, 1, 1};
       }},
      {"distractors", [](auto& w) { w.distractors = 0; },
       [](auto& w) {
         std::erase_if(w.colour, [](const auto& one) { return IsDistractor(one.first); });
         std::erase_if(w.gloss, [](const auto& one) { return IsDistractor(one.first); });
       }}};
  return keys;
}

TEST(DrawWorld, EveryKeyHasAStreamOfItsOwn) {
  const CampaignSpec all = Random();
  for (const Key& key : Keys()) {
    CampaignSpec without = all;
    key.off(without.randomization.world);
    int differ = 0;
    for (std::uint64_t i = 0; i < 40; ++i) {
      EpisodeWorld expected = PlanEpisode(all, i, 0).world;
      const EpisodeWorld drawn = PlanEpisode(without, i, 0).world;
      differ += drawn != expected;
      key.forget(expected);
      EXPECT_EQ(drawn, expected) << key.name << " " << i;
    }
    EXPECT_GE(differ, 20) << key.name << " draws something";
  }
}

TEST(DrawWorld, IsOneForAllAttemptsAndAnotherForEachEpisodeAndSeed) {
  CampaignSpec spec = Random(), other = Random();
  other.seed = 2;
  std::set<double> brightness;
  for (std::uint64_t i = 0; i < 100; ++i) {
    const EpisodePlan plan = PlanEpisode(spec, i, 0);
    EXPECT_EQ(plan.world, PlanEpisode(spec, i, 3).world);
    EXPECT_NE(plan.world, PlanEpisode(other, i, 0).world);
    EXPECT_NE(plan.seeds.distractors, PlanEpisode(spec, i, 3).seeds.distractors) << "their places are drawn anew";
    brightness.insert(plan.world.light[0]);
  }
  EXPECT_EQ(brightness.size(), 100u);
}

TEST(DrawWorld, StaysWithinItsRanges) {
  const CampaignSpec spec = Random();
  const WorldRandomizationSpec& ranges = spec.randomization.world;
  std::map<std::string, int> tables;
  double largest_scale = 1, smallest_scale = 1;
  for (std::uint64_t i = 0; i < 1000; ++i) {
    const EpisodeWorld world = PlanEpisode(spec, i, 0).world;
    ++tables[world.table];
    largest_scale = std::max(largest_scale, world.table_scale);
    smallest_scale = std::min(smallest_scale, world.table_scale);
    for (int k = 0; k < 3; ++k) {
      EXPECT_LE(std::abs(world.camera->position[k] - spec.camera.position[k]), ranges.camera_position + 1e-12);
      EXPECT_GE(world.light[k], 0.7 * 0.8);
      EXPECT_LE(world.light[k], 1.3 * 1.2);
      EXPECT_LE(std::abs(world.sun_shift[k]), 0.4);
      EXPECT_LE(std::abs(world.table_colour[k] - 1), 0.3);
      EXPECT_LE(std::abs((*world.background)[k] - 0.25), 0.25);
      for (const auto& [name, gain] : world.colour) EXPECT_LE(std::abs(gain[k] - 1), 0.2) << name;
    }
    EXPECT_LE(std::abs(world.camera->fovy_deg - 60), 12);
  }
  EXPECT_EQ(tables.size(), 3u);
  for (const auto& [table, count] : tables) EXPECT_NEAR(count, 333, 60) << table;
  EXPECT_GT(largest_scale, 1.95);
  EXPECT_LE(largest_scale, 2);
  EXPECT_LT(smallest_scale, 0.52);
  EXPECT_GE(smallest_scale, 0.5);
}

TEST(DrawCamera, LooksNearWhereTheCampaignsCameraLooks) {
  CampaignSpec spec;
  spec.randomization.world.camera_position = 0.3;
  const Camera nominal = ToCamera(spec.camera);
  const Eigen::Vector3d forward = -(nominal.X_WC.q * Eigen::Vector3d::UnitZ());
  const Eigen::Vector3d aim = nominal.X_WC.p - forward * (nominal.X_WC.p.z() / forward.z());
  for (std::uint64_t i = 0; i < 200; ++i) {
    const Camera camera = ToCamera(*DrawCamera(spec, i));
    const Eigen::Vector2d pixel = camera.Project(aim);
    EXPECT_NEAR(pixel.x(), 112, 1e-6);
    EXPECT_NEAR(pixel.y(), 112, 1e-6);
  }
}

TEST(DrawCamera, WithTinyRangesIsTheCampaignsCamera) {
  CampaignSpec spec;
  spec.randomization.world.fovy_deg = 1e-9;
  const Camera nominal = ToCamera(spec.camera), drawn = ToCamera(*DrawCamera(spec, 3));
  EXPECT_LT((drawn.X_WC.p - nominal.X_WC.p).norm(), 1e-12);
  EXPECT_LT(AngleBetween(drawn.X_WC.q, nominal.X_WC.q), 1e-7);
  EXPECT_NEAR(drawn.fovy, nominal.fovy, 1e-9);
}

TEST(DrawCamera, SeesTheWorkVolumeHoweverLargeTheRangesAre) {
  CampaignSpec spec;
  spec.randomization.world.camera_position = 0.8;
  spec.randomization.world.camera_aim = 0.5;
  spec.randomization.world.camera_roll = 0.8;
  spec.randomization.world.fovy_deg = 30;
  std::set<double> fovy;
  for (std::uint64_t i = 0; i < 300; ++i) {
    const auto camera = DrawCamera(spec, i);
    ASSERT_TRUE(camera);
    EXPECT_TRUE(SeesWorkVolume(*camera)) << i;
    fovy.insert(camera->fovy_deg);
  }
  EXPECT_EQ(fovy.size(), 300u);
  CameraSpec away = spec.camera;
  away.euler[0] += 3.14;
  EXPECT_FALSE(SeesWorkVolume(away)) << "behind it";
  away = spec.camera;
  away.fovy_deg = 25;
  EXPECT_FALSE(SeesWorkVolume(away)) << "too near";
}

TEST(CamerasOf, AreThoseOfTheEpisodes) {
  EXPECT_EQ(CamerasOf(CampaignSpec(), 100).size(), 1u);
  const CampaignSpec spec = Random();
  const auto cameras = CamerasOf(spec, 30);
  ASSERT_EQ(cameras.size(), 30u);
  for (std::uint64_t i = 0; i < 30; ++i)
    EXPECT_EQ(cameras[i].X_WC.p, ToCamera(*PlanEpisode(spec, i, 0).world.camera).X_WC.p);
}

TEST(DrawDistractors, AreNoneThatASentenceCouldMean) {
  CampaignSpec spec = Random();
  spec.objects = {"cube", "apple_00", "mug_01", "milk"};
  spec.tasks = {"pick", "place_left", "pick+others"};
  spec.randomization.world.distractors = 3;
  std::map<std::size_t, int> counts;
  std::set<std::string> seen;
  for (std::uint64_t i = 0; i < 3000; ++i) {
    const EpisodePlan plan = PlanEpisode(spec, i, 0);
    ++counts[plan.distractors.size()];
    std::set<std::string> classes;
    for (const auto& name : plan.distractors) {
      ASSERT_TRUE(IsDistractor(name)) << name;
      const std::string its_class = ObjectNoun(WhatDistracts(name));
      EXPECT_TRUE(classes.insert(its_class).second) << "two of a class";
      EXPECT_THAT(its_class, testing::AllOf(testing::Ne("apple"), testing::Ne("mug")));
      EXPECT_NE(name, plan.target);
      EXPECT_NE(name, plan.reference);
      EXPECT_THAT(plan.scene.objects, testing::Contains(name));
      if (plan.task.avoid == "others") {
        EXPECT_THAT(plan.avoid, testing::Contains(name));
      }
      EXPECT_LT(ParseGenerated(WhatDistracts(name))->instance, kTrainInstances) << "those for tests stay unseen";
      seen.insert(name);
    }
    EXPECT_EQ(plan.distractors, PlanEpisode(spec, i / kEpisodesPerScene * kEpisodesPerScene, 0).distractors);
  }
  for (std::size_t k = 0; k <= 3; ++k) EXPECT_GT(counts[k], 450) << k;
  EXPECT_EQ(seen.size(), 8u * kTrainInstances);
}

TEST(DrawDistractors, ABallTakesTheFirstOnesPlaceAndChangesNoOther) {
  CampaignSpec spec = Random();
  spec.randomization.world.distractors = 2;
  CampaignSpec with_balls = spec;
  with_balls.randomization.world.distractor_balls = 0.4;
  int some = 0, balls = 0;
  std::set<int> colours;
  for (std::uint64_t i = 0; i < 3000; i += kEpisodesPerScene) {
    const auto before = DrawDistractors(spec, i), after = DrawDistractors(with_balls, i);
    ASSERT_EQ(after.size(), before.size());
    EXPECT_EQ(after, DrawDistractors(with_balls, i + kEpisodesPerScene - 1));
    for (std::size_t k = 1; k < after.size(); ++k) EXPECT_EQ(after[k], before[k]);
    if (after.empty()) continue;
    ++some;
    ASSERT_TRUE(IsDistractor(after[0]));
    const auto colour = ParseBall(WhatDistracts(after[0]));
    if (!colour) {
      EXPECT_EQ(after[0], before[0]);
      continue;
    }
    ++balls;
    colours.insert(*colour);
  }
  EXPECT_NEAR(static_cast<double>(balls) / some, 0.4, 0.1);
  EXPECT_GT(colours.size(), 20u);
}

}  // namespace episode_world_test
}  // namespace etude
