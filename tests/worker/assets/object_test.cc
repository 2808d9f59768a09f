// SPDX-License-Identifier: Apache-2.0
// Tests worker/assets/object.cc and object_mesh.cc: what MuJoCo makes of every object, against a stack of thin slices
// of the same shape.
#include "worker/assets/object.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>

#include "tests/support/matchers.h"
#include "worker/assets/object_parts.h"
#include "worker/sim/model.h"

namespace etude::assets {
namespace object_test {

using Eigen::Matrix3d;
using Eigen::Vector3d;

/// A horizontal cut through a body: a rectangle or an ellipse around the vertical axis, half its sides in m.
struct Slice {
  double half_x = 0, half_y = 0;
  bool is_round = false;
};

struct Shape {
  const char* name;
  double mass, height, rest_height;
  std::function<Slice(double)> at;  ///< by height above the lowest point
  double tolerance;                 ///< of mass and inertia: round pieces are polygons
};

/// A height between two: from `a` to `b`.
double Between(double z, double z0, double z1, double a, double b) { return std::lerp(a, b, (z - z0) / (z1 - z0)); }

Slice Milk(double z) {
  if (z < kMilkShoulder) return {kMilkHalf, kMilkHalf};
  if (z > kMilkRidge) return {kMilkHalf, kMilkFin};
  return {kMilkHalf, Between(z, kMilkShoulder, kMilkRidge, kMilkHalf, kMilkFin)};
}

/// A superellipse over straight sides, with a bevel below.
Slice Bread(double z) {
  if (z < 0.004) return {kBreadHalfX - 0.004 + z, kBreadHalfY};
  if (z < kBreadSide) return {kBreadHalfX, kBreadHalfY};
  const double share = (z - kBreadSide) / (kBreadHeight - kBreadSide);
  return {kBreadHalfX * std::pow(1 - std::pow(share, 2.5), 0.4), kBreadHalfY};
}

Slice Bottle(double z) {
  const double r = kBottleRadius, s = kBottleShoulder, neck = kBottleNeckRadius;
  const auto round = [](double radius) { return Slice{radius, radius, true}; };
  if (z < s) return round(r);
  if (z < s + .008) return round(Between(z, s, s + .008, r, .93 * r));
  if (z < s + .018) return round(Between(z, s + .008, s + .018, .93 * r, .72 * r));
  if (z < kBottleNeck) return round(Between(z, s + .018, kBottleNeck + .001, .72 * r, neck));
  return round(neck + .0008);
}

Slice Ball(double z) {
  const double r = std::sqrt(kBallRadius * kBallRadius - (z - kBallRadius) * (z - kBallRadius));
  return {r, r, true};
}

std::vector<Shape> AllShapes() {
  const auto box = [](double) { return Slice{0.02, 0.02}; };
  const auto can = [](double) { return Slice{kCanRadius, kCanRadius, true}; };
  return {{"cube", 0.100, 0.10, 0.05, box, 1e-6},
          {"coke", 0.1434, kCanHeight, kCanHeight / 2, can, 1e-6},
          {"pepsi", 0.1434, kCanHeight, kCanHeight / 2, can, 1e-6},
          {"milk", 0.1918, kMilkHeight, 0.061, Milk, 1e-4},
          {"bread", 0.2018, kBreadHeight, 0.0363, Bread, 0.01},
          {"bottle", 0.257, kBottleHeight, 0.0649, Bottle, 0.02},
          {"basketball", 0.600, 2 * kBallRadius, kBallRadius, Ball, 1e-6}};
}

struct RigidBody {
  double mass = 0;
  Vector3d centre = Vector3d::Zero();   ///< m
  Matrix3d inertia = Matrix3d::Zero();  ///< about the centre, kg m^2
};

/// Of even density; its origin is `rest_height` above its lowest point.
RigidBody Stack(const Shape& shape) {
  constexpr int kSlices = 20000;
  double volume = 0, first = 0;
  Vector3d second = Vector3d::Zero();
  for (int i = 0; i < kSlices; ++i) {
    const double z = (i + 0.5) / kSlices * shape.height;
    const auto [x, y, is_round] = shape.at(z);
    const double part = (is_round ? std::numbers::pi : 4) * x * y, spread = is_round ? 0.25 : 1.0 / 3;
    volume += part;
    first += part * z;
    second += part * Vector3d(spread * x * x, spread * y * y, z * z);
  }
  const double middle = first / volume;
  Vector3d moments = second / volume;
  moments.z() -= middle * middle;
  const Vector3d diagonal = moments.sum() * Vector3d::Ones() - moments;
  return {shape.mass, {0, 0, middle - shape.rest_height}, shape.mass * Matrix3d(diagonal.asDiagonal())};
}

/// A scene of all objects.
sim::ModelPtr CompileAll() {
  SceneSpec spec;
  spec.objects.clear();
  for (const Shape& shape : AllShapes()) spec.objects.push_back(shape.name);
  const auto scene = DescribeScene(spec, {});
  EXPECT_THAT(scene, IsOk());
  return sim::CompileXml(scene->mjcf, scene->files).value();
}

RigidBody BodyOf(const mjModel& mj, const std::string& name) {
  const int body = mj_name2id(&mj, mjOBJ_BODY, name.c_str());
  const mjtNum* q = mj.body_iquat + 4 * body;
  const Matrix3d axes = Eigen::Quaterniond(q[0], q[1], q[2], q[3]).toRotationMatrix();
  const Vector3d moments = Vector3d::Map(mj.body_inertia + 3 * body);
  return {mj.body_mass[body], Vector3d::Map(mj.body_ipos + 3 * body), axes * moments.asDiagonal() * axes.transpose()};
}

TEST(Objects, WeighAndTurnAsTheirShapeDoes) {
  const sim::ModelPtr model = CompileAll();
  for (const Shape& shape : AllShapes()) {
    const RigidBody expected = Stack(shape), found = BodyOf(*model, shape.name);
    EXPECT_NEAR(found.mass, expected.mass, 1e-9) << shape.name;
    EXPECT_LT((found.centre - expected.centre).norm(), shape.tolerance * shape.height + 1e-9) << shape.name;
    EXPECT_LT((found.inertia - expected.inertia).norm(), (shape.tolerance + 1e-6) * expected.inertia.norm())
        << shape.name << "\n"
        << found.inertia << "\nfor\n"
        << expected.inertia;
  }
}

TEST(Objects, SayTheMassHeightAndBoxThatTheyHave) {
  for (const Shape& shape : AllShapes()) {
    const auto object = MakeObject(shape.name);
    ASSERT_THAT(object, IsOk());
    EXPECT_EQ(object->mass, shape.mass) << shape.name;
    EXPECT_EQ(object->rest_height, shape.rest_height) << shape.name;
    Vector3d widest(0, 0, shape.height / 2);
    for (double z = 1e-4; z < shape.height; z += 1e-4)
      widest = widest.cwiseMax(Vector3d(shape.at(z).half_x, shape.at(z).half_y, 0));
    EXPECT_LT((object->half_extent - widest).cwiseAbs().maxCoeff(), 1e-4) << shape.name;
  }
}

TEST(Ball, IsTheBasketballInAnotherColour) {
  const auto basketball = MakeObject("basketball");
  ASSERT_THAT(basketball, IsOk());
  const ObjectModel ball = MakeBall("distractor_ball_07", BallColour(7));
  EXPECT_EQ(ball.name, "distractor_ball_07");
  EXPECT_EQ(ball.mass, basketball->mass);
  EXPECT_EQ(ball.rest_height, basketball->rest_height);
  EXPECT_EQ(ball.half_extent, basketball->half_extent);
  ASSERT_EQ(ball.files.size(), 2u);
  EXPECT_EQ(ball.files[1].name, basketball->files[1].name) << "one mesh for both";
  EXPECT_EQ(ball.files[1].bytes, basketball->files[1].bytes);
  EXPECT_NE(ball.files[0].name, basketball->files[0].name) << "two textures";
  EXPECT_NE(ball.files[0].bytes, basketball->files[0].bytes);
}

TEST(Ball, ComesInAllHues) {
  EXPECT_TRUE(BallColour(0).isApprox(Color(0.9, 0.09, 0.09), 1e-12)) << "red";
  EXPECT_TRUE(BallColour(4).isApprox(Color(0.09, 0.9, 0.09), 1e-12)) << "green";
  EXPECT_TRUE(BallColour(6).isApprox(Color(0.09, 0.9, 0.9), 1e-12)) << "cyan";
  EXPECT_LT((BallColour(1) - Color(0.90, 0.42, 0.10)).norm(), 0.1) << "nearly the basketball's";
  EXPECT_TRUE(BallColour(12).isApprox(Color(0.6, 0.24, 0.24), 1e-12)) << "the same hue, duller and darker";
}

TEST(Objects, HaveTextureCoordinatesWithinTheirPicture) {
  for (const Mesh& mesh : {CanMesh(0.04), MilkMesh(0.061), BreadMesh(0.0363), BottleMesh(0.0649),
                           BottleLabelMesh(0.0649), BottleCapMesh(0.0649), BallMesh()})
    for (const auto& uv : mesh.uv) {
      EXPECT_GE(uv.minCoeff(), -1e-12);
      EXPECT_LE(uv.maxCoeff(), 1 + 1e-12);
    }
}

}  // namespace object_test
}  // namespace etude::assets
