// SPDX-License-Identifier: Apache-2.0
#include "worker/sim/world.h"

#include <algorithm>

#include "services/core/check.h"
#include "worker/sim/controller.h"
#include "worker/sim/model.h"

namespace etude::sim {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;

/// Those at `addresses`, in their order.
Eigen::VectorXd Pick(const mjtNum* values, const std::vector<int>& addresses) {
  Eigen::VectorXd picked(addresses.size());
  for (std::size_t i = 0; i < addresses.size(); ++i) picked[static_cast<Eigen::Index>(i)] = values[addresses[i]];
  return picked;
}

const Scene::Model::FreeBody& Find(const Scene::Model& model, const std::string& object) {
  const auto found = model.objects.find(object);
  ETUDE_CHECK(found != model.objects.end(), "the scene has no object '{}'", object);
  return found->second;
}

}  // namespace

World::World(std::shared_ptr<const Scene> scene) : scene_(std::move(scene)), state_(std::make_unique<State>()) {
  state_->mj = scene_->model().NewData();
  state_->full_inertia.resize(static_cast<std::size_t>(scene_->model().mj->nv) * scene_->model().mj->nv);
  for (const std::string& body : scene_->arm().bodies) state_->arm_body_ids.push_back(scene_->model().BodyId(body));
  Reset();
}
World::World(World&&) noexcept = default;
World::~World() = default;

void World::Reset() {
  mj_resetData(scene_->model().mj.get(), state_->mj.get());
  scene_->model().SetHome(state_->mj->qpos);
  state_->under_way.clear();
  state_->guided.reset();
  state_->demanded.setZero(static_cast<Eigen::Index>(scene_->model().arm_v.size()));
  Forward();
}

void World::SetArm(const Eigen::VectorXd& q) {
  scene_->model().SetArm(state_->mj->qpos, q);
  for (const int address : scene_->model().arm_v) state_->mj->qvel[address] = 0;
}

void World::SetObject(const std::string& name, const Pose& X_WO) {
  const auto& body = Find(scene_->model(), name);
  const Eigen::Quaterniond q = X_WO.q.normalized();
  const double values[7] = {X_WO.p.x(), X_WO.p.y(), X_WO.p.z(), q.w(), q.x(), q.y(), q.z()};
  std::copy_n(values, 7, state_->mj->qpos + body.q);
  std::fill_n(state_->mj->qvel + body.v, 6, 0.0);
}

// Between calls the data is always as after mj_step1: everything that follows from position and
// velocity is current, so that poses, contacts and pictures belong to the same instant as q and v.
void World::Forward() { mj_step1(scene_->model().mj.get(), state_->mj.get()); }

void World::Step(const Waypoint& target, const Vector6d& V_WE) {
  const auto delay = static_cast<std::size_t>(scene_->control_delay());
  if (delay == 0) return Obey(target, V_WE);
  auto& under_way = state_->under_way;
  if (under_way.empty()) under_way.assign(delay, {{X_WE(), 0}, Vector6d::Zero()});
  under_way.push_back({target, V_WE});
  const State::Command due = under_way.front();
  under_way.pop_front();
  Obey(due.target, due.V_WE);
}

void World::Obey(const Waypoint& target, const Vector6d& V_WE) {
  const Scene::Model& model = scene_->model();
  mjModel* mj = model.mj.get();
  mjData* data = state_->mj.get();
  const double torque = target.gripper > 0.5 ? model.robot.close_torque : model.robot.open_torque;
  for (int step = 0; step < kPhysicsStepsPerControl; ++step) {
    // the target is due at the end of the control step: earlier, the path was that much behind
    const double remaining = (kPhysicsStepsPerControl - step) * mj->opt.timestep;
    const Pose X_now = Advanced(target.X_WE, V_WE, -remaining);
    state_->ReadControl(model);
    state_->demanded = OperationalSpaceTorques(state_->control, X_now, V_WE, state_->config);
    const Eigen::VectorXd given = WithinLimits(state_->demanded, state_->control.bias, scene_->arm().torque_limit);
    for (std::size_t i = 0; i < model.arm_u.size(); ++i)
      data->ctrl[model.arm_u[i]] = given[static_cast<Eigen::Index>(i)];
    data->ctrl[model.gripper_u] = torque;
    mj_step2(mj, data);
    mj_step1(mj, data);
  }
  if (state_->guided) state_->MoveGuided(mj);
}

void World::Guide(const std::string& object, const Pose& X_WO, const Eigen::Vector3d& v_WO) {
  state_->guided = {Find(scene_->model(), object), X_WO, v_WO};
}

// A hand that is not in the picture: it moves what it holds, and is moved by nothing.
void World::State::MoveGuided(const mjModel* model) {
  const auto& [body, X_WO, v_WO] = *guided;
  const double values[7] = {X_WO.p.x(), X_WO.p.y(), X_WO.p.z(), X_WO.q.w(), X_WO.q.x(), X_WO.q.y(), X_WO.q.z()};
  std::copy_n(values, 7, mj->qpos + body.q);
  const double velocity[6] = {v_WO.x(), v_WO.y(), v_WO.z(), 0, 0, 0};
  std::copy_n(velocity, 6, mj->qvel + body.v);
  guided.reset();
  mj_step1(model, mj.get());
}

