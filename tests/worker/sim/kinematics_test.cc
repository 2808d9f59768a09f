// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <cmath>
#include <numbers>

#include "services/core/rng.h"
#include "tests/worker/sim/scene_fixture.h"
#include "worker/sim/controller.h"
#include "worker/sim/model.h"

namespace etude::sim {
namespace kinematics_test {

using std::numbers::pi;

/// The tool by the published Denavit-Hartenberg table, independent of the MJCF.
Eigen::Isometry3d ByTable(const Eigen::VectorXd& q) {
  const std::array<double, 6> a{0, -0.425, -0.39225, 0, 0, 0};
  const std::array<double, 6> d{0.089159, 0, 0, 0.10915, 0.09465, 0.0823};
  const std::array<double, 6> alpha{pi / 2, 0, 0, pi / 2, -pi / 2, 0};
  Eigen::Isometry3d T(Eigen::Translation3d(0, -0.3, 0));
  for (int i = 0; i < 6; ++i)
    T = T * Eigen::AngleAxisd(q[i], Eigen::Vector3d::UnitZ()) * Eigen::Translation3d(a[i], 0, d[i]) *
        Eigen::AngleAxisd(alpha[i], Eigen::Vector3d::UnitX());
  return T * Eigen::Translation3d(0, 0, 0.177);
}

Eigen::VectorXd RandomJoints(Rng& rng, double span) {
  Eigen::VectorXd q(6);
  for (int i = 0; i < 6; ++i) q[i] = rng.Uniform(-span, span);
  return q;
}

TEST(Kinematics, AgreesWithPublishedTable) {
  Kinematics kinematics(FullScene());
  Rng rng(1);
  for (int k = 0; k < 1000; ++k) {
    const Eigen::VectorXd q = RandomJoints(rng, 2 * pi);
    const Pose X = kinematics.X_WE(q);
    const Eigen::Isometry3d T = ByTable(q);
    ASSERT_LT((X.p - T.translation()).norm(), 1e-6) << "q = " << q.transpose();
    // E looks back along the hand's z and opens along its x
    ASSERT_LT((X.q * Eigen::Vector3d::UnitX() + T.linear().col(2)).norm(), 1e-6);
    ASSERT_LT((X.q * Eigen::Vector3d::UnitY() - T.linear().col(0)).norm(), 1e-6);
  }
}

TEST(Kinematics, HomeIsLowLevelAndAhead) {
  Kinematics kinematics(FullScene());
  const Pose X = kinematics.X_WE(FullScene()->arm().q_home);
  EXPECT_LT((X.p - Eigen::Vector3d(-0.10915, 0.133, 0.074)).norm(), 1e-6);
  EXPECT_LT(AngleBetween(X.q, FromEuler({pi, 0, pi / 2})), 1e-6);
  // approaching along +y, fingers left and right along x
  EXPECT_LT((X.q * -Eigen::Vector3d::UnitX() - Eigen::Vector3d::UnitY()).norm(), 1e-6);
  EXPECT_LT((X.q * Eigen::Vector3d::UnitY() + Eigen::Vector3d::UnitX()).norm(), 1e-6);
}

TEST(Kinematics, JacobianIsTheDerivative) {
  Kinematics kinematics(FullScene());
  Rng rng(2);
  for (int k = 0; k < 100; ++k) {
    const Eigen::VectorXd q = RandomJoints(rng, pi);
    const Eigen::MatrixXd J = kinematics.Jacobian(q);
    ASSERT_EQ(J.rows(), 6);
    ASSERT_EQ(J.cols(), 6);
    const double h = 1e-6;
    for (int i = 0; i < 6; ++i) {
      Eigen::VectorXd low = q, high = q;
      low[i] -= h;
      high[i] += h;
      const Pose a = kinematics.X_WE(low), b = kinematics.X_WE(high);
      Vector6d difference;
      difference << (b.p - a.p) / (2 * h), RotationVector(a.q, b.q) / (2 * h);
      ASSERT_LT((difference - J.col(i)).norm(), 1e-6) << "joint " << i;
    }
  }
}

TEST(Kinematics, PointJacobiansAreTheDerivativesOfPointsOnBodies) {
  Kinematics kinematics(FullScene());
  const ArmInfo& arm = FullScene()->arm();
  Rng rng(4);
  for (int k = 0; k < 20; ++k) {
    const Eigen::VectorXd q = RandomJoints(rng, pi);
    const Eigen::Vector3d p_B(rng.Uniform(-0.1, 0.1), rng.Uniform(-0.1, 0.1), rng.Uniform(-0.1, 0.1));
    const std::vector<Pose> bodies = kinematics.ArmPoses(q, 0);
    std::vector<Kinematics::BodyPoint> points;
    for (std::size_t b = 0; b < bodies.size(); ++b) points.push_back({arm.bodies[b], bodies[b] * p_B});
    const std::vector<Eigen::MatrixXd> jacobians = kinematics.PointJacobians(q, points);
    ASSERT_EQ(jacobians.size(), bodies.size());
    const double h = 1e-6;
    for (int i = 0; i < q.size(); ++i) {
      Eigen::VectorXd low = q, high = q;
      low[i] -= h;
      high[i] += h;
      const std::vector<Pose> a = kinematics.ArmPoses(low, 0), b = kinematics.ArmPoses(high, 0);
      for (std::size_t body = 0; body < bodies.size(); ++body) {
        const Eigen::Vector3d difference = (b[body] * p_B - a[body] * p_B) / (2 * h);
        ASSERT_LT((difference - jacobians[body].col(i)).norm(), 1e-6) << arm.bodies[body] << " joint " << i;
      }
    }
    // the tool's own Jacobian is that of a point of the hand
    const Eigen::Vector3d p_WE = kinematics.X_WE(q).p;
    const Eigen::MatrixXd of_tool = kinematics.PointJacobians(q, {{"gripper", p_WE}}).front();
    EXPECT_LT((of_tool - kinematics.Jacobian(q).topRows(3)).norm(), 1e-9);
  }
}

// Its own forward kinematics against MuJoCo's, for arms with hinges, slides and coupled fingers.
TEST(Kinematics, AgreesWithMuJoCo) {
  for (const char* robot : {"ur5", "panda", "jaco2"}) {
    const auto scene = SceneOf(robot);
    const ArmInfo& arm = scene->arm();
    const Scene::Model& model = scene->model();
    const DataPtr data = model.NewData();
    std::vector<double> scratch;
    Eigen::MatrixXd J;
    Kinematics kinematics(scene);
    Rng rng(5);
    for (int k = 0; k < 50; ++k) {
      Eigen::VectorXd q = arm.q_home;
      for (double& value : q) value += rng.Uniform(-pi / 2, pi / 2);
      const double gripper = rng.Uniform(0, 1);
      model.SetArm(data->qpos, q);
      model.SetGripper(data->qpos, gripper);
      mj_kinematics(model.mj.get(), data.get());
      mj_comPos(model.mj.get(), data.get());
      model.ToolJacobian(data.get(), scratch, J);

      const Pose X_WE = kinematics.X_WE(q), by_mujoco = model.ToolPose(data.get());
      ASSERT_LT((X_WE.p - by_mujoco.p).norm(), 1e-9) << robot;
      ASSERT_LT(AngleBetween(X_WE.q, by_mujoco.q), 1e-7) << robot;
      ASSERT_LT((kinematics.Jacobian(q) - J).norm(), 1e-9) << robot;
      const std::vector<Pose> poses = kinematics.ArmPoses(q, gripper);
      ASSERT_EQ(poses.size(), arm.bodies.size());
      for (std::size_t i = 0; i < poses.size(); ++i) {
        const Pose X_WB = model.BodyPose(data.get(), model.BodyId(arm.bodies[i]));
        ASSERT_LT((poses[i].p - X_WB.p).norm(), 1e-9) << robot << " " << arm.bodies[i];
        ASSERT_LT(AngleBetween(poses[i].q, X_WB.q), 1e-7) << robot << " " << arm.bodies[i];
      }
    }
  }
}

// What the three arms do not have: joints beside their body's origin, references other than 0, two joints of one body,
// a ball.
TEST(ArmTree, AgreesWithMuJoCoOnEveryKindOfJoint) {
  const auto compiled = CompileXml(R"(<mujoco><compiler angle="radian"/><worldbody>
    <body name="a" pos="0.1 0 0.2" euler="0.1 0.2 0.3"><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>
      <joint name="hinge" pos="0.1 0.2 -0.1" axis="0 1 1" ref="0.3"/>
      <body name="b" pos="0 0.3 0"><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>
        <joint name="slide" type="slide" axis="1 1 0" ref="0.05"/>
        <joint name="second" pos="0 0.1 0" axis="1 0 0"/>
        <body name="c" pos="0.2 0 0"><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>
          <joint name="ball" type="ball" pos="0 0 0.1"/>
          <body name="d" pos="0 0 0.2" quat="1 1 0 0"><site name="tip" pos="0.1 0 0" euler="0 0.5 0"/></body>
        </body></body></body></worldbody></mujoco>)",
                                   {});
  ASSERT_TRUE(compiled) << compiled.error().message;
  const mjModel& mj = **compiled;
  const DataPtr data(mj_makeData(&mj));
  const ArmTree tree(mj, 0, {0, 1, 2});
  ArmTree::Frames frames;
  Matrix6Xd J;
  Rng rng(6);
  for (int k = 0; k < 50; ++k) {
    for (int i = 0; i < mj.nq; ++i) data->qpos[i] = rng.Uniform(-1, 1);
    mj_normalizeQuat(&mj, data->qpos);
    mj_kinematics(&mj, data.get());
    mj_comPos(&mj, data.get());
    tree.PlaceAll(data->qpos, frames);
    for (int body = 0; body < mj.nbody; ++body) {
      const Pose& X_WB = frames.X_WB[tree.IndexOf(body)];
      ASSERT_LT((X_WB.p - Eigen::Vector3d::Map(data->xpos + 3 * body)).norm(), 1e-12) << "body " << body;
      const mjtNum* q = data->xquat + 4 * body;
      ASSERT_LT(AngleBetween(X_WB.q, Eigen::Quaterniond(q[0], q[1], q[2], q[3])), 1e-7) << "body " << body;
    }
    ASSERT_LT((tree.X_WE(frames).p - Eigen::Vector3d::Map(data->site_xpos)).norm(), 1e-12);
    Eigen::Matrix<double, 6, Eigen::Dynamic, Eigen::RowMajor> by_mujoco(6, mj.nv);
    mj_jacSite(&mj, data.get(), by_mujoco.data(), by_mujoco.data() + 3 * mj.nv, 0);
    tree.ToolJacobian(frames, J);
    ASSERT_LT((J - by_mujoco.leftCols(3)).norm(), 1e-12);
    const Eigen::Vector3d p_WE = tree.X_WE(frames).p;
    ASSERT_LT((tree.PointJacobian(frames, tree.IndexOf(mj.site_bodyid[0]), p_WE) - J.topRows(3)).norm(), 1e-12);
  }
}

TEST(Kinematics, SolvesPosesThatItReached) {
  Kinematics kinematics(FullScene());
  const ArmInfo& arm = FullScene()->arm();
  Rng rng(3);
  for (int k = 0; k < 200; ++k) {
    const Eigen::VectorXd q = arm.q_home + RandomJoints(rng, 0.6);
    const Pose X = kinematics.X_WE(q);
    const auto solution = kinematics.Solve(X, arm.q_home);
    ASSERT_TRUE(solution) << "q = " << q.transpose();
    const Pose found = kinematics.X_WE(*solution);
    EXPECT_LT((found.p - X.p).norm(), 0.5e-3);
    EXPECT_LT(AngleBetween(found.q, X.q), 2e-3);
    EXPECT_TRUE(((*solution - arm.q_min).array() >= 0).all() && ((arm.q_max - *solution).array() >= 0).all());
    EXPECT_EQ(*kinematics.Solve(X, arm.q_home), *solution) << "a function of its arguments";
  }
}

TEST(Kinematics, ReachesTheWholeTable) {
  Kinematics kinematics(FullScene());
  const ArmInfo& arm = FullScene()->arm();
  for (const double roll : {pi, pi / 2})
    for (double x = -0.43; x <= 0.431; x += 0.086)
      for (double y = 0.10; y <= 0.421; y += 0.08)
        for (const double z : {0.05, 0.20}) {
          // the hand that points down is 15 cm nearer than the object was (see the put-down task)
          if (roll < pi && (y > (std::abs(x) > 0.3 ? 0.20 : 0.26) || z > 0.1)) continue;
          const Pose X{{x, y, z}, FromEuler({roll, 0, pi / 2})};
          EXPECT_TRUE(kinematics.Solve(X, arm.q_home)) << x << " " << y << " " << z << " roll " << roll;
        }
}

TEST(Kinematics, SaysNoWhenOutOfReach) {
  Kinematics kinematics(FullScene());
  const Pose X{{0, 1.2, 0.2}, FromEuler({pi, 0, pi / 2})};
  EXPECT_FALSE(kinematics.Solve(X, FullScene()->arm().q_home));
}

TEST(Kinematics, FingersCloseInParallel) {
  Kinematics kinematics(FullScene());
  const auto& arm = FullScene()->arm();
  double gap_before = 1;
  for (const double gripper : {0.0, 0.25, 0.5, 0.75, 1.0}) {
    const auto poses = kinematics.BodyPoses(arm.q_home, gripper, {"left_finger", "right_finger", "gripper", "world"});
    EXPECT_LT(AngleBetween(poses[0].q, poses[2].q), 1e-9);
    EXPECT_LT(AngleBetween(poses[1].q, poses[2].q), 1e-9);
    const double gap = (poses[0].p - poses[1].p).norm() - 2 * 0.0105;
    if (gripper == 0) {
      EXPECT_NEAR(gap, 0.085, 1e-3);
    }
    if (gripper == 1) {
      EXPECT_NEAR(gap, 0.0, 2e-3);
    }
    EXPECT_GE(gap, 0);
    EXPECT_LT(gap, gap_before);
    gap_before = gap;
    EXPECT_LT(poses[3].p.norm(), 1e-12);
  }
}

}  // namespace kinematics_test
}  // namespace etude::sim
