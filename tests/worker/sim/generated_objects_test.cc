// SPDX-License-Identifier: Apache-2.0
// Generated objects and the basketball in MuJoCo: they stand where they are put.
#include <gmock/gmock.h>

#include <cmath>

#include "services/spec/object_names.h"
#include "tests/support/matchers.h"
#include "worker/sim/model.h"
#include "worker/sim/world.h"

namespace etude::sim {
namespace generated_objects_test {

/// Scenes of five of `names` and the basketball each.
std::vector<SceneSpec> ScenesOf(const std::vector<std::string>& names) {
  std::vector<SceneSpec> scenes;
  for (std::size_t i = 0; i < names.size(); i += 5) {
    SceneSpec spec;
    spec.objects.assign(names.begin() + i, names.begin() + std::min(i + 5, names.size()));
    spec.objects.push_back("basketball");
    scenes.push_back(spec);
  }
  return scenes;
}

TEST(GeneratedObjects, StandStillWhereTheyArePut) {
  std::vector<std::string> names;
  for (const std::string& name : GeneratedClasses())
    for (const int instance : {0, 4, 9}) names.push_back(GeneratedObject(name, instance));
  for (const SceneSpec& spec : ScenesOf(names)) {
    const auto scene = Scene::Build(spec);
    ASSERT_THAT(scene, IsOk());
    World world(*scene);
    world.Reset();
    double x = -0.40;
    std::vector<Pose> start;
    for (const ObjectInfo& object : (*scene)->objects()) {
      const Pose X_WO{{x, 0.45, object.rest_height}, FromEuler({0, 0, 0.2 * x})};
      x += 0.16;
      world.SetObject(object.name, X_WO);
      start.push_back(X_WO);
    }
    world.Forward();
    const Waypoint hold{world.X_WE(), 0};
    for (int step = 0; step < 250; ++step) world.Step(hold, Eigen::Matrix<double, 6, 1>::Zero());
    EXPECT_TRUE(world.healthy());
    for (std::size_t i = 0; i < start.size(); ++i) {
      const ObjectInfo& object = (*scene)->objects()[i];
      const Pose now = world.ObjectPose(object.name);
      EXPECT_LT((now.p - start[i].p).norm(), 0.002) << object.name;
      EXPECT_LT(AngleBetween(now.q, start[i].q), 0.02) << object.name;
    }
  }
}

TEST(GeneratedObjects, CollideAsLargeAsTheyLook) {
  SceneSpec spec;
  spec.objects = {"apple_00", "mug_03", "donut_02", "basketball"};
  const auto scene = Scene::Build(spec);
  ASSERT_THAT(scene, IsOk());
  for (const ObjectInfo& object : (*scene)->objects()) {
    Eigen::Vector3d low = Eigen::Vector3d::Constant(1), high = -low;
    for (const Geometry& piece : (*scene)->geometry()) {
      if (piece.body != object.name) continue;
      std::vector<Eigen::Vector3d> corners = piece.vertices;
      const bool is_ball = piece.shape == Geometry::Shape::kSphere;
      const Eigen::Vector3d half = is_ball ? Eigen::Vector3d::Constant(piece.size.x()) : piece.size;
      if (corners.empty()) corners = {half, -half};  // the foot and the ball lie along the axes
      for (const Eigen::Vector3d& corner : corners) {
        low = low.cwiseMin(piece.X_BG * corner);
        high = high.cwiseMax(piece.X_BG * corner);
      }
    }
    EXPECT_NEAR(low.z(), -object.rest_height, 1e-5) << object.name;
    EXPECT_LT(((high - low) / 2 - object.half_extent).cwiseAbs().maxCoeff(), 0.002) << object.name;
    const int body = (*scene)->model().BodyId(object.name);
    EXPECT_NEAR((*scene)->model().mj->body_mass[body], object.mass, 1e-9) << object.name;
  }
}

}  // namespace generated_objects_test
}  // namespace etude::sim
