// SPDX-License-Identifier: Apache-2.0
// Tests services/campaign/spec_file.cc and the files in deploy/campaigns
#include "services/campaign/spec_file.h"

#include <gmock/gmock.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <map>
#include <set>

#include "services/core/file.h"
#include "services/spec/episode_plan.h"
#include "services/spec/task_name.h"
#include "services/store/dataset.h"
#include "tests/support/matchers.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude::campaign {
namespace spec_file_test {

const Path kFolder = "deploy/campaigns";

Result<CampaignSpec> Load(const std::string& name) {
  return LoadSpec({.file = (kFolder / (name + ".yaml")).string(), .episodes = {}, .seed = {}, .overrides = {}});
}

TEST(CampaignFiles, AllLoadAreNamedAsTheirFileAndSayWhatTheyAre) {
  int files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(kFolder)) {
    if (entry.path().extension() != ".yaml") continue;
    ++files;
    const auto spec = Load(entry.path().stem().string());
    ASSERT_THAT(spec, IsOk()) << entry.path();
    EXPECT_EQ(spec->name, entry.path().stem().string());
    EXPECT_TRUE(ReadTextFile(entry.path()).value().starts_with("# ")) << entry.path();
    if (const std::uint64_t block = SplitBlock(spec->split); block > 0) {
      EXPECT_EQ(spec->episodes % block, 0u) << entry.path() << ": counts are exact only after whole blocks";
    }
  }
  EXPECT_GE(files, 15);
}

struct Row {
  std::string file, robot, task;  // task: one of them
  std::array<int, 3> counts;      // train, valid, test
};

// Table 2 of the paper; "live" rows have no test set.
TEST(CampaignFiles, HaveTheCountsOfThePaper) {
  const std::vector<Row> rows{{"ur5", "ur5", "put_down", {1600, 400, 400}},
                              {"kinova", "jaco2", "put_down", {1600, 400, 400}},
                              {"ur5_transfer", "ur5", "push", {320, 80, 80}},
                              {"franka_transfer", "panda", "push", {320, 80, 80}},
                              {"real_world_stand_in", "ur5", "pick", {260, 80, 0}},
                              {"obstacle", "ur5", "pick+obstacle", {200, 400, 0}},
                              {"multi_obstacle", "ur5", "push+others", {200, 400, 0}},
                              {"novel_objects", "ur5", "rotate", {3000, 600, 0}},
                              {"relations", "ur5", "place_right", {3000, 600, 0}}};
  for (const Row& row : rows) {
    const auto spec = Load(row.file);
    ASSERT_THAT(spec, IsOk());
    EXPECT_THAT(spec->robots, testing::ElementsAre(row.robot)) << row.file;
    EXPECT_THAT(spec->tasks, testing::Contains(row.task)) << row.file;
    std::map<std::string, int> counts;
    for (std::uint64_t i = 0; i < spec->episodes; ++i) ++counts[SplitOf(*spec, i)];
    EXPECT_THAT((std::array{counts["train"], counts["valid"], counts["test"]}), testing::ElementsAreArray(row.counts))
        << row.file;
  }
}

TEST(CampaignFiles, TestObjectsAreNoneOfTraining) {
  for (const std::string name : {"novel_objects", "relations_generated"}) {
    const auto train = Load(name), test = Load(name + "_test");
    ASSERT_THAT(train, IsOk());
    ASSERT_THAT(test, IsOk());
    EXPECT_EQ(train->objects.size(), 30u) << name;
    EXPECT_EQ(test->objects.size(), 70u) << name;
    for (const auto& object : test->objects)
      EXPECT_THAT(train->objects, testing::Not(testing::Contains(object))) << name;
    EXPECT_EQ(train->tasks, test->tasks) << name;
    EXPECT_EQ(train->camera, test->camera) << name;
  }
}

TEST(CampaignFiles, MixedHasEveryRobotWithEveryTask) {
  const auto spec = Load("mixed");
  ASSERT_THAT(spec, IsOk());
  std::map<std::string, std::map<std::string, int>> tasks;  // robot -> task -> episodes
  for (std::uint64_t i = 0; i < spec->episodes; ++i) {
    const EpisodePlan plan = PlanEpisode(*spec, i, 0);
    ++tasks[plan.scene.robot][plan.task.text()];
  }
  ASSERT_EQ(tasks.size(), 3u);
  for (const auto& [robot, counts] : tasks) {
    EXPECT_EQ(counts.size(), spec->tasks.size()) << robot;
    for (const char* base :
         {"pick", "push", "put_down", "rotate", "place_left", "place_right", "place_front", "place_behind"})
      EXPECT_TRUE(counts.contains(base)) << robot << " " << base;
  }
}

