// SPDX-License-Identifier: Apache-2.0
#include "worker/task/session.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <initializer_list>

#include "services/store/dataset.h"

namespace etude::task {
namespace {

std::int64_t NowNs() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

void Push(Track& track, std::initializer_list<double> values) {
  std::array<float, 8> row{};
  std::size_t n = 0;
  for (double value : values) row[n++] = static_cast<float>(value);
  track.Push({row.data(), n});
}

void Push(Track& track, const Eigen::VectorXd& values) {
  const Eigen::VectorXf row = values.cast<float>();
  track.Push({row.data(), static_cast<std::size_t>(row.size())});
}

std::vector<std::pair<std::string, Pose>> OtherObjects(const sim::World& world, const std::string& target) {
  std::vector<std::pair<std::string, Pose>> others;
  for (const auto& object : world.scene().objects())
    if (object.name != target) others.emplace_back(object.name, world.ObjectPose(object.name));
  return others;
}

}  // namespace

Stopwatch::Stopwatch(double& sum) : sum_(sum), start_ns_(NowNs()) {}
Stopwatch::~Stopwatch() { sum_ += static_cast<double>(NowNs() - start_ns_) * 1e-9; }

Session::Session(const SessionParts& parts, const SessionConfig& config)
    : parts_(parts),
      config_(config),
      criterion_(config.task.base, parts.world->ObjectPose(config.target)),
      watch_(OtherObjects(*parts.world, config.target)) {
  PrepareTracks();
}

void Session::PrepareTracks() {
  const sim::World& world = *parts_.world;
  const sim::Scene& scene = world.scene();
  episode_.task = config_.task.text();
  episode_.target = config_.target;
  episode_.reference = config_.reference;
  episode_.image_stride = config_.image_stride;
  episode_.joint_pos.columns = episode_.joint_vel.columns = static_cast<int>(world.q().size());
  episode_.gripper_qpos.columns = static_cast<int>(world.gripper_q().size());
  episode_.eef_pos.columns = 3;
  episode_.eef_quat.columns = 4;
  episode_.eef_pixel.columns = 2;
  episode_.actions_abs.columns = 7;
  episode_.states.columns = static_cast<int>(world.StateVector().size());
  for (const auto& object : scene.objects()) episode_.objects.push_back({object.name, {.columns = 7}, {.columns = 2}});
  episode_.cameras.push_back({scene.camera(), {}});
  const Camera& camera = scene.camera();
  picture_.resize(static_cast<std::size_t>(camera.width) * camera.height * 3);
}

bool Session::Step(const Command& command) {
  if (steps() >= config_.max_steps) {
    failure_ = AttemptOutcome::kTimeout;
    failure_reason_ = "still not done";
    return false;
  }
  const int step = steps();
  if (config_.record_frames && step % config_.image_stride == 0) RecordFrame();
  RecordState();
  RecordCommand(command);
  sim::World& world = *parts_.world;
  {
    const Stopwatch watch(times_.step);
    world.Step(command.target, command.V_WE);
  }
  ObserveCriterion();
  for (const auto& object : world.scene().objects()) watch_.Observe(object.name, world.ObjectPose(object.name));
  failure_reason_ = Collision();
  if (!failure_reason_.empty()) failure_ = AttemptOutcome::kCollision;
  if (!world.healthy()) {
    failure_ = AttemptOutcome::kUnstable;
    failure_reason_ = "the simulation is unstable";
  }
  return failure_ == AttemptOutcome::kSuccess;
}

void Session::ObserveCriterion() {
  const sim::World& world = *parts_.world;
  Observed now{.X_WO = world.ObjectPose(config_.target)};
  if (config_.task.relation()) {
    now.X_WR = world.ObjectPose(config_.reference);
    const auto& arm = world.scene().arm().bodies;
    for (const auto& body : world.ContactsOf(config_.target))
      now.held = now.held || std::find(arm.begin(), arm.end(), body) != arm.end();
  }
  criterion_.Observe(now);
}

std::string Session::Collision() const {
  const sim::World& world = *parts_.world;
  const auto& arm = world.scene().arm().bodies;
  for (const auto& avoided : config_.avoid)
    for (const auto& body : world.ContactsOf(avoided))
      if (body == config_.target || std::find(arm.begin(), arm.end(), body) != arm.end())
        return fmt::format("{} touches {}", body, avoided);
  return {};
}

std::span<const std::uint8_t> Session::Picture() {
  if (pictured_step_ != steps()) {
    const Stopwatch watch(times_.render);
    parts_.renderer->Render(*parts_.world, picture_);
    pictured_step_ = steps();
  }
  return picture_;
}

void Session::RecordFrame() {
  const auto picture = Picture();
  const Stopwatch watch(times_.deflate);
  episode_.cameras[0].frames.push_back(store::DeflateFrame(picture));
}

void Session::RecordState() {
  const sim::World& world = *parts_.world;
  const Camera& camera = episode_.cameras[0].camera;
  const Pose X_WE = world.X_WE();
  const Eigen::Vector2d pixel = camera.Project(X_WE.p);
  Push(episode_.joint_pos, world.q());
  Push(episode_.joint_vel, world.v());
  Push(episode_.gripper_qpos, world.gripper_q());
  Push(episode_.eef_pos, {X_WE.p.x(), X_WE.p.y(), X_WE.p.z()});
  Push(episode_.eef_quat, {X_WE.q.w(), X_WE.q.x(), X_WE.q.y(), X_WE.q.z()});
  Push(episode_.eef_pixel, {pixel.x(), pixel.y()});
  episode_.states.Push(world.StateVector());
  for (auto& object : episode_.objects) {
    const Pose X_WO = world.ObjectPose(object.name);
    const Eigen::Vector2d centre = camera.Project(X_WO * parts_.shapes->Centre(object.name));
    Push(object.pose, {X_WO.p.x(), X_WO.p.y(), X_WO.p.z(), X_WO.q.w(), X_WO.q.x(), X_WO.q.y(), X_WO.q.z()});
    Push(object.pixel, {centre.x(), centre.y()});
  }
}

void Session::RecordCommand(const Command& command) {
  const Pose& X_WE = command.target.X_WE;
  const Eigen::Vector3d rpy = ToEuler(X_WE.q);
  Push(episode_.actions_abs,
       {X_WE.p.x(), X_WE.p.y(), X_WE.p.z(), rpy.x(), rpy.y(), rpy.z(), command.target.gripper > 0.5 ? 1.0 : 0.0});
  episode_.phase.push_back(static_cast<std::uint8_t>(command.phase));
  episode_.supervise.push_back(command.supervise ? 1 : 0);
}

}  // namespace etude::task
