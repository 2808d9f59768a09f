// SPDX-License-Identifier: Apache-2.0
#include "worker/task/command_guard.h"

#include <algorithm>
#include <cmath>

#include "services/core/check.h"
#include "worker/sim/saturated.h"
#include "worker/task/self_damping.h"

namespace etude::task {
namespace {

constexpr double kStep = 1 / kControlRate;  // s
// Of a joint's speed limit. The judge lets 1.05 pass: the rest is for what a step of the control does not foresee.
constexpr double kGuardShare = 0.95;
// A joint that turns as fast as it may although it is not asked to is turned by what the hand leans on: of that the
// guard knows nothing, and what leans is the rest of the command.
constexpr double kStopShare = 1.0;
// How far a target may lead the hand: the spring's pull of 6 m/s^2, to set off. More would only press on what is in the
// way, and throw the hand when it slips off.
constexpr double kLead = 0.015;       // m
constexpr double kLeadTurned = 0.15;  // rad
constexpr double kForesight = 1.5 * kStep;
constexpr double kLeastDamping = 1e-3;  // m (and rad)
constexpr double kMostDamping = 0.1;    // beyond, all directions suffer: the rest is slowed
constexpr int kHalvings = 12;           // of the search between them

bool Inside(const Eigen::VectorXd& v, const JointBox& box) {
  return (v.array() >= box.low.array()).all() && (v.array() <= box.high.array()).all();
}

// `v` along its direction, as fast as the box allows.
Eigen::VectorXd Slowed(const Eigen::VectorXd& v, const JointBox& box) {
  double share = 1;
  for (Eigen::Index i = 0; i < v.size(); ++i) {
    const double room = v[i] > 0 ? box.high[i] : -box.low[i];
    if (std::abs(v[i]) > room) share = std::min(share, std::max(0.0, room) / std::abs(v[i]));
  }
  return (share * v).cwiseMax(box.low).cwiseMin(box.high);  // a joint that has to be braked is
}

// `target` or what of the way there is within the lead.
Pose WithinLead(const Pose& X_WE, const Pose& target) {
  const Eigen::Vector3d turned = sim::RotationVector(X_WE.q, target.q);
  Pose led = target;
  if ((target.p - X_WE.p).norm() > kLead) led.p = X_WE.p + sim::Saturated(target.p - X_WE.p, kLead);
  if (const double angle = turned.norm(); angle > kLeadTurned)
    led.q = (Eigen::Quaterniond(Eigen::AngleAxisd(kLeadTurned, turned / angle)) * X_WE.q).normalized();
  return led;
}

}  // namespace

Eigen::VectorXd JointVelocityWithin(const Eigen::MatrixXd& J, const Vector6& V_WE, const JointBox& box) {
  ETUDE_CHECK(box.low.size() == J.cols() && box.high.size() == J.cols(), "n={}", J.cols());
  const auto damped = [&](double log_damping) { return sim::JointMotion(J, V_WE, std::exp(log_damping)); };
  double least = std::log(kLeastDamping), most = std::log(kMostDamping);
  if (Eigen::VectorXd v = damped(least); Inside(v, box)) return v;
  Eigen::VectorXd v = damped(most);
  if (Inside(v, box)) {
    for (int i = 0; i < kHalvings; ++i) {
      const double middle = (least + most) / 2;
      const Eigen::VectorXd tried = damped(middle);
      if (Inside(tried, box)) {
        most = middle;
        v = tried;
      } else {
        least = middle;
      }
    }
    return v;
  }
  return Slowed(v, box);
}

Command CommandGuard::Guarded(const Command& command, const sim::World& world) {
  sim::ControlState state;
  state.v = world.v();
  const Eigen::VectorXd q = world.q();
  state.J = kinematics_.Jacobian(q);
  const Vector6 V_WE = state.J * state.v;
  const double delay = world.scene().control_delay() * kStep;
  state.X_WE = sim::Advanced(world.X_WE(), V_WE, delay);  // where the hand will be when this command is obeyed
  Command guarded = command;
  guarded.target.X_WE = WithinLead(state.X_WE, command.target.X_WE);
  if ((state.v.cwiseAbs().array() > kStopShare * world.scene().arm().joint_speed.array()).any()) {
    guarded.target.X_WE = state.X_WE;
    guarded.V_WE.setZero();
    return guarded;
  }
  // The hand's velocity goes to this one with the controller's damping; without what the turning of the joints itself
  // changes, which the controller does not know.
  const Pose now = sim::Advanced(guarded.target.X_WE, command.V_WE, -kStep);
  const Vector6 wanted = V_WE + sim::ToolAcceleration(state, now, command.V_WE, config_) / config_.kv;
  const Vector6 bend = (kinematics_.Jacobian(q + kStep * state.v) - state.J) * state.v / (kStep * config_.kv);
  // how much of the way there is made meanwhile where nothing is in the way: what holds the hand up may give way now
  const double gain = 1 - std::exp(-config_.kv * kForesight);
  const Eigen::VectorXd limit = kGuardShare * world.scene().arm().joint_speed;
  const JointBox box{state.v + (-limit - state.v) / gain, state.v + (limit - state.v) / gain};
  const Eigen::VectorXd asked = sim::JointMotion(state.J, wanted - bend, kLeastDamping);
  VelocityDampers dampers = SelfDampers(*checker_, kinematics_, q + delay * state.v, world.gripper());
  // only the hand is commanded: what the joints of a redundant arm might do besides keeps nothing apart
  for (Eigen::Index i = 0; i < dampers.slopes.rows() && q.size() > 6; ++i) {
    const Vector6 of_hand = state.J * dampers.slopes.row(i).transpose();
    dampers.slopes.row(i) = sim::JointMotion(state.J, of_hand, kLeastDamping).transpose();
  }
  if (Inside(asked, box) && dampers.Allow(asked)) return guarded;
  const Vector6 allowed = dampers.Allow(asked) ? Vector6(wanted - bend) : Vector6(state.J * Damped(asked, dampers));
  // the box may have turned it, and what is slowed comes no nearer than what is not
  const Eigen::VectorXd v = Slowed(Damped(JointVelocityWithin(state.J, allowed, box), dampers), box);
  guarded.V_WE = state.J * v + bend;
  guarded.target.X_WE = sim::Advanced(state.X_WE, guarded.V_WE, kStep);
  return guarded;
}

}  // namespace etude::task
