// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/geometry/scene_geometry.cc
#include "worker/task/geometry/scene_geometry.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "services/core/rng.h"
#include "tests/support/sketch_robot.h"

namespace etude::task {
namespace scene_geometry_test {

using Eigen::Vector3d;
using Shape = sim::Geometry::Shape;

constexpr double kQuarterTurn = std::numbers::pi / 2;

Eigen::Quaterniond AnyRotation(Rng& rng) {
  return Eigen::Quaterniond(rng.Normal(), rng.Normal(), rng.Normal(), rng.Normal()).normalized();
}

// A point of the surface or the inside, in the piece's frame.
Vector3d PointOf(Shape shape, const Vector3d& size, Rng& rng) {
  const Vector3d around = Vector3d(rng.Normal(), rng.Normal(), rng.Normal()).normalized();
  const double along = rng.Uniform(-size.y(), size.y()), turn = rng.Uniform(0, 2 * std::numbers::pi);
  switch (shape) {
    case Shape::kSphere:
      return size.x() * around;
    case Shape::kCapsule:
      return Vector3d(0, 0, rng.Bernoulli(0.5) ? along : std::copysign(size.y(), along)) + size.x() * around;
    case Shape::kCylinder:
      return {size.x() * std::cos(turn), size.x() * std::sin(turn), std::copysign(size.y(), along)};
    default: {
      const auto side = [&](double half) { return rng.Bernoulli(0.5) ? half : -half; };
      return {side(size.x()), side(size.y()), side(size.z())};
    }
  }
}

// No point of a piece is beyond its support, and of many the farthest is nearly there.
TEST(Support, IsWhereThePieceEnds) {
  Rng rng(1);
  for (const Shape shape : {Shape::kBox, Shape::kSphere, Shape::kCapsule, Shape::kCylinder, Shape::kConvex})
    for (int i = 0; i < 20; ++i) {
      sim::Geometry piece;
      piece.shape = shape;
      piece.size = {rng.Uniform(0.02, 0.1), rng.Uniform(0.02, 0.1), rng.Uniform(0.02, 0.1)};
      if (shape == Shape::kConvex)
        for (int corner = 0; corner < 8; ++corner)
          piece.vertices.push_back(
              piece.size.cwiseProduct(Vector3d(corner & 1 ? 1 : -1, corner & 2 ? 1 : -1, corner & 4 ? 1 : -1)));
      const Pose X_WG{{rng.Normal(), rng.Normal(), rng.Normal()}, AnyRotation(rng)};
      const Vector3d direction = Vector3d(rng.Normal(), rng.Normal(), rng.Normal()).normalized();
      const double support = Support(piece, X_WG, direction);
      double farthest = -1e9;
      for (int point = 0; point < 4000; ++point)
        farthest = std::max(farthest, direction.dot(X_WG * PointOf(shape, piece.size, rng)));
      EXPECT_LE(farthest, support + 1e-12) << static_cast<int>(shape);
      EXPECT_NEAR(farthest, support, 2e-3) << static_cast<int>(shape);
    }
}

TEST(Hand, GoesFromLevelToPointingDown) {
  EXPECT_LT(AngleBetween(Hand(0), LevelHand()), 1e-7);
  EXPECT_LT(AngleBetween(Hand(kQuarterTurn), TurnedHand()), 1e-7);
  for (const double pitch : {-0.3, 0.0, 0.4, 1.1, kQuarterTurn, 2.0}) {
    // x of the tool looks back along the hand, y along the opening: the fingers close along the world's x at any pitch
    EXPECT_LT((Hand(pitch) * -Vector3d::UnitX() - ApproachOf(pitch)).norm(), 1e-12) << pitch;
    EXPECT_NEAR(std::abs((Hand(pitch) * Vector3d::UnitY()).x()), 1, 1e-12) << pitch;
    EXPECT_NEAR(AngleBetween(Hand(0), Hand(pitch)), std::abs(pitch), 1e-7);
  }
  EXPECT_LT((ApproachOf(kQuarterTurn) - Vector3d(0, 0, -1)).norm(), 1e-12);
  EXPECT_LT((ApproachOf(0) - Vector3d(0, 1, 0)).norm(), 1e-12);
}

TEST(DirectionOf, IsAsSeenInThePicture) {
  EXPECT_EQ(DirectionOf(Whereto::kLeft), Vector3d::UnitX());
  EXPECT_EQ(DirectionOf(Whereto::kRight), -Vector3d::UnitX());
  EXPECT_EQ(DirectionOf(Whereto::kFront), Vector3d::UnitY());
  EXPECT_EQ(DirectionOf(Whereto::kBehind), -Vector3d::UnitY());
}

// a pedestal's place is not the first joint's
TEST(Base, IsWhereTheFirstJointTurns) {
  SketchRobot robot;
  robot.InMjcf("pos=\"0 0 0.10\">\n        <joint name=\"turn\"", "pos=\"0 0.2 0.10\">\n        <joint name=\"turn\"");
  SceneSpec spec;
  spec.robot = robot.yaml();
  const auto scene = sim::Scene::Build(spec).value();
  sim::Kinematics kinematics(scene);
  const Eigen::Vector2d foot = kinematics.BodyPoses(scene->arm().q_home, 0, {"foot"}).front().p.head<2>();
  EXPECT_LT((SceneGeometry(*scene, kinematics).base() - foot - Eigen::Vector2d(0, 0.2)).norm(), 1e-9);
}

class Measured : public testing::TestWithParam<const char*> {
 protected:
  Measured() {
    SceneSpec spec;
    spec.robot = GetParam();
    spec.objects = {"coke", "bottle"};
    scene_ = sim::Scene::Build(spec).value();
    kinematics_.emplace(scene_);
    shapes_.emplace(*scene_, *kinematics_);
  }
  // The farthest point of some bodies beyond the tool, the arm being at `q`, measured piece by piece in the world.
  double Beyond(const Eigen::VectorXd& q, double gripper, const std::vector<std::string>& bodies,
                const Vector3d& direction_E) {
    const Pose X_WE = kinematics_->X_WE(q);
    const auto poses = kinematics_->BodyPoses(q, gripper, bodies);
    double most = -1e9;
    for (const auto& piece : scene_->geometry())
      for (std::size_t i = 0; i < bodies.size(); ++i)
        if (piece.body == bodies[i])
          most = std::max(most, Support(piece, X_WE.inverse() * poses[i] * piece.X_BG, direction_E));
    return most;
  }

