// SPDX-License-Identifier: Apache-2.0
#include "worker/sim/scene.h"

#include <gmock/gmock.h>

#include <cmath>
#include <map>
#include <set>

#include "services/core/rng.h"
#include "tests/worker/sim/scene_fixture.h"
#include "worker/sim/model.h"

namespace etude::sim {
namespace scene_test {

TEST(Scene, RefusesUnknownNames) {
  SceneSpec spec;
  spec.objects = {"botle"};
  const auto scene = Scene::Build(spec);
  ASSERT_FALSE(scene);
  EXPECT_EQ(scene.error().code, Code::kInvalidArgument);
  EXPECT_THAT(scene.error().message, testing::HasSubstr("bottle"));
}

TEST(Scene, KnowsItsArmAndObjects) {
  const Scene& scene = *FullScene();
  EXPECT_EQ(scene.arm().joints.size(), 6u);
  EXPECT_EQ(scene.arm().q_home.size(), 6);
  EXPECT_THAT(scene.arm().gripper_joints, testing::ElementsAre("finger_joint"));
  EXPECT_NEAR(scene.arm().q_max[0], 2 * M_PI, 1e-9);
  EXPECT_EQ(scene.arm().torque_limit[5], 28);
  EXPECT_EQ(scene.camera().width, 224);
  EXPECT_EQ(scene.sha256().size(), 64u);
  std::vector<std::string> names;
  const mjModel* mj = scene.model().mj.get();
  for (const ObjectInfo& object : scene.objects()) {
    names.push_back(object.name);
    const int body = scene.model().BodyId(object.name);
    EXPECT_NEAR(mj->body_mass[body], object.mass, 1e-9) << object.name;
    // inertia of a body of that mass and size: no axis beyond the box's, none below a tenth of it
    const Eigen::Vector3d h = object.half_extent;
    const double most = object.mass / 3 * (h.squaredNorm());
    for (int k = 0; k < 3; ++k) {
      EXPECT_LT(mj->body_inertia[3 * body + k], most) << object.name;
      EXPECT_GT(mj->body_inertia[3 * body + k], 0.1 * object.mass / 3 * h.head<2>().squaredNorm()) << object.name;
    }
  }
  EXPECT_EQ(names, CampaignSpec{}.objects);
}

TEST(Scene, BuildsTheSameTwice) {
  const auto again = Scene::Build(SceneSpec{});
  ASSERT_TRUE(again);
  EXPECT_EQ((*again)->sha256(), FullScene()->sha256());
  const mjModel *a = (*again)->model().mj.get(), *b = FullScene()->model().mj.get();
  ASSERT_EQ(mj_sizeModel(a), mj_sizeModel(b));
  EXPECT_EQ(0, std::memcmp(a->body_inertia, b->body_inertia, sizeof(mjtNum) * 3 * a->nbody));
}

// The neutral list, posed by Kinematics, is where MuJoCo has its collision pieces.
TEST(Scene, GeometryAgreesWithMuJoCo) {
  const Scene& scene = *FullScene();
  const mjModel* mj = scene.model().mj.get();
  World world(FullScene());
  Rng rng(4);
  Eigen::VectorXd q = scene.arm().q_home;
  for (int i = 0; i < 6; ++i) q[i] += rng.Uniform(-0.5, 0.5);
  world.SetArm(q);
  world.Forward();
  const mjData* data = world.state().mj.get();
  Kinematics kinematics(FullScene());
  std::size_t index = 0;
  for (int geom = 0; geom < mj->ngeom; ++geom) {
    if (!mj->geom_contype[geom] && !mj->geom_conaffinity[geom]) continue;
    ASSERT_LT(index, scene.geometry().size());
    const Geometry& piece = scene.geometry()[index++];
    const bool object = scene.model().objects.contains(piece.body);
    const Pose X_WB = object ? world.ObjectPose(piece.body) : kinematics.BodyPoses(q, 0, {piece.body})[0];
    const Pose X_WG = X_WB * piece.X_BG;
    Eigen::Vector3d p = Eigen::Vector3d::Map(data->geom_xpos + 3 * geom);
    if (mj->geom_type[geom] == mjGEOM_PLANE) p.z() -= piece.size.z();
    EXPECT_LT((X_WG.p - p).norm(), 1e-9) << piece.name;
    using Rows = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
    EXPECT_LT((X_WG.q.toRotationMatrix() - Rows::Map(data->geom_xmat + 9 * geom)).norm(), 1e-9) << piece.name;
    if (piece.shape == Geometry::Shape::kConvex) {
      EXPECT_GE(piece.vertices.size(), 6u) << piece.name;
    }
  }
  EXPECT_EQ(index, scene.geometry().size());
}

/// AABB of an object's collision pieces in its own frame.
std::pair<Eigen::Vector3d, Eigen::Vector3d> Bounds(const std::string& body) {
  Eigen::Vector3d low = Eigen::Vector3d::Constant(1e9), high = -low;
  for (const Geometry& piece : FullScene()->geometry()) {
    if (piece.body != body) continue;
    std::vector<Eigen::Vector3d> corners = piece.vertices;
    Eigen::Vector3d half = piece.size;
    if (piece.shape == Geometry::Shape::kCylinder) half = {piece.size.x(), piece.size.x(), piece.size.y()};
    if (piece.shape != Geometry::Shape::kConvex)
      for (int k = 0; k < 8; ++k)
        corners.push_back(half.cwiseProduct(Eigen::Vector3d(k & 1 ? 1 : -1, k & 2 ? 1 : -1, k & 4 ? 1 : -1)));
    for (const Eigen::Vector3d& corner : corners) {
      low = low.cwiseMin(piece.X_BG * corner);
      high = high.cwiseMax(piece.X_BG * corner);
    }
  }
  return {low, high};
}

TEST(Scene, ObjectsCollideAsLargeAsTheySay) {
  for (const ObjectInfo& object : FullScene()->objects()) {
    const auto [low, high] = Bounds(object.name);
    EXPECT_NEAR(low.z(), -object.rest_height, 1e-6) << object.name;
    EXPECT_LT(((high - low) / 2 - object.half_extent).cwiseAbs().maxCoeff(), 1e-5) << object.name;
    EXPECT_LT((high + low).head<2>().norm(), 1e-5) << object.name;
  }
}

TEST(CompileXml, SaysWhenThereAreMoreFilesThanMuJoCoTakes) {
  std::vector<assets::AssetFile> files(2001);
  for (std::size_t i = 0; i < files.size(); ++i) {
    files[i].name = std::to_string(i) + ".bin";
    files[i].bytes = {0};
  }
  const auto model = CompileXml("<mujoco/>", files);
  ASSERT_FALSE(model);
  EXPECT_EQ(model.error().code, Code::kExhausted);
}

TEST(Scene, EveryRobotBodyThatMovesHasGeometry) {
  std::set<std::string> with;
  for (const Geometry& piece : FullScene()->geometry()) with.insert(piece.body);
  for (const std::string& body : FullScene()->arm().bodies) EXPECT_TRUE(with.contains(body)) << body;
  EXPECT_TRUE(with.contains("world"));
}

}  // namespace scene_test
}  // namespace etude::sim
