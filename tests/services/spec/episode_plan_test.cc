// SPDX-License-Identifier: Apache-2.0
// Tests services/spec/episode_plan.cc
#include "services/spec/episode_plan.h"

#include <gmock/gmock.h>

#include <cmath>
#include <map>
#include <numeric>
#include <set>

#include "services/core/rng.h"
#include "services/spec/object_names.h"
#include "services/spec/task_roles.h"

namespace etude {
namespace episode_plan_test {

TEST(PlanEpisode, WeightsGiveExactCounts) {
  CampaignSpec spec;
  spec.task_weights = {4, 3, 3};

  std::map<std::string, int> counts;
  for (std::uint64_t i = 0; i < 80; ++i) ++counts[PlanEpisode(spec, i, 0).task.text()];

  EXPECT_EQ(counts["pick"], 32);
  EXPECT_EQ(counts["push"], 24);
  EXPECT_EQ(counts["put_down"], 24);
}

TEST(PlanEpisode, WeightedTasksAreNearTheirSharesAtAnyTime) {
  Rng rng(12);
  for (int round = 0; round < 12; ++round) {
    CampaignSpec spec;
    spec.tasks = {"pick", "push", "put_down", "rotate"};
    spec.tasks.resize(2 + rng.Below(3));
    for (std::size_t k = 0; k < spec.tasks.size(); ++k) spec.task_weights.push_back(rng.Uniform(0.1, 5));
    const double total = std::accumulate(spec.task_weights.begin(), spec.task_weights.end(), 0.0);
    std::map<std::string, int> counts;
    for (std::uint64_t i = 0; i < 200; ++i) {
      ++counts[PlanEpisode(spec, i, 0).task.text()];
      for (std::size_t k = 0; k < spec.tasks.size(); ++k)
        ASSERT_NEAR(counts[spec.tasks[k]], static_cast<double>(i + 1) * spec.task_weights[k] / total, 1 + 1e-9) << i;
    }
  }
}

TEST(PlanEpisode, WithoutWeightsTasksTakeTurns) {
  CampaignSpec spec;
  for (std::uint64_t i = 0; i < 9; ++i) EXPECT_EQ(PlanEpisode(spec, i, 0).task.text(), spec.tasks[i % 3]);
}

TEST(PlanEpisode, AReferenceIsOneThatTheTaskAllows) {
  CampaignSpec spec;
  spec.objects = TrainObjects();
  spec.objects.insert(spec.objects.end(), {"cube", "milk", "bread", "open_box"});
  spec.objects_per_scene = 3;
  spec.tasks = {"stack", "drop_in", "place_behind"};
  std::map<std::string, std::set<std::string>> references;
  for (std::uint64_t i = 0; i < 900; ++i) {
    const EpisodePlan plan = PlanEpisode(spec, i, 0);
    ASSERT_THAT(plan.scene.objects, testing::Contains(plan.target)) << i;
    ASSERT_THAT(plan.scene.objects, testing::Contains(plan.reference)) << i;
    ASSERT_TRUE(plan.task.spec->MayRefer(plan.target, plan.reference)) << i;
    ASSERT_EQ(plan.scene.objects.size(), 3u) << i;
    references[plan.task.base].insert(plan.reference);
  }
  EXPECT_THAT(references["stack"], testing::ElementsAre("cube")) << "no can is among them";
  EXPECT_THAT(references["drop_in"], testing::ElementsAre("open_box"));
  EXPECT_GT(references["place_behind"].size(), 10u);
}

TEST(PlanEpisode, ScenesAreDrawnUntilOneWillDoOrTakenAsTheyCome) {
  CampaignSpec spec;
  EXPECT_FALSE(PlanEpisode(spec, 0, 0).first_draw);
  spec.scenes = "first_draw";
  EXPECT_TRUE(PlanEpisode(spec, 0, 0).first_draw);
}

TEST(PlanEpisode, AnImportedObjectIsCalledByItsFolder) {
  CampaignSpec spec;
  spec.tasks = {"place_left"};
  spec.objects = {"my/things/duck", "cube"};
  for (std::uint64_t i = 0; i < 20; ++i) {
    const EpisodePlan plan = PlanEpisode(spec, i, 0);
    EXPECT_THAT(plan.scene.objects, testing::ElementsAre("my/things/duck", "cube"));
    EXPECT_THAT((std::set<std::string>{plan.target, plan.reference}), testing::ElementsAre("cube", "duck"));
  }
}

TEST(PlanEpisode, ObjectsAreOfDifferentClassesAndSharedByAGroup) {
  CampaignSpec spec;
  spec.objects = TrainObjects();
  spec.objects_per_scene = 4;
  spec.robots = {"ur5", "panda", "jaco2"};
  spec.tasks = {"pick", "place_left", "push+obstacle"};
  std::set<std::vector<std::string>> choices;
  std::set<std::string> seen;
  for (std::uint64_t i = 0; i < 600; ++i) {
    const EpisodePlan plan = PlanEpisode(spec, i, 0);
    SceneSpec scene = plan.scene;
    EXPECT_EQ(scene.robot, spec.robots[i / kEpisodesPerScene % 3]);
    if (i % 3 == 2) {
      ASSERT_EQ(scene.objects.back(), kObstacleObject) << i;
      scene.objects.pop_back();
    }
    ASSERT_EQ(scene.objects.size(), 4u);
    std::set<std::string> classes;
    for (const auto& object : scene.objects) classes.insert(ObjectNoun(object)), seen.insert(object);
    EXPECT_EQ(classes.size(), 4u) << i;
    choices.insert(scene.objects);
    EXPECT_THAT(scene.objects, testing::Contains(plan.target));
    if (i % 3 == 1) {
      EXPECT_THAT(scene.objects, testing::Contains(plan.reference));
      EXPECT_NE(plan.reference, plan.target);
    } else {
      EXPECT_EQ(plan.reference, "");
    }
  }
  EXPECT_LE(choices.size(), 600 / kEpisodesPerScene);
  EXPECT_GT(choices.size(), 50u) << "others in each group";
  EXPECT_EQ(seen.size(), 30u) << "each has its turn";
}

// their rounds end together: each robot met ten of the tasks and never the others
TEST(PlanEpisode, EveryRobotMeetsEveryTask) {
  CampaignSpec spec;
  spec.robots = {"ur5", "panda", "jaco2"};
  spec.tasks = {"pick",
                "push",
                "put_down",
                "rotate",
                "place_left",
                "place_right",
                "place_front",
                "place_behind",
                "pick+obstacle",
                "push+obstacle",
                "rotate+obstacle",
                "pick+others",
                "push+others",
                "put_down+obstacle",
                "rotate+others"};
  std::set<std::pair<std::string, std::string>> met;
  for (std::uint64_t i = 0; i < 90; ++i) {
    const EpisodePlan plan = PlanEpisode(spec, i, 0);
    met.insert({plan.scene.robot, plan.task.text()});
    EXPECT_EQ(plan.scene.robot, PlanEpisode(spec, i / kEpisodesPerScene * kEpisodesPerScene, 0).scene.robot) << i;
  }
  EXPECT_EQ(met.size(), 45u);
}

// a task that is drawn once in 20 episodes was always the same robot's
TEST(PlanEpisode, EveryRobotMeetsEveryTaskHoweverRareItIs) {
  CampaignSpec spec;
  spec.robots = {"ur5", "panda"};
  spec.tasks = {"pick", "push", "put_down"};
  spec.task_weights = {16, 3, 1};
  std::map<std::string, std::set<std::string>> robots_of;
  for (std::uint64_t i = 0; i < 40; ++i) {
    const EpisodePlan plan = PlanEpisode(spec, i, 0);
    robots_of[plan.task.text()].insert(plan.scene.robot);
  }
  for (const auto& task : spec.tasks) EXPECT_EQ(robots_of[task].size(), 2u) << task;
}

TEST(PlanEpisode, SeedsDifferByIndexAndAttempt) {
  const CampaignSpec spec;

  EXPECT_NE(EpisodeSeed(spec, 1, 0), EpisodeSeed(spec, 0, 1));
  EXPECT_EQ(EpisodeSeed(spec, 1, 0), EpisodeSeed(spec, 1, 0));
}

TEST(PlanEpisode, SpreadsTargetsOverTheObjects) {
  CampaignSpec spec;
  std::map<std::string, int> counts;
  for (std::uint64_t index = 0; index < 6000; ++index) ++counts[PlanEpisode(spec, index, 0).target];
  ASSERT_EQ(counts.size(), spec.objects.size());
  for (const auto& [name, count] : counts) EXPECT_NEAR(count, 1000, 150) << name;
}

TEST(PlanEpisode, PutsTheObstacleInTheWayOfExactSharesOfTwenty) {
  CampaignSpec spec;
  for (const auto& [share, expected] : {std::pair{0.0, 0}, {0.25, 5}, {0.5, 10}, {0.9, 18}, {1.0, 20}}) {
    spec.obstacle.in_the_way = share;
    for (std::uint64_t block = 0; block < 5; ++block) {
      int in_the_way = 0;
      for (std::uint64_t i = 20 * block; i < 20 * (block + 1); ++i)
        in_the_way += PlanEpisode(spec, i, 0).obstacle == ObstaclePlace::kInTheWay;
      EXPECT_EQ(in_the_way, expected) << share;
    }
  }
  CampaignSpec other_seed = spec;
  spec.obstacle.in_the_way = other_seed.obstacle.in_the_way = 0.5;
  other_seed.seed = 2;
  int differ = 0;
  for (std::uint64_t i = 0; i < 100; ++i)
    differ += PlanEpisode(spec, i, 0).obstacle != PlanEpisode(other_seed, i, 0).obstacle;
  EXPECT_GT(differ, 20);
}

TEST(PlanEpisode, AttemptsShareAllButTheSeeds) {
  CampaignSpec spec;
  spec.tasks = {"place_left", "pick+obstacle", "push+others"};
  spec.objects_per_scene = 3;
  for (std::uint64_t i = 0; i < 60; ++i) {
    const EpisodePlan first = PlanEpisode(spec, i, 0), second = PlanEpisode(spec, i, 1);
    EXPECT_EQ(first.scene, second.scene);
    EXPECT_EQ(first.task.text(), second.task.text());
    EXPECT_EQ(first.target, second.target);
    EXPECT_EQ(first.reference, second.reference);
    EXPECT_EQ(first.avoid, second.avoid);
    EXPECT_EQ(first.obstacle, second.obstacle);
    EXPECT_NE(first.seed, second.seed);
    const std::set<std::uint64_t> streams{first.seeds.scene,       first.seeds.light,     first.seeds.instruction,
                                          first.seeds.disturbance, first.seeds.planning,  second.seeds.scene,
                                          second.seeds.light,      second.seeds.planning, second.seeds.instruction,
                                          first.seeds.occlusion,   first.seeds.pushes};
    EXPECT_EQ(streams.size(), 11u) << "no two streams are one";
  }
}

CampaignSpec Adaptive(double share) {
  CampaignSpec spec;
  spec.adaptive_sampling.share = share;
  return spec;
}

// Put down, cube and place 3 most, pick and coke least.
SamplingWeights Skewed(const CampaignSpec& spec) {
  SamplingWeights weights;
  for (const auto& task : spec.tasks) weights.tasks[task] = 1;
  for (const auto& object : spec.objects) weights.objects[ObjectNoun(object)] = 1;
  weights.places.assign(kPlaces, 0.8);
  weights.tasks["put_down"] = weights.objects["cube"] = weights.places[3] = 1.7;
  weights.tasks["pick"] = weights.objects["coke"] = 0.6;
  return weights;
}

void ExpectSameButWeights(const EpisodePlan& a, const EpisodePlan& b) {
  EXPECT_EQ(a.seed, b.seed) << a.index;
  EXPECT_EQ(a.task.text(), b.task.text()) << a.index;
  EXPECT_EQ(a.target, b.target) << a.index;
  EXPECT_EQ(a.reference, b.reference) << a.index;
  EXPECT_EQ(a.scene, b.scene) << a.index;
  EXPECT_EQ(a.world, b.world) << a.index;
  EXPECT_EQ(a.seeds.scene, b.seeds.scene) << a.index;
  EXPECT_EQ(a.place_weights, b.place_weights) << a.index;
}

TEST(PlanEpisode, AdaptiveSamplingChangesNothingBeforeThereAreWeights) {
  for (std::uint64_t i = 0; i < 100; ++i) {
    const EpisodePlan off = PlanEpisode(CampaignSpec(), i, 1), on = PlanEpisode(Adaptive(0.5), i, 1);
    ExpectSameButWeights(off, on);
    EXPECT_EQ(on.weights_sha256, "");
    EXPECT_FALSE(on.follows_weights);
    EXPECT_TRUE(on.place_weights.empty());
  }
}

TEST(PlanEpisode, AtMostTheShareOfEachBlockFollowsWeights) {
  for (const double share : {0.5, 0.15, 0.05, 0.9}) {
    const CampaignSpec spec = Adaptive(share);
    const SamplingWeights weights = Skewed(spec);
    const int most = static_cast<int>(std::lround(share * kSamplingBlock));
    int all = 0;
    for (std::uint64_t block = 0; block < 100; ++block) {
      int follow = 0;
      for (std::uint64_t i = block * kSamplingBlock; i < (block + 1) * kSamplingBlock; ++i)
        follow += PlanEpisode(spec, i, 0, weights).follows_weights;
      EXPECT_LE(follow, most) << share;
      all += follow;
    }
    // nine in ten are for training, and only those follow
    EXPECT_NEAR(all, 90.0 * most, 4 * std::sqrt(9.0 * most)) << share;
  }
}

TEST(PlanEpisode, WhatDoesNotFollowWeightsIsWhatItWasWithoutThem) {
  const CampaignSpec spec = Adaptive(0.5);
  const SamplingWeights weights = Skewed(spec);
  int others = 0, differ = 0;
  for (std::uint64_t i = 0; i < 400; ++i) {
    const EpisodePlan without = PlanEpisode(spec, i, 0), with = PlanEpisode(spec, i, 0, weights);
    EXPECT_EQ(with.weights_sha256, WeightsSha256(weights)) << "said all the same: they hold for it";
    EXPECT_EQ(with.seed, without.seed);
    EXPECT_EQ(with.scene, without.scene) << "the objects on the table are the scene's";
    if (with.follows_weights) {
      EXPECT_EQ(SplitOf(spec, i), "train");
      EXPECT_EQ(with.place_weights, weights.places);
      differ += with.task.text() != without.task.text() || with.target != without.target;
      continue;
    }
    ExpectSameButWeights(with, without);
    ++others;
  }
  EXPECT_GE(others, 200);
  EXPECT_GT(differ, 100);
}

// the same from weights that were written down and read again, in another order, for every attempt
TEST(PlanEpisode, IsAPureFunctionOfSpecWeightsIndexAndAttempt) {
  const CampaignSpec spec = Adaptive(0.9);
  const SamplingWeights weights = Skewed(spec);
  const auto read = ParseWeights(WeightsText(weights), spec);
  ASSERT_TRUE(read) << read.error().message;
  std::vector<EpisodePlan> forwards;
  for (std::uint64_t i = 0; i < 60; ++i) forwards.push_back(PlanEpisode(spec, i, 2, weights));
  for (std::uint64_t i = 60; i-- > 0;) {
    const EpisodePlan again = PlanEpisode(spec, i, 2, *read), first = PlanEpisode(spec, i, 0, *read);
    ExpectSameButWeights(again, forwards[i]);
    EXPECT_EQ(again.weights_sha256, forwards[i].weights_sha256);
    EXPECT_EQ(again.follows_weights, forwards[i].follows_weights);
    EXPECT_EQ(first.task.text(), again.task.text()) << "a retry swaps no hard task for an easy one";
    EXPECT_EQ(first.target, again.target);
    EXPECT_EQ(first.place_weights, again.place_weights);
  }
}

// k of n within four standard deviations of a binomial with probability p
void ExpectBinomial(int k, int n, double p, const std::string& what) {
  EXPECT_NEAR(k, n * p, 4 * std::sqrt(n * p * (1 - p))) << what;
}

TEST(PlanEpisode, TwoThousandPlansFollowTheWeights) {
  CampaignSpec spec = Adaptive(0.9);
  spec.task_weights = {4, 3, 3};
  const SamplingWeights weights = Skewed(spec);
  std::map<std::string, int> tasks, targets;
  int n = 0;
  for (std::uint64_t i = 0; i < 2000; ++i) {
    const EpisodePlan plan = PlanEpisode(spec, i, 0, weights);
    if (!plan.follows_weights) continue;
    ++n;
    ++tasks[plan.task.text()];
    ++targets[plan.target];
  }
  ASSERT_GT(n, 1500);
  double task_total = 0, target_total = 0;
  for (std::size_t k = 0; k < spec.tasks.size(); ++k)
    task_total += spec.task_weights[k] * weights.tasks.at(spec.tasks[k]);
  for (const auto& [noun, weight] : weights.objects) target_total += weight;
  for (std::size_t k = 0; k < spec.tasks.size(); ++k)
    ExpectBinomial(tasks[spec.tasks[k]], n, spec.task_weights[k] * weights.tasks.at(spec.tasks[k]) / task_total,
                   spec.tasks[k]);
  for (const auto& [noun, weight] : weights.objects) ExpectBinomial(targets[noun], n, weight / target_total, noun);
}

TEST(PlanEpisode, WeightedTargetsAreOnTheTableAndHaveTheirReference) {
  CampaignSpec spec = Adaptive(0.9);
  spec.tasks = {"pick", "put_down", "place_left"};
  spec.objects = {"cube", "coke", "milk", "bread", "apple_00", "apple_01"};
  spec.objects_per_scene = 3;
  const SamplingWeights weights = Skewed(spec);
  int follow = 0;
  for (std::uint64_t i = 0; i < 200; ++i) {
    const EpisodePlan plan = PlanEpisode(spec, i, 0, weights);
    follow += plan.follows_weights;
    EXPECT_THAT(SceneNames(plan.scene.objects), testing::Contains(plan.target)) << i;
    if (!plan.task.relation()) continue;
    EXPECT_NE(plan.reference, plan.target) << i;
    EXPECT_THAT(SceneNames(plan.scene.objects), testing::Contains(plan.reference)) << i;
  }
  EXPECT_GT(follow, 100);
}

TEST(SamplingDetails, AreReadBackWhateverElseIsThere) {
  const CampaignSpec spec = Adaptive(0.5);
  const EpisodePlan plan = PlanEpisode(spec, 3, 0, Skewed(spec));
  OrderedJson details{{"cost", 1}};
  details["sampling"] = SamplingDetails(plan);
  EXPECT_EQ(WeightsOf(details), plan.weights_sha256);
  for (const char* text : {"{}", "[]", "7", "null", R"({"sampling": 1})", R"({"sampling": ["weights_sha256"]})",
                           R"({"sampling": {"weights_sha256": 7}})"})
    EXPECT_EQ(WeightsOf(OrderedJson::parse(text)), "") << text;
}

TEST(PlanEpisode, AvoidsWhatTheTaskSays) {
  CampaignSpec spec;
  spec.tasks = {"pick", "pick+obstacle", "push+others"};
  for (std::uint64_t i = 0; i < 30; ++i) {
    const EpisodePlan plan = PlanEpisode(spec, i, 0);
    if (i % 3 == 0) {
      EXPECT_TRUE(plan.avoid.empty());
    } else if (i % 3 == 1) {
      EXPECT_THAT(plan.avoid, testing::ElementsAre(kObstacleObject));
    } else {
      EXPECT_EQ(plan.avoid.size(), spec.objects.size() - 1);
      EXPECT_THAT(plan.avoid, testing::Not(testing::Contains(plan.target)));
    }
  }
}

CampaignSpec Speaking() {
  CampaignSpec spec;
  spec.mode = "rollout";
  spec.rollout.run = "demo";
  spec.tasks = {"push", "pick", "place_left"};
  spec.rollout.sentences = {{"push the lager", "push", "bottle", ""},
                            {"fetch the fruit", "pick", "apple", ""},
                            {"tea beside the loaf", "place_left", "mug_05", "bread"},
                            {"fetch the fizz", "pick", "coke", ""}};
  spec.objects = {"cube", "coke", "pepsi", "milk", "bread", "bottle", "mug_00", "mug_05"};
  for (const auto& apple : {"apple_03", "apple_04", "apple_05", "apple_06"}) spec.objects.push_back(apple);
  spec.objects_per_scene = 3;
  return spec;
}

TEST(PlanEpisode, SpeaksItsSentencesInTurnInScenesOfWhatTheyMean) {
  const CampaignSpec spec = Speaking();
  ASSERT_TRUE(spec.Validate()) << spec.Validate().error().message;
  std::set<std::string> apples;
  for (std::uint64_t i = 0; i < 200; ++i) {
    const EpisodePlan plan = PlanEpisode(spec, i, 0);
    const SentenceSpec& sentence = spec.rollout.sentences[i % 4];
    EXPECT_EQ(plan.sentence, sentence.text);
    EXPECT_EQ(plan.task.text(), sentence.task);
    EXPECT_TRUE(IsNamed(plan.target, sentence.object)) << plan.target;
    EXPECT_EQ(plan.reference, sentence.reference);
    EXPECT_THAT(plan.scene.objects, testing::Contains(plan.target));
    std::set<std::string> classes;
    for (const auto& object : plan.scene.objects) classes.insert(ObjectNoun(object));
    EXPECT_EQ(classes.size(), 3u) << "three objects, one of a class, " << i;
    if (i % 4 == 1) apples.insert(plan.target);
    if (i % 4 != 2) continue;
    EXPECT_EQ(plan.target, "mug_05") << "the one that is named";
    EXPECT_THAT(plan.scene.objects, testing::Contains("bread"));
  }
  EXPECT_EQ(apples.size(), 4u) << "every instance of a class has its turn";
}

TEST(PlanEpisode, SentencesChangeNoSceneThatHasTheirObjects) {
  CampaignSpec spec;
  spec.mode = "rollout";
  spec.tasks = {"push"};
  CampaignSpec spoken = spec;
  spoken.rollout.sentences = {{"shove the lager", "push", "bottle", ""}};
  for (std::uint64_t i = 0; i < 20; ++i) {
    const EpisodePlan plan = PlanEpisode(spec, i, 0), said = PlanEpisode(spoken, i, 0);
    EXPECT_EQ(plan.sentence, "") << "it is drawn";
    EXPECT_EQ(said.scene, plan.scene);
    EXPECT_EQ(said.seed, plan.seed);
  }
  spoken.mode = "demonstrate";
  EXPECT_EQ(PlanEpisode(spoken, 0, 0).sentence, "") << "nobody speaks to the expert";
}

}  // namespace episode_plan_test
}  // namespace etude
