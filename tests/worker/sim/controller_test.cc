// SPDX-License-Identifier: Apache-2.0
#include "worker/sim/controller.h"

#include <Eigen/LU>
#include <Eigen/QR>
#include <cmath>

#include "services/core/rng.h"
#include "tests/worker/sim/scene_fixture.h"
#include "worker/sim/saturated.h"

namespace etude::sim {
namespace controller_test {

Eigen::MatrixXd RandomMatrix(Rng& rng, int rows, int cols) {
  Eigen::MatrixXd m(rows, cols);
  for (double& value : m.reshaped()) value = rng.Normal();
  return m;
}

ControlState RandomState(Rng& rng, int n) {
  const Eigen::MatrixXd half = RandomMatrix(rng, n, n);
  ControlState state;
  state.M = half * half.transpose() + Eigen::MatrixXd::Identity(n, n);
  state.J = RandomMatrix(rng, 6, n) + 2 * Eigen::MatrixXd::Identity(6, n);
  state.v = 0.01 * RandomMatrix(rng, n, 1);
  state.bias = RandomMatrix(rng, n, 1);
  return state;
}

TEST(RotationVector, IsTheFullAngle) {
  const Eigen::Vector3d axis = Eigen::Vector3d(1, -2, 0.5).normalized();
  const Eigen::Quaterniond from = FromEuler({0.3, -0.7, 2.0});
  for (const double angle : {0.0, 1e-9, 0.1, 1.5, 3.1}) {
    const Eigen::Quaterniond to(Eigen::AngleAxisd(angle, axis) * from);
    EXPECT_LT((RotationVector(from, to) - angle * axis).norm(), 1e-8) << angle;
    const Eigen::Quaterniond twin(-to.w(), -to.x(), -to.y(), -to.z());
    EXPECT_LT((RotationVector(from, twin) - angle * axis).norm(), 1e-8) << angle;
  }
}

TEST(Saturated, KeepsTheDirectionAndShortensOnlyWhatIsLonger) {
  const Eigen::Vector3d v(3, 0, -4);
  EXPECT_EQ(Saturated(v, 6), v);
  EXPECT_EQ(Saturated(v, 5), v);
  EXPECT_LT((Saturated(v, 1) - Eigen::Vector3d(0.6, 0, -0.8)).norm(), 1e-15);
  EXPECT_EQ(Saturated(v, 0), Eigen::Vector3d::Zero());
  EXPECT_EQ(Saturated(Eigen::Vector3d::Zero(), 0), Eigen::Vector3d::Zero());
}

// Closed form: M vdot + bias = tau gives the tool exactly kp e + kv (V_ref - V), whatever M, J and
// bias.
TEST(Controller, MakesTheToolAUnitMass) {
  Rng rng(5);
  const ControllerConfig config;
  for (const int n : {6, 7, 9}) {
    const ControlState state = RandomState(rng, n);
    const Eigen::Vector3d e_p(0.01, -0.02, 0.005), e_r(0.02, 0.05, -0.03);
    const Pose target{state.X_WE.p + e_p, Eigen::Quaterniond(Eigen::AngleAxisd(e_r.norm(), e_r.normalized()))};
    Vector6d V;
    V << 0.1, 0.2, -0.1, 0.3, 0, -0.2;
    const Eigen::VectorXd tau = OperationalSpaceTorques(state, target, V, config);
    const Eigen::VectorXd acceleration = state.J * state.M.ldlt().solve(tau - state.bias);
    Vector6d expected = config.kv * (V - state.J * state.v);
    expected.head<3>() += config.kp * e_p;
    expected.tail<3>() += config.ko * e_r;
    EXPECT_LT((acceleration - expected).norm(), 1e-6 * expected.norm()) << "n = " << n;
  }
}

TEST(Controller, DampsTheNullSpaceOnly) {
  Rng rng(6);
  const ControllerConfig config;
  ControlState state = RandomState(rng, 8);
  const Eigen::MatrixXd null = state.J.fullPivLu().kernel();
  state.v = null.col(0);
  const Eigen::VectorXd tau = OperationalSpaceTorques(state, state.X_WE, Vector6d::Zero(), config);
  const Eigen::VectorXd vdot = state.M.ldlt().solve(tau - state.bias);
  EXPECT_LT((vdot + config.null_kv * state.v).norm(), 1e-6 * vdot.norm());
}

TEST(Controller, DrawsTheNullSpaceToItsPostureWithoutTheTool) {
  Rng rng(9);
  const ControllerConfig config;
  ControlState state = RandomState(rng, 8);
  state.v.setZero();
  state.posture = RandomMatrix(rng, 8, 1);
  const Eigen::VectorXd tau = OperationalSpaceTorques(state, state.X_WE, Vector6d::Zero(), config);
  const Eigen::VectorXd vdot = state.M.ldlt().solve(tau - state.bias);
  EXPECT_LT((state.J * vdot).norm(), 1e-4 * vdot.norm()) << "the tool stays";
  const Eigen::MatrixXd null = state.J.fullPivLu().kernel();
  const Eigen::VectorXd wanted = null * (null.transpose() * null).ldlt().solve(null.transpose() * state.posture);
  EXPECT_LT((vdot - config.null_kp * wanted).norm(), 1e-4 * vdot.norm());
  state = RandomState(rng, 6);
  state.v.setZero();
  state.posture = RandomMatrix(rng, 6, 1);
  EXPECT_LT((OperationalSpaceTorques(state, state.X_WE, Vector6d::Zero(), config) - state.bias).norm(), 1e-9)
      << "six joints have no null space";
}

TEST(Controller, HoldsJointsOffTheirStops) {
  Rng rng(10);
  const ControllerConfig config;
  ControlState state = RandomState(rng, 6);
  state.v.setZero();
  state.stop = Eigen::VectorXd::Zero(6);
  state.stop[2] = 0.01;
  const Eigen::VectorXd tau = OperationalSpaceTorques(state, state.X_WE, Vector6d::Zero(), config);
  const Eigen::VectorXd vdot = state.M.ldlt().solve(tau - state.bias);
  EXPECT_LT((vdot - config.stop_kp * state.stop).norm(), 1e-9);
}

TEST(Controller, SlidesHomeOnlyAsFastAsTheJointsMayTurn) {
  Rng rng(11);
  const ControllerConfig config;
  ControlState state = RandomState(rng, 8);
  state.v.setZero();
  state.posture = 10 * RandomMatrix(rng, 8, 1);
  const auto sliding = [&] {  // the null space's speed that nothing accelerates
    const Eigen::VectorXd tau = OperationalSpaceTorques(state, state.X_WE, Vector6d::Zero(), config);
    return Eigen::VectorXd(state.M.ldlt().solve(tau - state.bias) / config.null_kv);
  };
  const Eigen::VectorXd free = sliding();
  state.speed = Eigen::VectorXd::Constant(8, 0.5 * free.cwiseAbs().maxCoeff());
  const Eigen::VectorXd limited = sliding();
  EXPECT_NEAR(limited.cwiseAbs().maxCoeff(), state.speed[0], 1e-3 * state.speed[0]);
  EXPECT_LT((limited - 0.5 * free).norm(), 1e-3 * free.norm()) << "the same way, slower";
}

TEST(Controller, OvercomesDryFrictionTowardsItsTarget) {
  Rng rng(12);
  const ControllerConfig config;
  ControlState state = RandomState(rng, 6);
  state.v.setZero();
  const Pose near{state.X_WE.p + Eigen::Vector3d(0.02, -0.01, 0.01), state.X_WE.q};
  const Eigen::VectorXd without = OperationalSpaceTorques(state, near, Vector6d::Zero(), config);
  state.friction = Eigen::VectorXd::Constant(6, 1.5);
  const Eigen::VectorXd more = OperationalSpaceTorques(state, near, Vector6d::Zero(), config) - without;
  EXPECT_LE(more.cwiseAbs().maxCoeff(), 1.5 + 1e-9) << "never more than the friction is";
  const Eigen::VectorXd wanted = state.J.fullPivLu().solve((Vector6d() << 0.02, -0.01, 0.01, 0, 0, 0).finished());
  for (int i = 0; i < 6; ++i)
    if (std::abs(wanted[i]) > 0.004) {
      EXPECT_GT(more[i] * wanted[i], 0) << i;
    }
  const Eigen::VectorXd there = OperationalSpaceTorques(state, state.X_WE, Vector6d::Zero(), config);
  EXPECT_LT((there - state.bias).norm(), 1e-9) << "at rest nothing pushes";
}

TEST(WithinLimits, KeepsTheDirectionOfWhatMovesTheArm) {
  const Eigen::VectorXd limit = Eigen::Vector3d(87, 87, 12), bias = Eigen::Vector3d(-40, 10, 2);
  const Eigen::VectorXd demand = bias + Eigen::VectorXd(Eigen::Vector3d(30, -20, 40));
  const Eigen::VectorXd given = WithinLimits(demand, bias, limit);
  EXPECT_NEAR(given[2], 12, 1e-12);
  EXPECT_LT((given - bias - 0.25 * (demand - bias)).norm(), 1e-12);
  EXPECT_EQ(WithinLimits(bias, bias, limit), bias) << "nothing is taken from what is within";
}

TEST(WithinLimits, AJointThatItsWeightTakesToItsLimitDoesNotStopTheOthers) {
  const Eigen::VectorXd limit = Eigen::Vector3d(87, 87, 12), bias = Eigen::Vector3d(0, 0, 11.9);
  const Eigen::VectorXd given = WithinLimits(bias + Eigen::VectorXd(Eigen::Vector3d(30, 0, 5)), bias, limit);
  EXPECT_EQ(given[0], 30);
  EXPECT_EQ(given[2], 12);
}

// However light its last joints are, a redundant arm moves as its plan: by the smallest joint motion.
TEST(Controller, SharesTheToolsMotionAmongJointsWhateverTheyWeigh) {
  Rng rng(13);
  ControlState state = RandomState(rng, 7);
  state.v.setZero();
  state.M.diagonal().head<4>().array() += 300;
  const Pose target{state.X_WE.p + Eigen::Vector3d(0.01, 0, -0.01), state.X_WE.q};
  const Eigen::VectorXd tau = OperationalSpaceTorques(state, target, Vector6d::Zero(), {});
  const Eigen::VectorXd vdot = state.M.ldlt().solve(tau - state.bias);
  const Eigen::VectorXd smallest = state.J.completeOrthogonalDecomposition().solve(state.J * vdot);
  EXPECT_LT((vdot - smallest).norm(), 0.01 * vdot.norm());
}

TEST(Controller, SaturatesTheSpring) {
  Rng rng(7);
  const ControllerConfig config;
  ControlState state = RandomState(rng, 6);
  state.v.setZero();
  const Pose far{{10, 0, 0}, state.X_WE.q};
  const Eigen::VectorXd tau = OperationalSpaceTorques(state, far, Vector6d::Zero(), config);
  const Eigen::VectorXd acceleration = state.J * state.M.ldlt().solve(tau - state.bias);
  EXPECT_NEAR(acceleration[0], config.kv * config.max_linear, 1e-6);
}

TEST(Controller, StaysFiniteWhenSingular) {
  Rng rng(8);
  ControlState state = RandomState(rng, 6);
  state.J.row(2).setZero();
  const Pose target{{0.02, 0.02, 0.02}, state.X_WE.q};
  const Eigen::VectorXd tau = OperationalSpaceTorques(state, target, Vector6d::Zero(), {});
  EXPECT_TRUE(tau.allFinite());
  EXPECT_LT((tau - state.bias).norm(), 1e4);
}

// In free space a 5 mm step must follow the recursion of a critically damped unit mass at 500 Hz.
TEST(Controller, StepResponseInTheSimulationIsSecondOrder) {
  const ControllerConfig config;
  for (int axis = 0; axis < 3; ++axis) {
    World world(FullScene());
    const Pose start = world.X_WE();
    Pose target = start;
    target.p[axis] += 0.005;
    double x = 0, v = 0;
    for (int step = 0; step < 60; ++step) {
      world.Step({target, 0}, Vector6d::Zero());
      for (int k = 0; k < kPhysicsStepsPerControl; ++k) {
        v += 0.002 * (config.kp * (0.005 - x) - config.kv * v);
        x += 0.002 * v;
      }
      Eigen::Vector3d expected = start.p;
      expected[axis] += x;
      ASSERT_LT((world.X_WE().p - expected).norm(), 0.02 * 0.005) << "axis " << axis << " step " << step;
    }
  }
}

}  // namespace controller_test
}  // namespace etude::sim
