// SPDX-License-Identifier: Apache-2.0
#include "worker/sim/gripper_loop.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>

namespace etude::sim {
namespace {

constexpr double kRotor = 0.1;      ///< kg m^2 or kg put on the driven joint: it leads, whatever hangs on it
constexpr double kLead = 30;        ///< rad/s, how fast it comes to where it is sent
constexpr double kSlack = 2e-3;     ///< N m s/rad of the others: they come to rest
constexpr double kTimestep = 5e-4;  ///< s
constexpr int kSteps = 1200;        ///< for half of the stroke
constexpr double kStays = 1e-3;     ///< rad or m

struct Driven {
  int q, v;
};

/// Sends the driven joint to `target` while the arm is held where it is.
void DriveTo(const mjModel& model, mjData& data, const Driven& driven, double target, const std::vector<int>& held) {
  for (int step = 0; step < kSteps; ++step) {
    data.qfrc_applied[driven.v] =
        kRotor * (kLead * kLead * (target - data.qpos[driven.q]) - 2 * kLead * data.qvel[driven.v]);
    mj_step(&model, &data);
    for (const int joint : held) {
      data.qpos[model.jnt_qposadr[joint]] = model.qpos0[model.jnt_qposadr[joint]];
      data.qvel[model.jnt_dofadr[joint]] = 0;
    }
  }
}

}  // namespace

std::vector<Follower> MeasureFollowers(mjModel& whole, const assets::RobotModel& robot) {
  const auto id = [&](const std::string& name) { return mj_name2id(&whole, mjOBJ_JOINT, name.c_str()); };
  const int driven_joint = id(robot.gripper_joints.at(0));
  const Driven driven{whole.jnt_qposadr[driven_joint], whole.jnt_dofadr[driven_joint]};
  std::vector<int> held;
  for (const std::string& name : robot.joints) held.push_back(id(name));
  std::set<int> known(held.begin(), held.end());
  known.insert(driven_joint);
  for (const auto& coupled : robot.coupled_joints) known.insert(id(coupled.joint));
  std::vector<int> unknown;
  for (int joint = 0; joint < whole.njnt; ++joint)
    if (!known.contains(joint) && whole.jnt_type[joint] >= mjJNT_SLIDE) unknown.push_back(joint);
  if (unknown.empty()) return {};
  whole.opt.timestep = kTimestep;
  whole.opt.disableflags |= mjDSBL_CONTACT | mjDSBL_GRAVITY | mjDSBL_FRICTIONLOSS;
  for (int v = 0; v < whole.nv; ++v) whole.dof_damping[v] += kSlack;
  whole.dof_armature[driven.v] += kRotor;
  const DataPtr data(mj_makeData(&whole));
  std::array<std::vector<double>, 3> places;  // of the driven joint, then the unknown ones
  for (std::size_t i = 0; i < places.size(); ++i) {
    const double share = 0.5 * static_cast<double>(i);
    DriveTo(whole, *data, driven, robot.gripper_open + share * (robot.gripper_closed - robot.gripper_open), held);
    places[i].push_back(data->qpos[driven.q]);
    for (const int joint : unknown) places[i].push_back(data->qpos[whole.jnt_qposadr[joint]]);
  }
  // what was measured then means nothing
  for (const int broken : {mjWARN_BADQPOS, mjWARN_BADQVEL, mjWARN_BADQACC})
    if (data->warning[broken].number > 0) return {};
  std::vector<Follower> followers;
  for (std::size_t k = 0; k < unknown.size(); ++k) {
    const double from = places[0][k + 1], to = places[2][k + 1], stroke = places[2][0] - places[0][0];
    const char* name = mj_id2name(&whole, mjOBJ_JOINT, unknown[k]);
    if (!name || std::abs(to - from) < kStays || stroke == 0) continue;
    Follower follower{.joint = name, .factor = (to - from) / stroke};
    follower.offset = from - follower.factor * places[0][0];
    follower.deviation = std::abs(places[1][k + 1] - follower.offset - follower.factor * places[1][0]);
    followers.push_back(std::move(follower));
  }
  return followers;
}

std::vector<double> StrokeOfBodies(const mjModel& alone, const assets::RobotModel& robot) {
  const auto q = [&](mjData& data, const std::string& joint) -> mjtNum& {
    return data.qpos[alone.jnt_qposadr[mj_name2id(&alone, mjOBJ_JOINT, joint.c_str())]];
  };
  const auto placed = [&](double driven) {
    DataPtr data(mj_makeData(&alone));
    for (std::size_t i = 0; i < robot.joints.size(); ++i) q(*data, robot.joints[i]) = robot.q_home[i];
    for (const std::string& joint : robot.gripper_joints) q(*data, joint) = driven;
    for (const auto& coupled : robot.coupled_joints) q(*data, coupled.joint) = coupled.offset + coupled.factor * driven;
    mj_kinematics(&alone, data.get());
    return data;
  };
  const DataPtr open = placed(robot.gripper_open), closed = placed(robot.gripper_closed);
  std::vector<double> stroke;
  for (int body = 0; body < alone.nbody; ++body) {
    mjtNum way[3], turn[4], back[4], angles[3];
    mju_sub3(way, closed->xpos + 3 * body, open->xpos + 3 * body);
    mju_negQuat(back, open->xquat + 4 * body);
    mju_mulQuat(turn, back, closed->xquat + 4 * body);
    mju_quat2Vel(angles, turn, 1);
    stroke.push_back(std::max(mju_norm3(way), mju_norm3(angles)));
  }
  return stroke;
}

}  // namespace etude::sim