  std::shared_ptr<const sim::Scene> scene_;
  std::optional<sim::Kinematics> kinematics_;
  std::optional<SceneGeometry> shapes_;
};

TEST_P(Measured, FingersReachAsFarAsTheirPiecesWhereverTheArmIs) {
  std::vector<std::string> fingers;
  for (const auto& group : scene_->arm().finger_groups) fingers.insert(fingers.end(), group.begin(), group.end());
  const Eigen::VectorXd elsewhere = scene_->arm().q_home.array() + 0.1;
  for (const bool closed : {false, true}) {
    const double reach = shapes_->Reach(SceneGeometry::Part::kFingers, closed, LevelHand(), ApproachOf(0));
    // beyond the tool against its x, which looks back along the hand
    EXPECT_NEAR(reach, Beyond(elsewhere, closed ? 1 : 0, fingers, -Vector3d::UnitX()), 1e-6) << closed;
  }
}

TEST_P(Measured, TheHandIsItsPalmAndItsFingersAndTurnsWithTheTool) {
  using Part = SceneGeometry::Part;
  Rng rng(2);
  for (int i = 0; i < 50; ++i) {
    const Eigen::Quaterniond q = AnyRotation(rng), turn = AnyRotation(rng);
    const Vector3d direction = Vector3d(rng.Normal(), rng.Normal(), rng.Normal()).normalized();
    for (const bool closed : {false, true}) {
      const double hand = shapes_->Reach(Part::kHand, closed, q, direction);
      EXPECT_EQ(hand, std::max(shapes_->Reach(Part::kFingers, closed, q, direction),
                               shapes_->Reach(Part::kPalm, closed, q, direction)));
      EXPECT_GE(shapes_->FurthestReach(q, direction), hand) << "half closed it may be further, never less far";
      EXPECT_NEAR(shapes_->Reach(Part::kHand, closed, turn * q, turn * direction), hand, 1e-9);
    }
  }
  EXPECT_LT(shapes_->palm_ahead(), shapes_->ahead_closed()) << "the fingertips are before the palm";
}

TEST_P(Measured, AnObjectStandsOnItsLowestPoint) {
  Rng rng(3);
  for (const auto& object : scene_->objects())
    for (int i = 0; i < 20; ++i) {
      const Eigen::Quaterniond q = AnyRotation(rng);
      const double height = shapes_->HeightOnTable(object.name, q);
      double lowest = 1e9;
      for (const auto& piece : scene_->geometry())
        if (piece.body == object.name)
          lowest = std::min(lowest, -Support(piece, Pose{{0, 0, height}, q} * piece.X_BG, -Vector3d::UnitZ()));
      EXPECT_NEAR(lowest, 0, 1e-9) << object.name;
    }
}

INSTANTIATE_TEST_SUITE_P(Robots, Measured, testing::Values("ur5", "panda", "jaco2"),
                         [](const auto& info) { return std::string(info.param); });

// it was the palm, whose height over an object it had to keep: the other jaw closed above everything
TEST(Hand, AJawThatStaysIsAFinger) {
  SketchRobot robot;
  robot.InMjcf("<joint name=\"right_slide\" axis=\"-1 0 0\"/>", "");
  robot.InMjcf("<joint joint1=\"right_slide\" joint2=\"left_slide\" polycoef=\"0 1 0 0 0\" solref=\"0.004 1\"/>", "");
  robot.InYaml("coupled: {right_slide: 1}", "coupled: {}");
  SceneSpec spec;
  spec.robot = robot.yaml();
  const auto scene = sim::Scene::Build(spec);
  ASSERT_TRUE(scene) << scene.error().message;
  sim::Kinematics kinematics(*scene);
  const SceneGeometry shapes(**scene, kinematics);
  EXPECT_LT(shapes.palm_ahead(), 0);
  EXPECT_GT(shapes.ahead_closed(), 0);
}

}  // namespace scene_geometry_test
}  // namespace etude::task