void World::State::ReadControl(const Scene::Model& model) {
  const mjModel* mjm = model.mj.get();
  const auto n = static_cast<Eigen::Index>(model.arm_v.size());
  control.X_WE = model.ToolPose(mj.get());
  model.ToolJacobian(mj.get(), scratch, control.J);
  mj_fullM(mjm, full_inertia.data(), mj->qM);
  control.v.resize(n);
  control.bias.resize(n);
  control.posture.resize(n);
  control.stop.resize(n);
  control.M.resize(n, n);
  if (model.has_friction) control.friction.resize(n);
  control.speed = Eigen::VectorXd::Map(model.robot.planned_speed.data(), n);
  for (Eigen::Index i = 0; i < n; ++i) {
    control.v[i] = mj->qvel[model.arm_v[i]];
    const double q = mj->qpos[model.arm_q[i]];
    control.posture[i] = model.robot.q_home[i] - q;
    control.stop[i] = std::max(0.0, model.soft_low[i] - q) - std::max(0.0, q - model.soft_high[i]);
    control.bias[i] = mj->qfrc_bias[model.arm_v[i]] - mj->qfrc_passive[model.arm_v[i]];
    if (model.has_friction) control.friction[i] = mjm->dof_frictionloss[model.arm_v[i]];
    for (Eigen::Index j = 0; j < n; ++j)
      control.M(i, j) = full_inertia[static_cast<std::size_t>(model.arm_v[i]) * mjm->nv + model.arm_v[j]];
  }
}

Eigen::VectorXd World::q() const { return Pick(state_->mj->qpos, scene_->model().arm_q); }
Eigen::VectorXd World::v() const { return Pick(state_->mj->qvel, scene_->model().arm_v); }
Eigen::VectorXd World::gripper_q() const { return Pick(state_->mj->qpos, scene_->model().gripper_q); }

double World::gripper() const {
  const ArmInfo& arm = scene_->arm();
  return std::clamp((gripper_q()[0] - arm.gripper_open) / (arm.gripper_closed - arm.gripper_open), 0.0, 1.0);
}

Pose World::X_WE() const { return scene_->model().ToolPose(state_->mj.get()); }

Pose World::ObjectPose(const std::string& name) const {
  return scene_->model().BodyPose(state_->mj.get(), Find(scene_->model(), name).body);
}

std::vector<float> World::StateVector() const {
  const mjModel* mj = scene_->model().mj.get();
  std::vector<float> values;
  values.reserve(mj->nq + mj->nv);
  values.insert(values.end(), state_->mj->qpos, state_->mj->qpos + mj->nq);
  values.insert(values.end(), state_->mj->qvel, state_->mj->qvel + mj->nv);
  return values;
}

double World::time() const { return state_->mj->time; }

std::vector<Pose> World::ArmPoses() const {
  std::vector<Pose> poses;
  for (const int body : state_->arm_body_ids) poses.push_back(scene_->model().BodyPose(state_->mj.get(), body));
  return poses;
}

const Eigen::VectorXd& World::demanded_torque() const { return state_->demanded; }

bool World::healthy() const {
  for (const int kind : {mjWARN_INERTIA, mjWARN_CONTACTFULL, mjWARN_CNSTRFULL, mjWARN_BADQPOS, mjWARN_BADQVEL,
                         mjWARN_BADQACC, mjWARN_BADCTRL})
    if (state_->mj->warning[kind].number > 0) return false;
  return true;
}

int World::BodyId(const std::string& name) const { return scene_->model().BodyId(name); }

std::vector<std::pair<std::string_view, std::string_view>> World::Contacts() const {
  const mjModel* mj = scene_->model().mj.get();
  std::vector<std::pair<std::string_view, std::string_view>> pairs;
  for (int i = 0; i < state_->mj->ncon; ++i) {
    const mjContact& contact = state_->mj->contact[i];
    pairs.emplace_back(mj_id2name(mj, mjOBJ_BODY, mj->geom_bodyid[contact.geom1]),
                       mj_id2name(mj, mjOBJ_BODY, mj->geom_bodyid[contact.geom2]));
  }
  return pairs;
}

std::vector<std::string> World::ContactsOf(const std::string& body) const {
  const mjModel* mj = scene_->model().mj.get();
  const int id = scene_->model().BodyId(body);
  std::vector<std::string> names;
  for (int i = 0; i < state_->mj->ncon; ++i) {
    const mjContact& contact = state_->mj->contact[i];
    const int a = mj->geom_bodyid[contact.geom1], b = mj->geom_bodyid[contact.geom2];
    if (a != id && b != id) continue;
    names.emplace_back(mj_id2name(mj, mjOBJ_BODY, a == id ? b : a));
  }
  std::sort(names.begin(), names.end());
  names.erase(std::unique(names.begin(), names.end()), names.end());
  return names;
}

bool World::Grasped(const std::string& object) const {
  const std::vector<std::string> touching = ContactsOf(object);
  const auto touches = [&](const std::string& body) { return std::ranges::binary_search(touching, body); };
  return std::ranges::all_of(scene_->arm().finger_groups,
                             [&](const auto& group) { return std::ranges::any_of(group, touches); });
}

}  // namespace etude::sim
