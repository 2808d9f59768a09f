// SPDX-License-Identifier: Apache-2.0
// Tests services/spec/campaign_spec.cc
#include "services/spec/campaign_spec.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <map>
#include <set>

#include "services/core/config_reference.h"
#include "services/core/hash.h"
#include "services/spec/content_version.h"
#include "services/spec/object_names.h"
#include "services/spec/task_name.h"
#include "tests/support/matchers.h"

namespace etude {
namespace campaign_spec_test {

TEST(CampaignSpec, SaysOfEveryKeyWhatItMeansAndInWhichUnit) {
  EXPECT_THAT(MissingFromReference(ConfigReference<CampaignSpec>()), testing::IsEmpty());
}

TEST(CampaignSpec, DefaultsAreValid) { EXPECT_THAT(CampaignSpec().Validate(), IsOk()); }

TEST(CampaignSpec, ReportsAllProblemsAtOnceWithTheNearestName) {
  CampaignSpec spec;
  spec.tasks = {"pik"};
  spec.image_stride = 0;
  spec.name = "../evil";

  const Status status = spec.Validate();

  EXPECT_THAT(status, HasCode(Code::kInvalidArgument));
  EXPECT_THAT(status, MessageHas("did you mean 'pick'"));
  EXPECT_THAT(status, MessageHas("image_stride"));
  EXPECT_THAT(status, MessageHas("name"));
}

// The default campaign with keys set as `--set` does.
Result<CampaignSpec> With(const std::vector<std::string>& overrides) {
  OrderedJson json = ToJson(CampaignSpec());
  for (const auto& text : overrides) ETUDE_RETURN_IF_ERROR(ApplyOverride(json, text));
  return FromJson<CampaignSpec>(json, "test.yaml");
}

Status Validated(const std::vector<std::string>& overrides) {
  ETUDE_ASSIGN_OR_RETURN(const CampaignSpec spec, With(overrides));
  return spec.Validate();
}

/// An override, and what is said of it.
using Refusals = std::initializer_list<std::pair<const char*, const char*>>;

void ExpectRefused(Refusals refusals) {
  for (const auto& [override_text, says] : refusals) {
    EXPECT_THAT(Validated({override_text}), HasCode(Code::kInvalidArgument)) << override_text;
    EXPECT_THAT(Validated({override_text}), MessageHas(says)) << override_text;
  }
}

TEST(CampaignSpec, RefusesWhatIsOutOfRangeAndSaysWhatIsAllowed) {
  ExpectRefused({{"name=My Campaign", "name: 'My Campaign' must match [a-z0-9_-]{1,64}"},
                 {"mode=demo", "mode: 'demo' is not known; known: demonstrate, rollout"},
                 {"mode=rolout", "mode: 'rolout' is not known, did you mean 'rollout'?"},
                 {"scenes=feasable", "scenes: 'feasable' is not known, did you mean 'feasible'?"},
                 {"episodes=0", "episodes: 0 not in 1..10^7"},
                 {"episodes=10000001", "episodes: 10000001 not in 1..10^7"},
                 {"image_stride=0", "image_stride: 0 not in 1..125"},
                 {"image_stride=126", "image_stride: 126 not in 1..125"},
                 {"max_attempts=0", "max_attempts: 0 not in 1..1000"},
                 {"max_attempts=1001", "max_attempts: 1001 not in 1..1000"},
                 {"stall_timeout_s=0.5", "stall_timeout_s: 0.5 not in 1..86400"},
                 {"determinism=byte", "determinism"},
                 {"recheck=1.5", "recheck: 1.5 not in 0..1"},
                 {"recheck=-0.1", "recheck: -0.1 not in 0..1"},
                 {"renderer=cuda", "renderer: 'cuda' is not known"},
                 {"device=0", "device: only with renderer: gpu"},
                 {"device=-2", "device: -2 not in -1..63"},
                 {"device=64", "device: 64 not in -1..63"},
                 {"camera.width=15", "camera: 15x224 not in 16..2048"},
                 {"camera.height=2049", "camera: 224x2049 not in 16..2048"},
                 {"camera.fovy_deg=1", "camera.fovy_deg: not in 1..170"},
                 {"camera.fovy_deg=170", "camera.fovy_deg: not in 1..170"},
                 {"camera.position=[0, 1]", "camera.position: three numbers"},
                 {"camera.position=[0, 12, 8]", "camera.position: more than 11 m from the table"},
                 {"camera.euler=[0, 1, 2, 3]", "camera.euler: three numbers"},
                 {"randomization.yaw=-0.1", "randomization.yaw: -0.1 not in 0..3.2"},
                 {"randomization.yaw=3.3", "randomization.yaw: 3.3 not in 0..3.2"},
                 {"randomization.start_position=0.31", "randomization.start_position: 0.31 not in 0..0.3"},
                 {"randomization.start_orientation=0.81", "randomization.start_orientation: 0.81 not in 0..0.8"},
                 {"randomization.disturbance=0.21", "randomization.disturbance: 0.21 not in 0..0.2"},
                 {"randomization.disturbance_probability=1.1", "disturbance_probability: 1.1 not in 0..1"},
                 {"randomization.light=2", "randomization.light: 2 not in 0..1"},
                 {"obstacle.in_the_way=-0.1", "obstacle.in_the_way: -0.1 not in 0..1"},
                 {"obstacle.in_the_way=1.1", "obstacle.in_the_way: 1.1 not in 0..1"},
                 {"obstacle.clearance=0.5", "obstacle.clearance: 0.5 not in 0.01..0.3"},
                 {"split={train: 0, valid: 0, test: 0}", "split: fractions must be >= 0 and not all 0"},
                 {"split={train: 1600, test: 400}", "split: 1600, 0.1 and 400 of train, valid and test are counts and"},
                 {"tasks=[pick, push, pick]", "tasks: 'pick' twice"},
                 {"split.valid=-0.1", "split: fractions must be >= 0 and not all 0"},
                 {"split.train=.inf", "split.train"},
                 {"camera.position=[.nan, 1, 1]", "camera.position[0]"},
                 {"camera.euler=[0, .inf, 0]", "camera.euler[1]"},
                 {"world.friction=9", "world.friction: 9 not in 0.1..4"}});
}

TEST(CampaignSpec, RefusesRobotsTasksAndObjectsThatAreNotKnownOrDoNotFit) {
  ExpectRefused(
      {{"robots=[]", "robots: at least one"},
       {"robots=[ur5, pandda]", "robots: 'pandda' is not known, did you mean 'panda'?"},
       {"tasks=[]", "tasks: at least one"},
       {"tasks=[push+obstacles]", "did you mean 'push+obstacle'?"},
       {"task_weights=[1, 2]", "task_weights: 2 for 3 tasks"},
       {"task_weights=[1, 0, 1]", "task_weights: 0 must be > 0"},
       {"task_weights=[1, -2, 1]", "task_weights: -2 must be > 0"},
       {"objects=[]", "objects: 0 on the table, between 1 and 6 fit"},
       {"objects=[cube, cokke]", "objects: 'cokke' is not known, did you mean 'coke'?"},
       {"objects=[cube, cube]", "one of each at most"},
       {"objects=[cube, coke, pepsi, milk, bread, bottle, mug_00]", "7 on the table, between 1 and 6 fit; set obj"},
       {"objects_per_scene=7", "objects_per_scene: 7 of 6 objects"},
       {"objects_per_scene=-1", "objects: -1 on the table"},
       {"objects=[my/duck, your/duck]", "objects: each name at most once"},
       {"objects=[cube, my/coke]", "objects: 'my/coke': sentences would call it what the built-in coke is called"},
       {"objects=[cube, my/basketball/object.yaml]",
        "what the built-in basketball is called; give its folder another"}});
}

// before, all that such a campaign made said one side and showed the other, and its judge agreed
TEST(CampaignSpec, SidesAreAsTheCameraShowsThem) {
  const std::vector<std::string> behind{"camera.position=[0, -1.5, 1]", "camera.euler=[1, 0, 0]"};
  std::vector<std::string> sides = behind, none = behind;
  sides.emplace_back("tasks=[pick, place_left]");
  none.emplace_back("tasks=[pick, push]");
  EXPECT_THAT(Validated(sides), MessageHas("as seen from +y"));
  EXPECT_THAT(Validated(none), IsOk());
  EXPECT_THAT(Validated({"tasks=[pick, place_left, place_behind]"}), IsOk());
}

TEST(CampaignSpec, ARolloutsKeysAreLookedAtInRolloutsOnly) {
  for (const auto& [override_text, says] :
       Refusals{{"rollout.run=''", "rollout.run: '' must be a run's name"},
                {"rollout.run=../x", "rollout.run: '../x' must be a run's name"},
                {"rollout.replan_steps=0", "rollout.replan_steps: 0 not in 1..120"},
                {"rollout.replan_steps=121", "rollout.replan_steps: 121 not in 1..120"},
                {"rollout.max_steps=0", "rollout.max_steps: 0 not in 1..100000"},
                {"rollout.max_steps=100001", "rollout.max_steps: 100001 not in 1..100000"},
                {"rollout.latency_ms=-2", "rollout.latency_ms: -2 not in 0..960"},
                {"rollout.latency_ms=961", "rollout.latency_ms: 961 not in 0..960"},
                {"rollout.occlude=-0.1", "rollout.occlude: -0.1 not in 0..1"},
                {"rollout.occlude=1.1", "rollout.occlude: 1.1 not in 0..1"},
                {"rollout.pushes.count=11", "rollout.pushes.count: 11 not in 0..10"},
                {"rollout.sentences=[{text: hi, task: pick, object: milkk}]", "did you mean 'milk'?"}}) {
    EXPECT_THAT(Validated({"mode=rollout", "rollout.run=demo", override_text}), MessageHas(says)) << override_text;
    EXPECT_THAT(Validated({override_text}), IsOk()) << override_text;
  }
  EXPECT_THAT(Validated({"mode=rollout", "rollout.run=demo", "rollout.latency_ms=960"}), IsOk());
}

TEST(CampaignSpec, TakesEveryRangeUpToItsEnds) {
  for (const char* text : {"task_weights=[0.001, 1, 1000]",
                           "objects=[cube]",
                           "objects=[cube, my/duck, my/mug_00]",
                           "objects_per_scene=6",
                           "objects_per_scene=1",
                           "episodes=1",
                           "episodes=10000000",
                           "image_stride=125",
                           "max_attempts=1",
                           "max_attempts=1000",
                           "camera.width=16",
                           "camera.height=2048",
                           "camera.fovy_deg=169.9",
                           "randomization.yaw=0",
                           "randomization.yaw=3.2",
                           "randomization.start_position=0.3",
                           "randomization.start_orientation=0.8",
                           "randomization.disturbance=0.2",
                           "randomization.disturbance_probability=1",
                           "randomization.light=1",
                           "obstacle.in_the_way=0",
                           "obstacle.in_the_way=1",
                           "split={train: 0, valid: 0, test: 1}",
                           "rollout.execution=authors",
                           "scenes=first_draw",
                           "renderer=gpu",
                           "robots=[ur5, panda, jaco2]",
                           "tasks=[pick+others]",
                           "world.control_delay=50"})
    EXPECT_THAT(Validated({text}), IsOk()) << text;
}

TEST(CampaignSpec, AnotherClearanceMakesOtherEpisodes) {
  const auto hash_with = [](double clearance) {
    CampaignSpec spec;
    spec.obstacle.clearance = clearance;
    return SpecHash(spec);
  };
  EXPECT_NE(hash_with(0.08), hash_with(0.05));
  EXPECT_EQ(hash_with(0.05), SpecHash(CampaignSpec()));
}

TEST(CampaignSpec, ATaskWithAReferenceNeedsSomethingToReferTo) {
  // before, every scene of such a task had two of one name, and its episodes were given up
  EXPECT_THAT(Validated({"tasks=[pick, pick+obstacle]", "objects=[cube, basketball]"}),
              MessageHas("the basketball is put there by the tasks with +obstacle"));
  EXPECT_THAT(Validated({"tasks=[pick]", "objects=[cube, basketball]"}), IsOk());
  EXPECT_THAT(Validated({"tasks=[place_left]", "objects=[cube]"}), MessageHas("'place_left' needs a second one"));
  EXPECT_THAT(Validated({"tasks=[place_left]", "objects=[cube, milk]"}), IsOk());
  EXPECT_THAT(Validated({"tasks=[stack]", "objects=[milk, bread]"}),
              MessageHas("task 'stack' needs one of cube, coke, pepsi to refer to, and another one to move"));
  EXPECT_THAT(Validated({"tasks=[stack]", "objects=[milk, cube]"}), IsOk());
}

// Calls `visit` with a copy of `json` for every value in it, where that value is another one of its kind.
void ForEveryChange(OrderedJson& json, const std::string& path, OrderedJson& whole,
                    const std::function<void(const std::string& path, const OrderedJson& changed)>& visit) {
  if (json.is_object()) {
    for (auto& [key, value] : json.items()) ForEveryChange(value, path.empty() ? key : path + "." + key, whole, visit);
    return;
  }
  const OrderedJson before = json;
  if (before.is_boolean()) json = !before.get<bool>();
  if (before.is_number_integer()) json = before.get<int>() + 1;
  if (before.is_number_unsigned()) json = before.get<std::uint64_t>() + 1;
  if (before.is_number_float()) json = before.get<double>() + 0.001;
  if (before.is_string()) json = before.get<std::string>() + "x";
  const OrderedJson first = path.ends_with("sentences") ? OrderedJson::object() : OrderedJson(1);
  if (before.is_array()) json.push_back(before.empty() ? first : before.front());
  visit(path, whole);
  json = before;
}

TEST(CampaignSpec, EveryOtherKeyIsAnotherCampaign) {
  const CampaignSpec spec;
  OrderedJson json = ToJson(spec);
  int keys = 0;
  ForEveryChange(json, "", json, [&](const std::string& path, const OrderedJson& changed) {
    const auto other = FromJson<CampaignSpec>(changed, path);
    ASSERT_THAT(other, IsOk());
    const bool may_grow = path == "name" || path == "episodes" || path == "max_attempts" || path == "stall_timeout_s" ||
                          path == "determinism" || path == "recheck" || path == "device" || path.starts_with("split.");
    EXPECT_EQ(SpecHash(*other) == SpecHash(spec), may_grow) << path;
    ++keys;
  });
  EXPECT_GT(keys, 40) << "all of them, those of sections too";
}

// Campaigns of before RolloutSpec had these keys go on: their hash is the one that they were made with.
TEST(CampaignSpec, KeysThatCameLaterChangeNoHashWhileTheyAreUnset) {
  const CampaignSpec spec;
  OrderedJson json = ToJson(spec);
  for (const char* key : {"name", "episodes", "split", "max_attempts", "stall_timeout_s", "determinism", "recheck"})
    json.erase(key);
  for (const char* key : {"renderer", "device"}) ASSERT_EQ(json.erase(key), 1u) << key;
  ASSERT_EQ(json["obstacle"].erase("clearance"), 1u);
  for (const char* key : {"execution", "occlude", "pushes", "sentences"})
    ASSERT_EQ(json["rollout"].erase(key), 1u) << key;
  ASSERT_EQ(json["randomization"].erase("world"), 1u);
  ASSERT_EQ(json.erase("adaptive_sampling"), 1u);
  json["content"] = kContentVersion;
  json["task_files"] = OrderedJson::array();
  for (const auto& task : spec.tasks) json["task_files"].push_back(ParseTask(task)->spec->sha256);
  EXPECT_EQ(SpecHash(spec), Sha256Hex(json.dump()));
}

TEST(CampaignSpec, AdaptiveSamplingHasBoundsAndIsForDemonstrations) {
  ExpectRefused({{"adaptive_sampling.share=0.95", "adaptive_sampling.share: 0.95 not in 0.05..0.9, nor 0 (off)"},
                 {"adaptive_sampling.share=0.01", "adaptive_sampling.share"},
                 {"adaptive_sampling.share=-1", "adaptive_sampling.share"},
                 {"adaptive_sampling.share=.nan", "adaptive_sampling"},
                 {"adaptive_sampling.largest_ratio=0.9", "adaptive_sampling.largest_ratio: 0.9 not in 1..10"},
                 {"adaptive_sampling.every=9", "adaptive_sampling.every: 9 not in 10..10^6"}});
  EXPECT_THAT(Validated({"adaptive_sampling.share=0.5"}), IsOk());
  EXPECT_THAT(Validated({"mode=rollout", "rollout.run=demo", "adaptive_sampling.share=0.5"}),
              MessageHas("adaptive_sampling: only for mode demonstrate"));
}

TEST(CampaignSpec, EpisodesAreMadeAgainWhereTheirBytesMustAgree) {
  EXPECT_THAT(Validated({"recheck=0.02"}), IsOk());
  EXPECT_THAT(Validated({"recheck=1"}), IsOk());
  EXPECT_THAT(Validated({"recheck=0.02", "determinism=physics"}), MessageHas("recheck: only for mode demonstrate"));
  EXPECT_THAT(Validated({"recheck=0.02", "mode=rollout", "rollout.run=demo"}),
              MessageHas("recheck: only for mode demonstrate"));
}

// which episodes follow weights depends on the split, so that it is part of what makes their bytes
TEST(CampaignSpec, WithAdaptiveSamplingTheSplitMayNotChange) {
  CampaignSpec spec;
  spec.adaptive_sampling.share = 0.5;
  CampaignSpec other = spec;
  other.split.train = 0.5;
  EXPECT_NE(SpecHash(spec), SpecHash(other));
  other = spec;
  other.episodes = 7;
  EXPECT_EQ(SpecHash(spec), SpecHash(other));
}

// Which GPU of a host draws is the host's matter; that one draws is another campaign's bytes.
TEST(CampaignSpec, AnotherRendererIsAnotherCampaignAndAnotherGpuIsNone) {
  EXPECT_THAT(Validated({"renderer=gpu", "device=2"}), IsOk());
  CampaignSpec gpu;
  gpu.renderer = "gpu";
  CampaignSpec second = gpu;
  second.device = 1;
  EXPECT_NE(SpecHash(CampaignSpec()), SpecHash(gpu));
  EXPECT_EQ(SpecHash(second), SpecHash(gpu));
}

TEST(CampaignSpec, HashIgnoresOnlyWhatMayGrow) {
  const CampaignSpec spec;
  CampaignSpec longer = spec;
  longer.episodes = 7;
  longer.name = "other";
  longer.max_attempts = 3;
  longer.split.train = 0.5;
  CampaignSpec other_seed = spec;
  other_seed.seed = 2;
  CampaignSpec other_camera = spec;
  other_camera.camera.position[1] += 1e-9;

  EXPECT_EQ(SpecHash(spec), SpecHash(longer));
  EXPECT_NE(SpecHash(spec), SpecHash(other_seed));
  EXPECT_NE(SpecHash(spec), SpecHash(other_camera));
}

TEST(CampaignSpec, SplitsAreStableAndNearTheirFractions) {
  CampaignSpec spec;
  CampaignSpec longer = spec;
  longer.episodes = 10 * spec.episodes;

  int valid = 0;
  for (std::uint64_t i = 0; i < 5000; ++i) {
    EXPECT_EQ(SplitOf(spec, i), SplitOf(longer, i));
    valid += SplitOf(spec, i) == "valid" ? 1 : 0;
  }

  EXPECT_NEAR(valid / 5000.0, 0.1, 0.02);
}

std::map<std::string, int> SplitCounts(const CampaignSpec& spec, std::uint64_t from, std::uint64_t count) {
  std::map<std::string, int> counts;
  for (std::uint64_t i = from; i < from + count; ++i) ++counts[SplitOf(spec, i)];
  return counts;
}

TEST(CampaignSpec, WholeNumbersSplitExactly) {
  struct Row {
    SplitSpec split;
    std::uint64_t block;
  };
  for (const Row& row : {Row{{1600, 400, 400}, 6}, Row{{320, 80, 80}, 6}, Row{{260, 80, 0}, 17}, Row{{200, 400, 0}, 3},
                         Row{{3000, 600, 0}, 6}, Row{{7, 0, 3}, 10}, Row{{0, 5, 0}, 1}}) {
    CampaignSpec spec;
    spec.split = row.split;
    const auto [train, valid, test] = spec.split;
    EXPECT_EQ(SplitBlock(spec.split), row.block);
    for (const std::uint64_t seed : {1, 2, 99}) {
      spec.seed = seed;
      const auto total = static_cast<std::uint64_t>(train + valid + test);
      auto counts = SplitCounts(spec, 0, total);
      EXPECT_EQ(counts["train"], train);
      EXPECT_EQ(counts["valid"], valid);
      EXPECT_EQ(counts["test"], test);
      counts = SplitCounts(spec, 5 * row.block, row.block);
      EXPECT_EQ(counts["train"] * static_cast<int>(total / row.block), train) << "each block by itself";
    }
  }
}

TEST(CampaignSpec, ExactSplitsAreDrawnAnewInEachBlockAndFollowTheSeed) {
  CampaignSpec spec, other_seed, longer;
  spec.split = other_seed.split = longer.split = {4, 1, 1};
  other_seed.seed = 2;
  longer.episodes = 10 * spec.episodes;
  std::map<std::uint64_t, int> test_at;  // place in its block -> how often
  int differ = 0;
  for (std::uint64_t i = 0; i < 6000; ++i) {
    EXPECT_EQ(SplitOf(spec, i), SplitOf(longer, i));
    differ += SplitOf(spec, i) != SplitOf(other_seed, i);
    if (SplitOf(spec, i) == "test") ++test_at[i % 6];
  }
  EXPECT_GT(differ, 2000);
  ASSERT_EQ(test_at.size(), 6u) << "every place of a block";
  for (const auto& [place, count] : test_at) EXPECT_NEAR(count, 1000.0 / 6, 60) << place;
}

TEST(CampaignSpec, FractionsNeedNotAddUpToOne) {
  CampaignSpec half, whole;
  half.split = {0.35, 0.1, 0.05};
  whole.split = {0.7, 0.2, 0.1};
  std::map<std::string, int> counts = SplitCounts(half, 0, 4000);
  EXPECT_NEAR(counts["train"], 2800, 120);
  EXPECT_NEAR(counts["valid"], 800, 100);
  EXPECT_NEAR(counts["test"], 400, 80);
  EXPECT_EQ(counts, SplitCounts(whole, 0, 4000)) << "only their ratios count";
}

TEST(CampaignSpec, FractionsAndHugeBlocksAreDrawnOneByOne) {
  EXPECT_EQ(SplitBlock({0.9, 0.1, 0}), 0u);
  EXPECT_EQ(SplitBlock({90.5, 9.5, 0}), 0u);
  EXPECT_EQ(SplitBlock({99'991, 7, 0}), 0u) << "no block of 99,998";
  CampaignSpec spec;
  spec.split = {99'991, 7, 0};
  EXPECT_EQ(SplitOf(spec, 3), SplitOf(spec, 3));
}

TEST(CampaignSpec, OneObjectOfAClassAtMost) {
  CampaignSpec spec;
  spec.objects = {"apple_00", "apple_01", "mug_00"};
  EXPECT_THAT(spec.Validate(), MessageHas("one of each at most"));
  spec.objects_per_scene = 2;
  spec.tasks = {"pick", "place_left"};
  EXPECT_THAT(spec.Validate(), IsOk());
  spec.objects = {"apple_00", "apple_01"};
  EXPECT_THAT(spec.Validate(), MessageHas("2 on the table of 1 classes")) << "nothing to put it beside";
}

}  // namespace campaign_spec_test
}  // namespace etude
