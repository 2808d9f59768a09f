// SPDX-License-Identifier: Apache-2.0
#include "worker/task/stage.h"

#include <algorithm>

#include "services/core/check.h"
#include "worker/task/goals.h"

namespace etude::task {
namespace {

constexpr double kRelationPitch = 1.05;   // rad at least: objects are set down from above
constexpr double kAvoidClearance = 0.05;  // m wished from what is to be avoided

// Makes stages for one hand and task.
class Stages {
 public:
  Stages(TaskGoals goals, double joint_speed, bool over)
      : goals_(std::move(goals)), joint_speed_(joint_speed), over_(over) {}

  Stage Approach(bool closed) const {
    return {.name = "approach",
            .goal = closed ? goals_.before_push : goals_.before_grasp,
            .closed = closed,
            .limits = Speed(0.70, 3.5, 2.4, 12.0),
            .blends = true,
            .disturbable = true,
            .calm = 0.03};
  }

  Stage Reach() const {
    return {.name = "reach",
            .goal = goals_.at_grasp,
            .limits = Speed(0.35, 2.0, 1.5, 8.0),
            .straight_only = true,
            .touches_target = true,
            .disturbable = true,
            .calm = 0.06,
            .back_to = 1};
  }

  Stage Grasp() const {
    return {.name = "grasp",
            .closed = true,
            .touches_target = true,
            .min_steps = 12,
            .max_steps = 80,
            .done = [](const sim::World& world, const std::string& target) { return world.Grasped(target); }};
  }

  Stage Lift(bool blends) const {
    return {.name = "lift",
            .goal = goals_.lifted,
            .closed = true,
            .limits = Speed(0.45, 2.5, 1.5, 8.0),
            .touches_target = true,
            .holds = true,
            .blends = blends,
            .disturbable = true,
            .calm = 0.05};
  }

  Stage Push() const {
    return {.name = "push",
            .goal = goals_.pushed,
            .nearer = goals_.pushed_less,
            .closed = true,
            .limits = Speed(0.24, 1.5, 1.5, 8.0),
            .straight_only = true,
            .touches_target = true,
            .disturbable = true,
            .calm = 0.15,
            .back_to = 1};
  }

  Stage Turn() const { return Holding("turn", goals_.turned, Speed(0.45, 2.0, 2.4, 10.0), 0.04); }
  Stage Carry() const { return Holding("carry", goals_.carried, Speed(0.45, 2.0, 1.5, 8.0), 0.04); }

  Stage Place(const Goal& goal) const {
    Stage stage = Holding("place", goal, Speed(0.35, 1.6, 1.5, 8.0), 0.07);
    stage.straight_only = true;
    return stage;
  }

  Stage Retreat() const {
    return {.name = "retreat",
            .goal = goals_.retreated,
            .limits = Speed(0.45, 2.5, 1.5, 8.0),
            .straight_only = true,
            .touches_target = true};
  }

  static Stage Wait(std::string name, bool closed, int steps) {
    return {.name = std::move(name), .closed = closed, .touches_target = true, .min_steps = steps, .max_steps = steps};
  }

  std::vector<Stage> Of(const TaskName& task) const {
    if (task.base == "pick") return {Approach(false), Reach(), Grasp(), Lift(false), Wait("hold", true, 20)};
    if (task.base == "push") return {Approach(true), Push(), Wait("hold", true, 20)};
    if (task.base == "rotate") return {Approach(false), Reach(), Grasp(), Lift(true), Turn(), Wait("hold", true, 20)};
    std::vector<Stage> stages{Approach(false), Reach(), Grasp(), Lift(true)};
    if (task.relation()) {
      stages.insert(stages.end(), {Carry(), Place(goals_.set_down)});
    } else {
      ETUDE_CHECK(task.base == "put_down", "task={}", task.base);
      stages.insert(stages.end(), {Turn(), Place(goals_.laid)});
    }
    stages.insert(stages.end(), {Wait("release", false, 14), Retreat(), Wait("hold", false, 20)});
    return stages;
  }

  bool over() const { return over_; }

 private:
  plan::Limits Speed(double linear, double linear_accel, double angular, double angular_accel) const {
    return {.linear = linear,
            .angular = angular,
            .linear_accel = linear_accel,
            .angular_accel = angular_accel,
            .joint = joint_speed_};
  }

  Stage Holding(std::string name, Goal goal, const plan::Limits& limits, double calm) const {
    return {.name = std::move(name),
            .goal = std::move(goal),
            .closed = true,
            .limits = limits,
            .touches_target = true,
            .holds = true,
            .disturbable = true,
            .calm = calm};
  }

  TaskGoals goals_;
  double joint_speed_;
  bool over_;
};

Stages For(const TaskName& task, const Shapes& shapes) {
  double pitch = shapes.natural_pitch();
  if (task.relation()) pitch = std::max(pitch, kRelationPitch);
  if (pitch > 0) return Stages(AboveGoals(pitch, task), shapes.joint_speed(), true);
  return Stages(SideGoals(), shapes.joint_speed(), false);
}

}  // namespace

std::vector<Stage> StagesOf(const TaskName& task, const Shapes& shapes) {
  const Stages make = For(task, shapes);
  std::vector<Stage> stages = make.Of(task);
  for (Stage& stage : stages) {
    stage.detours_over = make.over();
    // a palm that lays down from above is wider than the lane between two objects: no pushes out of it
    if (make.over() && task.base == "put_down" && stage.holds) stage.disturbable = false;
    // where contact is wanted the straight way is the short one: the field is for the ways in between
    if (!task.avoid.empty() && stage.moves() && !stage.straight_only) stage.clearance = kAvoidClearance;
  }
  return stages;
}

}  // namespace etude::task
