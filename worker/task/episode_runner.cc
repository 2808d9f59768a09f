// SPDX-License-Identifier: Apache-2.0
#include "worker/task/episode_runner.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <initializer_list>
#include <utility>

#include "services/core/check.h"
#include "services/episode/codec.h"
#include "worker/plan/timer.h"

namespace etude::task {
namespace {

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

}  // namespace

Result<EpisodeRunner> EpisodeRunner::Open(const EpisodeParts& parts, const EpisodePlan& plan,
                                          const RecordConfig& config) {
  JudgeCase judged{
      .criteria = CriteriaOf(plan.task), .target = plan.target, .reference = plan.reference, .avoid = plan.avoid};
  for (const auto& name : plan.distractors)
    if (std::ranges::find(judged.avoid, name) == judged.avoid.end()) judged.avoid.push_back(name);
  ETUDE_ASSIGN_OR_RETURN(Judge judge, Judge::Make(judged, *parts.world, *parts.shapes, parts.checker));
  return EpisodeRunner(parts, plan, config, std::move(judge));
}

EpisodeRunner::EpisodeRunner(const EpisodeParts& parts, const EpisodePlan& plan, const RecordConfig& config,
                             Judge judge)
    : parts_(parts),
      plan_(plan),
      config_(config),
      judge_(std::move(judge)),
      frames_(codec::LayoutFor(parts.renderer->camera().width, parts.renderer->camera().height)) {
  PrepareTracks();
}

void EpisodeRunner::PrepareTracks() {
  const sim::World& world = *parts_.world;
  const sim::Scene& scene = world.scene();
  episode_.task = plan_.task.text();
  episode_.target = plan_.target;
  episode_.reference = plan_.reference;
  episode_.image_stride = config_.image_stride;
  episode_.joint_pos.columns = episode_.joint_vel.columns = static_cast<int>(world.q().size());
  episode_.gripper_qpos.columns = static_cast<int>(world.gripper_q().size());
  episode_.eef_pos.columns = 3;
  episode_.eef_quat.columns = 4;
  episode_.eef_pixel.columns = 2;
  episode_.actions_abs.columns = kWaypointSize;
  episode_.states.columns = static_cast<int>(world.StateVector().size());
  for (const auto& object : scene.objects()) episode_.objects.push_back({object.name, {.columns = 7}, {.columns = 2}});
  const Camera& camera = parts_.renderer->camera();
  episode_.cameras.push_back({camera, {}, {}});
  picture_.resize(static_cast<std::size_t>(camera.width) * camera.height * 3);
}

bool EpisodeRunner::Step(const Command& command) {
  if (config_.go_on && !config_.go_on()) {
    failure_ = AttemptOutcome::kStopped;
    failure_reason_ = "stopped";
    return false;
  }
  if (steps() >= config_.max_steps) {
    failure_ = AttemptOutcome::kTimeout;
    failure_reason_ = "still not done";
    return false;
  }
  const int step = steps();
  if (config_.record_frames && step % config_.image_stride == 0) RecordFrame();
  RecordState();
  if (config_.observe) config_.observe(*parts_.world);
  RecordCommand(command);
  const auto phase = static_cast<std::size_t>(command.phase);
  if (config_.progress && phase < episode_.stage_names.size()) config_.progress(episode_.stage_names[phase], step);
  sim::World& world = *parts_.world;
  {
    const plan::Timer watch(times_.step);
    world.Step(command.target, command.V_WE);
    if (const std::string pushed = std::exchange(pushed_, {}); !pushed.empty()) judge_.Displaced(world, pushed);
    judge_.Observe(world);
  }
  if (!world.healthy()) {
    failure_ = AttemptOutcome::kUnstable;
    failure_reason_ = "the simulation is unstable";
  }
  return failure_ == AttemptOutcome::kSuccess;
}

void EpisodeRunner::PushObject(const std::string& object, const Pose& X_WO, const Eigen::Vector3d& v_WO) {
  parts_.world->Guide(object, X_WO, v_WO);
  pushed_ = object;
}

std::span<const std::uint8_t> EpisodeRunner::Picture() {
  if (pictured_step_ != steps()) {
    const plan::Timer watch(times_.render);
    parts_.renderer->Render(*parts_.world, picture_);
    if (config_.retouch) config_.retouch(picture_);
    pictured_step_ = steps();
  }
  return picture_;
}

void EpisodeRunner::RecordFrame() {
  const auto picture = Picture();
  const plan::Timer watch(times_.deflate);
  frames_.Add(picture);
}

Episode EpisodeRunner::TakeEpisode() {
  const plan::Timer watch(times_.deflate);
  codec::DeflatedFrames frames = frames_.Finish();
  ETUDE_CHECK(
      frames.count == 0 || static_cast<std::int64_t>(frames.count) == FrameCount(steps(), episode_.image_stride),
      "{} of {} steps", frames.count, steps());
  episode_.cameras[0].Take(std::move(frames));
  return std::move(episode_);
}

void EpisodeRunner::RecordState() {
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

void EpisodeRunner::RecordCommand(const Command& command) {
  episode_.actions_abs.Push(ToVector({command.target.X_WE, command.target.gripper > 0.5 ? 1.0 : 0.0}));
  episode_.phase.push_back(static_cast<std::uint8_t>(command.phase));
  episode_.supervise.push_back(command.supervise ? 1 : 0);
}

}  // namespace etude::task
