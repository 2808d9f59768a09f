// SPDX-License-Identifier: Apache-2.0
#include "worker/task/trace.h"

#include <algorithm>
#include <utility>

namespace etude::task {
namespace {

constexpr double kAboutAsNear = 1e-4;  // m, beyond what two ways to the same distance differ by

}  // namespace

Tracer::Tracer(std::shared_ptr<const sim::Scene> scene, const EpisodePlan& plan, int stride, AttemptTrace* trace)
    : checker_(scene), target_(plan.target), stride_(stride), trace_(trace) {
  trace_->scene = scene;
  trace_->bodies = scene->arm().bodies;
  for (const auto& object : scene->objects()) trace_->bodies.push_back(object.name);
  checker_.Allow({plan.target});
}

void Tracer::Observe(const sim::World& world) {
  std::vector<Pose> poses = world.ArmPoses();
  for (const auto& object : world.scene().objects()) poses.push_back(world.ObjectPose(object.name));
  trace_->poses.push_back(std::move(poses));
  trace_->effort.Observe(world, target_);
  const int step = static_cast<int>(trace_->poses.size()) - 1;
  if (step % stride_ != 0) return;
  for (const auto& object : world.scene().objects()) checker_.SetObject(object.name, world.ObjectPose(object.name));
  checker_.SetGripper(world.gripper());
  AttemptTrace::Near near{step, checker_.Nearest(world.q()), std::nullopt};
  if (!near.pair.body_a.empty())
    for (auto& about : checker_.Distances(world.q(), near.pair.distance + kAboutAsNear))
      if (about.body_a == near.pair.body_a && about.body_b == near.pair.body_b) near.where = std::move(about);
  trace_->nearest.push_back(std::move(near));
}

}  // namespace etude::task