// What the stand-in looks like is kept from a policy that is trained on `robust`.
TEST(CampaignFiles, RobustNeverShowsTheStandIn) {
  const auto robust = Load("robust"), stand_in = Load("real_world_stand_in");
  ASSERT_THAT(robust, IsOk());
  ASSERT_THAT(stand_in, IsOk());
  const auto near = [](const auto& a, const auto& b, double within) {
    for (std::size_t i = 0; i < 3; ++i)
      if (std::abs(a[i] - b[i]) > within) return false;
    return true;
  };
  const CameraSpec& camera = stand_in->camera;
  std::set<std::string> tables;
  ASSERT_EQ(robust->episodes, 1600u);
  for (std::uint64_t i = 0; i < robust->episodes; ++i) {
    const EpisodePlan plan = PlanEpisode(*robust, i, 0);
    ASSERT_TRUE(plan.world.camera) << i;
    EXPECT_TRUE(SeesWorkVolume(*plan.world.camera)) << i;
    EXPECT_FALSE(near(plan.world.camera->position, camera.position, 0.01)) << i;
    EXPECT_GT(plan.world.camera->fovy_deg, camera.fovy_deg + 1) << i;
    tables.insert(plan.world.table);
    EXPECT_EQ(plan.world.colour.size(), plan.scene.objects.size());
    for (const auto& [name, gain] : plan.world.colour)
      EXPECT_FALSE(near(gain, stand_in->world.object_colour, 0.002)) << i << " " << name;
    EXPECT_FALSE(near(*plan.world.background, stand_in->world.background, 0.002)) << i;
  }
  EXPECT_THAT(tables, testing::ElementsAre("plain", "stone", "wood"));
  EXPECT_THAT(tables, testing::Not(testing::Contains(stand_in->world.table)));
}

TEST(LoadSpec, SaysWhereCampaignFilesAre) {
  EXPECT_THAT(Load("no_such_campaign"), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(Load("no_such_campaign"), MessageHas("deploy/campaigns/"));
}

TEST(LoadSpec, FlagsReplaceWhatTheFileSays) {
  const auto spec = LoadSpec({.file = (kFolder / "ur5.yaml").string(),
                              .episodes = 7,
                              .seed = 70,
                              .overrides = {"camera.width=84", "objects=[generated:train]", "objects_per_scene=3"}});
  ASSERT_THAT(spec, IsOk());
  EXPECT_EQ(spec->episodes, 7u);
  EXPECT_EQ(spec->seed, 70u);
  EXPECT_EQ(spec->camera.width, 84);
  EXPECT_EQ(spec->objects.size(), 30u) << "sets are expanded after the flags";
}

TEST(WithOverrides, ExpandsGeneratedObjects) {
  const auto spec = WithOverrides(CampaignSpec(), {"objects=[generated:test]", "objects_per_scene=3"});
  ASSERT_THAT(spec, IsOk());
  EXPECT_EQ(spec->objects.size(), 70u);
  EXPECT_THAT(WithOverrides(CampaignSpec(), {"objects=[generated:tests]"}), HasCode(Code::kInvalidArgument));
}

// what a policy was trained on is at hand where its campaign file may not be
TEST(LoadSpecOrDataset, TakesADatasetsFolder) {
  const TemporaryFolder folder;
  CampaignSpec spec = SyntheticSpec();
  spec.tasks = {"push"};
  ASSERT_THAT(store::DatasetWriter::Open(folder / "data", spec), IsOk());
  const auto found = LoadSpecOrDataset({(folder / "data").string(), {}, {}, {}});
  ASSERT_THAT(found, IsOk());
  EXPECT_EQ(SpecHash(*found), SpecHash(spec));
  EXPECT_EQ(LoadSpecOrDataset({(kFolder / "obstacle.yaml").string(), {}, {}, {}})->name, "obstacle");
  EXPECT_THAT(LoadSpecOrDataset({folder.path().string(), {}, {}, {}}), HasCode(Code::kNotFound));
}

}  // namespace spec_file_test
}  // namespace etude::campaign
