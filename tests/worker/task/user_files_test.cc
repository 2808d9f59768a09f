// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/user_files.cc
#include "worker/task/user_files.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "services/core/file.h"
#include "tests/support/replace_in_file.h"
#include "tests/support/temporary_folder.h"

namespace etude::task {
namespace user_files_test {

std::string HashOf(const Path& robot) {
  CampaignSpec spec;
  spec.robots = {robot.string()};
  const auto hash = UserFilesSha256(spec);
  EXPECT_TRUE(hash) << (hash ? "" : hash.error().message);
  return hash.value_or("");
}

TEST(UserFiles, ACampaignThatNamesNoneHasNone) { EXPECT_EQ(UserFilesSha256(CampaignSpec{}).value(), ""); }

TEST(UserFiles, HashTellsWhatTheRobotIsMadeOfAndNotWhereItStands) {
  TemporaryFolder folder;
  std::filesystem::copy("deploy/robots", folder.path(), std::filesystem::copy_options::recursive);
  const Path robot = folder / "sketch.yaml";
  const std::string original = HashOf("deploy/robots/sketch.yaml");
  EXPECT_EQ(original.size(), 64u);
  EXPECT_EQ(HashOf(robot), original);

  ReplaceInFile(robot, "home: [0,", "home: [0.01,");  // what the scene does not have
  const std::string home = HashOf(robot);
  EXPECT_NE(home, original);
  ReplaceInFile(folder / "sketch/meshes/foot.obj", "v 0.083149", "v 0.084");
  EXPECT_NE(HashOf(robot), home);
}

TEST(UserFiles, HashTellsAnObjectsExtent) {
  TemporaryFolder folder;
  const Path object = folder / "my_box";
  std::filesystem::copy("deploy/objects/open_box", object, std::filesystem::copy_options::recursive);
  CampaignSpec spec;
  spec.objects = {"cube", object.string()};
  const auto before = UserFilesSha256(spec);
  ASSERT_TRUE(before) << before.error().message;
  EXPECT_EQ(UserFilesSha256(spec).value(), *before);
  ReplaceInFile(object / "object.yaml", "extent_m: [0.16,", "extent_m: [0.17,");
  EXPECT_NE(UserFilesSha256(spec).value(), *before);
}

TEST(UserFiles, WhatIsAskedForAgainSeesEachFileThatIsWrittenMeanwhile) {
  TemporaryFolder folder;
  std::filesystem::copy("deploy/robots", folder.path(), std::filesystem::copy_options::recursive);
  std::filesystem::copy("deploy/objects/open_box", folder / "my_box", std::filesystem::copy_options::recursive);
  CampaignSpec spec;
  spec.robots = {(folder / "sketch.yaml").string()};
  spec.objects = {"cube", (folder / "my_box/object.yaml").string()};
  UserFiles files;
  std::string last = UserFilesSha256(spec).value();
  EXPECT_EQ(files.Sha256(spec).value(), last);
  EXPECT_EQ(files.Sha256(spec).value(), last);
  const auto expect_another = [&](const char* what) {
    const std::string now = files.Sha256(spec).value_or("");
    EXPECT_NE(now, last) << what;
    EXPECT_EQ(now, UserFilesSha256(spec).value()) << what;
    last = now;
  };
  ReplaceInFile(folder / "sketch.yaml", "home: [0,", "home: [0.01,");
  expect_another("the robot's file");
  ReplaceInFile(folder / "sketch/meshes/foot.obj", "v 0.083149", "v 0.084");
  expect_another("a mesh of the robot");
  ReplaceInFile(folder / "my_box/object.yaml", "extent_m: [0.16,", "extent_m: [0.17,");
  expect_another("the object's facts");
  spec.objects = {"cube"};
  expect_another("the spec");
  std::filesystem::remove(folder / "sketch/meshes/foot.obj");
  EXPECT_FALSE(files.Sha256(spec));
}

TEST(UserFiles, WhatIsMissingIsAnError) {
  CampaignSpec spec;
  spec.objects = {"cube", "./no_such_folder"};
  EXPECT_FALSE(UserFilesSha256(spec));
}

// each episode has six of them, and the hash wanted all in one scene: no worker could join
TEST(UserFiles, MoreFilesThanOneSceneTakesHaveAHashToo) {
  TemporaryFolder folder;
  CampaignSpec spec;
  spec.objects.clear();
  for (int i = 0; i < 100; ++i) {
    const Path object = folder / fmt::format("o_{:02}", i);
    std::filesystem::copy("deploy/objects/open_box", object, std::filesystem::copy_options::recursive);
    for (int piece = 4; piece < 20; ++piece)
      std::filesystem::copy_file(object / "collision_0.obj", object / fmt::format("collision_{}.obj", piece));
    ReplaceInFile(object / "object.yaml", "pieces: 4", "pieces: 20");
    spec.objects.push_back(object.string());
  }
  const auto hash = UserFilesSha256(spec);
  ASSERT_TRUE(hash) << hash.error().message;
  EXPECT_EQ(UserFilesSha256(spec).value(), *hash);
}

}  // namespace user_files_test
}  // namespace etude::task
