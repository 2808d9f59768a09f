// SPDX-License-Identifier: Apache-2.0
// Tests worker/synthesis/object_folder.cc, object_maker.cc and scene_object.cc: what is written is what MuJoCo
// simulates.
#include "worker/synthesis/object_folder.h"

#include <gmock/gmock.h>
#include <mujoco/mujoco.h>

#include <cmath>
#include <memory>
#include <random>

#include "services/core/config_reference.h"
#include "services/core/file.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"
#include "worker/synthesis/drawn_object.h"
#include "worker/synthesis/generator.h"
#include "worker/synthesis/object_maker.h"
#include "worker/synthesis/scene_object.h"

namespace etude::synthesis {
namespace object_folder_test {

using Eigen::Vector3d;
using Model = std::unique_ptr<mjModel, decltype(&mj_deleteModel)>;
using Data = std::unique_ptr<mjData, decltype(&mj_deleteData)>;

Model Load(const Path& path) {
  char error[1000] = "";
  Model model(mj_loadXML(path.c_str(), nullptr, error, sizeof(error)), mj_deleteModel);
  EXPECT_TRUE(model) << path << ": " << error;
  return model;
}

Path WriteDrawn(const Path& folder, const std::string& name, int index, SolidObject* kept = nullptr) {
  auto object = DrawObject(name, index, 1);
  EXPECT_THAT(object, IsOk());
  const Path own = folder / object->facts.name;
  EXPECT_THAT(WriteObject(*object, own), IsOk());
  if (kept) *kept = std::move(*object);
  return own;
}

TEST(ObjectFacts, EveryKeyHasItsMeaningAndUnit) {
  EXPECT_THAT(MissingFromReference(ConfigReference<ObjectFacts>()), testing::IsEmpty());
}

class EveryClass : public testing::TestWithParam<std::string> {};

TEST_P(EveryClass, LoadsWithItsMassAndInertia) {
  const TemporaryFolder folder;
  SolidObject object;
  const Path own = WriteDrawn(folder.path(), GetParam(), 0, &object);
  const Model model = Load(own / (object.facts.name + ".xml"));
  ASSERT_TRUE(model);

  EXPECT_EQ(model->nbody, 2);
  EXPECT_EQ(model->nq, 7);
  EXPECT_EQ(model->ngeom, 2 + object.facts.pieces);  // to look at, and the foot
  EXPECT_EQ(model->ntex, 1);
  EXPECT_NEAR(model->body_mass[1], object.facts.mass_kg, 1e-6);
  for (int k = 0; k < 3; ++k) {
    EXPECT_NEAR(model->body_ipos[3 + k], object.facts.centre_m[k], 1e-6);
    EXPECT_GT(model->body_inertia[3 + k], 0);
  }
  const std::vector<double>& inertia = object.facts.inertia;
  EXPECT_NEAR(model->body_inertia[3] + model->body_inertia[4] + model->body_inertia[5],
              inertia[0] + inertia[1] + inertia[2], 1e-9);
  EXPECT_NEAR(model->qpos0[2], object.facts.rest_height_m, 1e-9);
  EXPECT_NEAR(*std::max_element(object.facts.extent_m.begin(), object.facts.extent_m.end()), object.facts.size_m, 1e-9);
}

TEST_P(EveryClass, RestsOnATable) {
  const TemporaryFolder folder;
  for (const int index : {0, 1}) {
    SolidObject object;
    const Path own = WriteDrawn(folder.path(), GetParam(), index, &object);
    const Path scene = own / "scene.xml";
    const std::string text = "<mujoco><option timestep=\"0.002\"/><include file=\"" + object.facts.name +
                             ".xml\"/><worldbody><geom name=\"table\" type=\"plane\" size=\"1 1 0.1\" condim=\"6\" "
                             "friction=\"0.9 0.02 0.001\"/></worldbody></mujoco>";
    ASSERT_THAT(WriteFileAtomically(scene, text), IsOk());
    const Model model = Load(scene);
    ASSERT_TRUE(model);
    const Data data(mj_makeData(model.get()), mj_deleteData);

    data->qpos[2] += 0.001;
    for (int step = 0; step < 1000; ++step) mj_step(model.get(), data.get());
    const double tilt = 2 * std::acos(std::min(1.0, std::abs(data->qpos[3])));
    EXPECT_LT(tilt, 0.02) << object.facts.name;
    EXPECT_LT(std::hypot(data->qpos[0], data->qpos[1]), 0.002) << object.facts.name;
    EXPECT_NEAR(data->qpos[2], object.facts.rest_height_m, 0.001) << object.facts.name;
    EXPECT_LT(Vector3d(data->qvel[0], data->qvel[1], data->qvel[2]).norm(), 1e-3) << object.facts.name;
  }
}

std::vector<std::string> ClassNames() {
  std::vector<std::string> names;
  for (const ClassFacts& known : KnownClasses()) names.push_back(known.name);
  return names;
}
INSTANTIATE_TEST_SUITE_P(Classes, EveryClass, testing::ValuesIn(ClassNames()));

TEST(ObjectFolder, TextureIsTheRightWayUp) {
  const TemporaryFolder folder;
  const Path own = WriteDrawn(folder.path(), "apple", 0);
  const Model model = Load(own / "apple_00.xml");
  ASSERT_TRUE(model);

  // MuJoCo's v runs down from the first row: high vertices have a small one
  double product = 0;
  const int mesh = model->geom_dataid[0], first = model->mesh_vertadr[mesh], uv = model->mesh_texcoordadr[mesh];
  const int geom = 0;
  for (int i = 0; i < model->mesh_vertnum[mesh]; ++i) {
    mjtNum p[3] = {model->mesh_vert[3 * (first + i)], model->mesh_vert[3 * (first + i) + 1],
                   model->mesh_vert[3 * (first + i) + 2]};
    mjtNum turned[3];
    mju_rotVecQuat(turned, p, model->geom_quat + 4 * geom);
    product += turned[2] * (model->mesh_texcoord[2 * (uv + i) + 1] - 0.5);
  }
  EXPECT_LT(product, 0);
}

TEST(ObjectFolder, SameSeedSameBytesWhateverTheThreads) {
  const TemporaryFolder one, two;
  std::vector<Maker> makers;
  for (const char* name : {"apple", "donut", "mug"})
    for (int i = 0; i < 2; ++i) makers.push_back([=] { return DrawObject(name, i, 7); });
  const auto ignore = [](const ObjectFacts&) {};
  const auto first = MakeObjects(makers, one.path(), 1, ignore);
  const auto second = MakeObjects(makers, two.path(), 3, ignore);
  ASSERT_THAT(first, IsOk());
  ASSERT_THAT(second, IsOk());

  int files = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(one.path())) {
    if (!entry.is_regular_file()) continue;
    ++files;
    const Path twin = two.path() / std::filesystem::relative(entry.path(), one.path());
    EXPECT_EQ(ReadTextFile(entry.path()).value(), ReadTextFile(twin).value()) << twin;
  }
  EXPECT_GT(files, 40);
  EXPECT_EQ(first->at(3).name, "donut_01");
  EXPECT_EQ(second->at(3).name, "donut_01");
}

TEST(ObjectFolder, FactsAreReadBack) {
  const TemporaryFolder folder;
  SolidObject object;
  const Path own = WriteDrawn(folder.path(), "pear", 3, &object);

  const auto facts = ReadObjectFacts(own);
  ASSERT_THAT(facts, IsOk());
  EXPECT_EQ(facts->name, "pear_03");
  EXPECT_EQ(facts->class_name, "pear");
  EXPECT_EQ(facts->split, "test");
  EXPECT_EQ(facts->seed, 1u);
  EXPECT_EQ(facts->mass_kg, object.facts.mass_kg);
  EXPECT_EQ(facts->extent_m, object.facts.extent_m);
  EXPECT_EQ(facts->inertia, object.facts.inertia);
  EXPECT_THAT(ReadObjectFacts(folder.path() / "none"), HasCode(Code::kNotFound));
}

TEST(SceneObject, OfAFolderIsTheOneThatWasWritten) {
  const TemporaryFolder folder;
  SolidObject object;
  const Path own = WriteDrawn(folder.path(), "mug", 3, &object);
  for (const Path& path : {own, own / "object.yaml"}) {
    const auto model = MakeSceneObject(path.string());
    ASSERT_THAT(model, IsOk());
    EXPECT_EQ(model->name, "mug_03");
    EXPECT_EQ(model->mass, object.facts.mass_kg);
    EXPECT_EQ(model->files.size(), 2u + object.facts.pieces);
  }
  EXPECT_THAT(MakeSceneObject((folder.path() / "none").string()), HasCode(Code::kNotFound));
  ASSERT_THAT(WriteFileAtomically(own / "object.yaml", std::string_view("name: mug_03\npieces: 2\n")), IsOk());
  EXPECT_THAT(MakeSceneObject(own.string()), HasCode(Code::kInvalidArgument));
}

// MuJoCo ends the process at a file without a byte, as an interrupted copy leaves it
TEST(SceneObject, OfAnEmptyFileIsAnErrorThatNamesIt) {
  const TemporaryFolder folder;
  const Path own = WriteDrawn(folder.path(), "mug", 3);
  ASSERT_THAT(WriteFileAtomically(own / "collision_0.obj", std::string_view()), IsOk());
  const auto made = MakeSceneObject(own.string());
  EXPECT_THAT(made, HasCode(Code::kCorrupt));
  EXPECT_THAT(made, MessageHas("collision_0.obj is empty"));
}

TEST(SceneObject, KnowsEveryKindOfName) {
  const auto drawn = MakeSceneObject("pear_07"), again = MakeSceneObject("pear_07");
  ASSERT_THAT(drawn, IsOk());
  EXPECT_EQ(drawn->geoms, again->geoms);
  EXPECT_EQ(drawn->files[0].bytes, again->files[0].bytes);
  EXPECT_EQ(MakeSceneObject("cube")->name, "cube");
  EXPECT_EQ(MakeSceneObject("basketball")->rest_height, 0.05);
  EXPECT_THAT(MakeSceneObject("pear_10"), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(MakeSceneObject("botle"), MessageHas("bottle"));
}

TEST(MakeObjects, ReportsTheFirstFailure) {
  const TemporaryFolder folder;
  const std::vector<Maker> makers{[] { return DrawObject("aple", 0, 1); }};
  const auto objects = MakeObjects(makers, folder.path(), 2, [](const ObjectFacts&) {});
  EXPECT_THAT(objects, HasCode(Code::kInvalidArgument));
  EXPECT_THAT(objects, MessageHas("did you mean 'apple'"));
}

// before, every scene with it refused to read what the import had written
TEST(WriteObject, RefusesWhatNoSceneWouldRead) {
  const TemporaryFolder folder;
  const auto object = DrawObject("apple", 0, 1);
  ASSERT_THAT(object, IsOk());
  EXPECT_THAT(WriteObject(*object, folder / "a", 100), MessageHas("make it coarser"));
  EXPECT_FALSE(std::filesystem::exists(folder / "a/object.yaml"));
  EXPECT_THAT(WriteObject(*object, folder / "a"), IsOk());
}

TEST(WriteObject, RefusesAPictureThatNoSceneWouldRead) {
  const TemporaryFolder folder;
  auto object = DrawObject("apple", 0, 1);
  ASSERT_THAT(object, IsOk());
  ASSERT_THAT(WriteObject(*object, folder / "a"), IsOk());
  const auto mesh = std::filesystem::file_size(folder / "a/visual.obj");
  // what PNG cannot make smaller
  std::mt19937 noise(1);
  Texture& texture = object->texture;
  texture = {1024, 1024, {}};
  for (int i = 0; i < 3 * 1024 * 1024; ++i) texture.rgb.push_back(static_cast<std::uint8_t>(noise()));
  ASSERT_LT(mesh, texture.rgb.size());
  EXPECT_THAT(WriteObject(*object, folder / "b", mesh + 1), MessageHas("its picture of 1024 x 1024 px"));
  EXPECT_FALSE(std::filesystem::exists(folder / "b/object.yaml"));
}

TEST(PlaceObject, RefusesWhatHasNoVolume) {
  assets::Mesh flat;
  flat.AddPolygon({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}}, {{0, 0}, {1, 0}, {1, 1}});
  EXPECT_THAT(PlaceObject({.name = "flat", .size_m = 0.1}, flat, std::nullopt), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(PlaceObject({.name = "none", .size_m = 0.1}, {}, std::nullopt), HasCode(Code::kInvalidArgument));
}

}  // namespace object_folder_test
}  // namespace etude::synthesis
