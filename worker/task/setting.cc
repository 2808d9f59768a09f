// SPDX-License-Identifier: Apache-2.0
#include "worker/task/setting.h"

#include <fmt/format.h>

#include <algorithm>

#include "services/core/check.h"
#include "worker/task/rehearsal.h"

namespace etude::task {
namespace {

constexpr int kStarts = 200;              // whole starts drawn until the task can be done in one
constexpr int kSettleSteps = 25;          // before an attempt: objects come to rest
constexpr double kSettleDistance = 0.01;  // m that an object may move meanwhile
constexpr double kLowestStart = 0.03;     // m between the hand and the table in a low start

const PlacedObject* Find(const std::vector<PlacedObject>& objects, const std::string& name) {
  const auto it = std::find_if(objects.begin(), objects.end(), [&](const auto& object) { return object.name == name; });
  return it == objects.end() ? nullptr : &*it;
}

}  // namespace

Setting::Setting(std::shared_ptr<const sim::Scene> scene_in, sim::Renderer renderer_in)
    : scene(scene_in),
      world(scene_in),
      renderer(std::move(renderer_in)),
      checker(scene_in),
      planner(scene_in, &checker),
      shapes(*scene_in, planner.kinematics()) {}

Result<std::unique_ptr<Setting>> Setting::Open(const SceneSpec& spec, const sim::RendererConfig& renderer_config) {
  ETUDE_ASSIGN_OR_RETURN(auto scene, sim::Scene::Build(spec));
  ETUDE_ASSIGN_OR_RETURN(auto renderer, sim::Renderer::Open(scene, renderer_config));
  return std::unique_ptr<Setting>(new Setting(std::move(scene), std::move(renderer)));
}

std::optional<std::string> Setting::Prepare(const SessionConfig& config, const RandomizationSpec& randomization,
                                            ObstaclePlace obstacle, std::uint64_t seed) {
  Rng rng(MixSeed({seed}, "scene")), light_rng(MixSeed({seed}, "light"));
  renderer.SetAppearance(sim::DrawAppearance(randomization.light, scene->body_count(), light_rng));
  const auto stages = StagesOf(config.task, shapes);
  std::string why;
  for (int draw = 0; draw < kStarts; ++draw) {
    const auto start = Draw(config, stages, randomization, obstacle, rng, why);
    if (!start) continue;
    world.Reset();
    for (const auto& object : start->objects) world.SetObject(object.name, object.X_WO);
    world.SetArm(start->q);
    world.Forward();
    return Settle(*start);
  }
  return fmt::format("no start found in which the task can be done: {}", why);
}

std::optional<Setting::Start> Setting::Draw(const SessionConfig& config, const std::vector<Stage>& stages,
                                            const RandomizationSpec& randomization, ObstaclePlace obstacle, Rng& rng,
                                            std::string& why) {
  std::vector<sim::ObjectInfo> infos;
  const sim::ObjectInfo* ball = nullptr;
  for (const auto& object : scene->objects()) {
    if (object.name == kObstacleObject && config.task.avoid == "obstacle") {
      ball = &object;
    } else {
      infos.push_back(object);
    }
  }
  auto objects = PlaceObjects(infos, config.task.relation() ? RoomyBoxes() : LocationBoxes(), randomization.yaw, rng);
  if (!objects) return why = "no arrangement of the objects", std::nullopt;
  const PlacedObject* target = Find(*objects, config.target);
  ETUDE_CHECK(target, "target={}", config.target);
  Situation now{.shapes = &shapes, .target = config.target, .reference = config.reference, .X_WO = target->X_WO};
  if (const PlacedObject* reference = Find(*objects, config.reference)) {
    now.X_WR = reference->X_WO;
    if (IsBeside(config.task.base, now.X_WO.p, now.X_WR.p)) return why = "already beside", std::nullopt;
  }
  checker.ClearObjects();
  for (const auto& object : *objects) checker.SetObject(object.name, object.X_WO);
  const auto q = DrawArm(config, randomization, rng);
  if (!q) return why = "no free start of the arm", std::nullopt;
  now.X_WE = planner.kinematics().X_WE(*q);
  if (ball) {
    std::vector<PlacedObject> keep_clear = *objects;
    if (config.task.base == "push")
      for (const double y : {0.07, 0.14}) keep_clear.push_back({"", {now.X_WO.p + Eigen::Vector3d(0, y, 0), {}}});
    const auto placed =
        PlaceObstacle(*ball, obstacle, keep_clear, *q, stages.front().goal(now), planner.kinematics(), checker, rng);
    if (!placed) return why = "no place for the obstacle", std::nullopt;
    objects->push_back(*placed);
  }
  if (const auto refused = Rehearse(stages, now, {&planner.kinematics(), &checker, *q}))
    return why = *refused, std::nullopt;
  return Start{*objects, *q};
}

std::optional<Eigen::VectorXd> Setting::DrawArm(const SessionConfig& config, const RandomizationSpec& randomization,
                                                Rng& rng) {
  checker.SetGripper(0);
  if (config.task.avoid != "obstacle")
    return DrawStart(scene->arm(), randomization, planner.kinematics(), checker, rng);
  const Eigen::Quaterniond q_home = planner.kinematics().X_WE(scene->arm().q_home).q;
  const double below = shapes.Reach(Shapes::Part::kHand, false, q_home, -Eigen::Vector3d::UnitZ());
  return DrawLowStart(scene->arm(), below + kLowestStart, planner.kinematics(), checker, rng);
}

std::optional<std::string> Setting::Settle(const Start& start) {
  const Waypoint here{world.X_WE(), 0};
  for (int t = 0; t < kSettleSteps; ++t) world.Step(here, Vector6::Zero());
  if (!world.healthy()) return "the simulation is unstable";
  for (const auto& object : start.objects) {
    const Pose X_WO = world.ObjectPose(object.name);
    const double moved = (X_WO.p - object.X_WO.p).norm();
    const double tilt = AngleBetween(X_WO.q, object.X_WO.q);
    if (moved > kSettleDistance || tilt > 0.05)
      return fmt::format("{} moved by {:.3f} m, {:.2f} rad while settling", object.name, moved, tilt);
  }
  return std::nullopt;
}

}  // namespace etude::task
