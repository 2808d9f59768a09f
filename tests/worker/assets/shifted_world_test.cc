// SPDX-License-Identifier: Apache-2.0
// Tests worker/assets/shifted_world.cc and table_texture.cc
#include "worker/assets/shifted_world.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <set>

namespace etude::assets {
namespace shifted_world_test {

using ::testing::HasSubstr;
using ::testing::Not;

SceneDescription Shifted(const WorldSpec& world) {
  SceneSpec spec;
  spec.world = world;
  RobotModel robot;
  robot.defaults = "<default class=\"pad\"><geom friction=\"0.9 0.02 0.001\"/></default>\n";
  robot.materials = "<material name=\"paint\" rgba=\"0.2 0.2 0.2 1\"/>\n";
  return DescribeScene(spec, robot).value();
}

TEST(ShiftWorld, TheNominalWorldIsTheSceneByteForByte) {
  SceneDescription scene = Shifted({});
  const SceneDescription before = scene;
  ShiftWorld({}, scene);
  EXPECT_EQ(scene.mjcf, before.mjcf);
  ASSERT_EQ(scene.files.size(), before.files.size());
  for (std::size_t i = 0; i < scene.files.size(); ++i) EXPECT_EQ(scene.files[i].bytes, before.files[i].bytes);
}

TEST(ShiftWorld, EveryShiftIsAnotherScene) {
  std::vector<WorldSpec> worlds(8);
  worlds[1].light_brightness = 0.7;
  worlds[2].light_colour = {1, 0.9, 0.7};
  worlds[3].light_direction = {0.5, 0.2, -1};
  worlds[4].table = "cloth";
  worlds[5].table_colour = {0.8, 0.9, 1};
  worlds[6].object_colour = {0.8, 1, 1};
  worlds[7].background = {0.4, 0.4, 0.5};
  std::set<std::string> hashes;
  for (const WorldSpec& world : worlds) hashes.insert(Shifted(world).sha256);
  EXPECT_EQ(hashes.size(), worlds.size());
}

TEST(ShiftWorld, ScalesLightsAndTheirDirection) {
  WorldSpec world;
  world.light_brightness = 0.5;
  world.light_colour = {1, 1, 0.5};
  world.light_direction = {0.3, 0, -1};
  const std::string mjcf = Shifted(world).mjcf;
  EXPECT_THAT(mjcf, HasSubstr("<headlight ambient=\"0.17 0.17 0.085\""));
  EXPECT_THAT(mjcf, HasSubstr("diffuse=\"0.26 0.26 0.13\""));
  EXPECT_THAT(mjcf, HasSubstr("dir=\"0.3 0 -1\""));
}

TEST(ShiftWorld, ScalesSlidingFrictionEverywhere) {
  WorldSpec world;
  world.friction = 0.5;
  const std::string mjcf = Shifted(world).mjcf;
  EXPECT_THAT(mjcf, Not(HasSubstr("friction=\"0.9 ")));
  EXPECT_THAT(mjcf, HasSubstr("friction=\"0.45 0.005 0.0001\""));  // the table
  EXPECT_THAT(mjcf, HasSubstr("friction=\"0.45 0.02 0.001\""));    // the pads
}

TEST(ShiftWorld, ColoursObjectsAndNothingElse) {
  WorldSpec world;
  world.object_colour = {0.5, 1, 1};
  const SceneDescription nominal = Shifted({}), shifted = Shifted(world);
  EXPECT_THAT(shifted.mjcf, HasSubstr("<material name=\"cube\" rgba=\"0.43 0.05 0.05 1\""));
  EXPECT_THAT(shifted.mjcf, HasSubstr("<material rgba=\"0.5 1 1 1\" name=\"coke\""));
  EXPECT_THAT(shifted.mjcf, HasSubstr(nominal.robot.materials));
  EXPECT_THAT(shifted.mjcf, HasSubstr("<material name=\"table\" texture=\"wood\""));
}

TEST(ShiftWorld, TablesAreOfDifferentColours) {
  for (const char* table : {"cloth", "stone", "plain"}) {
    WorldSpec world;
    world.table = table;
    const SceneDescription scene = Shifted(world);
    EXPECT_THAT(scene.mjcf, HasSubstr(std::string("texture=\"") + table + "\""));
    EXPECT_THAT(scene.mjcf, Not(HasSubstr("wood")));
    const bool has_file = std::any_of(scene.files.begin(), scene.files.end(),
                                      [&](const AssetFile& file) { return file.name == std::string(table) + ".tex"; });
    EXPECT_TRUE(has_file) << table;
  }
}

TEST(ShiftWorld, AnObjectMayBeCalledLikeTheTable) {
  SceneSpec spec;
  spec.objects = {"wood"};
  spec.world.table = "cloth";
  const auto cube = [](const std::string& name) -> Result<ObjectModel> {
    auto object = MakeObject("cube");
    if (object) object->name = name;
    return object;
  };
  const std::string mjcf = DescribeScene(spec, RobotModel{}, cube).value().mjcf;
  EXPECT_THAT(mjcf, HasSubstr("<body name=\"wood\""));
  EXPECT_THAT(mjcf, HasSubstr("<freejoint name=\"wood\"/>"));
  EXPECT_THAT(mjcf, HasSubstr("<material name=\"table\" texture=\"cloth\""));
  EXPECT_THAT(mjcf, HasSubstr("<texture name=\"cloth\""));
}

TEST(AddChoices, TablesAndABackdropStandBesideTheScenesOwn) {
  SceneSpec spec;
  const std::string without = DescribeScene(spec, RobotModel{}).value().sha256;
  spec.tables = {"wood", "stone", "plain", "stone"};
  const SceneDescription scene = DescribeScene(spec, RobotModel{}).value();
  EXPECT_NE(scene.sha256, without);
  for (const char* table : {"wood", "stone", "plain"}) {
    EXPECT_EQ(std::ranges::count(scene.files, std::string(table) + ".tex", &AssetFile::name), 1) << table;
    EXPECT_THAT(scene.mjcf, HasSubstr(std::string("<texture name=\"") + table + "\"")) << table;
  }
  EXPECT_THAT(scene.mjcf, HasSubstr("<material name=\"table\" texture=\"wood\"")) << "its own";
  EXPECT_THAT(scene.mjcf, Not(HasSubstr("skybox")));
  spec.world.table = "cloth";
  const SceneDescription other = DescribeScene(spec, RobotModel{}).value();
  EXPECT_THAT(other.mjcf, HasSubstr("<material name=\"table\" texture=\"cloth\""));
  EXPECT_EQ(std::ranges::count(other.files, std::string("wood.tex"), &AssetFile::name), 1);

  spec.backdrop = true;
  EXPECT_THAT(DescribeScene(spec, RobotModel{}).value().mjcf, HasSubstr("type=\"skybox\""));
  spec.world.background = {0.1, 0.2, 0.3};
  const std::string mjcf = DescribeScene(spec, RobotModel{}).value().mjcf;
  EXPECT_EQ(mjcf.find("skybox"), mjcf.rfind("skybox")) << "once";
}

}  // namespace shifted_world_test
}  // namespace etude::assets
