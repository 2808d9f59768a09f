// SPDX-License-Identifier: Apache-2.0
#include "worker/task/episode_environment.h"

#include <fmt/format.h>

#include <algorithm>

#include "services/core/check.h"
#include "services/spec/object_names.h"
#include "worker/task/distractor_placing.h"
#include "worker/task/feasibility_check.h"
#include "worker/task/start_rule.h"
#include "worker/task/task_stages.h"

namespace etude::task {
namespace {

constexpr int kStarts = 200;              // whole starts drawn until the task can be done in one
constexpr int kPlaceDraws = 100;          // arrangements drawn until the target's place is taken, then any is
constexpr int kSettleSteps = 25;          // before an attempt: objects come to rest
constexpr double kSettleDistance = 0.01;  // m that an object may move meanwhile
constexpr double kLowestStart = 0.03;     // m between the hand and the table in a low start

const PlacedObject* Find(const std::vector<PlacedObject>& objects, const std::string& name) {
  const auto it = std::find_if(objects.begin(), objects.end(), [&](const auto& object) { return object.name == name; });
  return it == objects.end() ? nullptr : &*it;
}

std::vector<std::string> Names(const std::vector<PlacedObject>& objects) {
  std::vector<std::string> names;
  for (const auto& object : objects) names.push_back(object.name);
  return names;
}

}  // namespace

EpisodeEnvironment::EpisodeEnvironment(std::shared_ptr<const sim::Scene> scene_in, sim::Renderer renderer_in)
    : scene(scene_in),
      world(scene_in),
      renderer(std::move(renderer_in)),
      checker(scene_in),
      planner(scene_in, &checker),
      shapes(*scene_in, planner.kinematics()) {}

Result<std::unique_ptr<EpisodeEnvironment>> EpisodeEnvironment::Open(const SceneSpec& spec,
                                                                     const sim::RendererConfig& renderer_config) {
  ETUDE_ASSIGN_OR_RETURN(auto scene, sim::Scene::Build(spec));
  ETUDE_ASSIGN_OR_RETURN(auto renderer, sim::Renderer::Open(scene, renderer_config));
  return std::unique_ptr<EpisodeEnvironment>(new EpisodeEnvironment(std::move(scene), std::move(renderer)));
}

OrderedJson SceneDraws::Json() const {
  OrderedJson list = OrderedJson::array();
  for (const auto& [reason, detail] : rejected) list.push_back({{"reason", reason}, {"detail", detail}});
  return {{"draws", rejected.size() + found}, {"rejected", std::move(list)}};
}

SceneDraws EpisodeEnvironment::Prepare(const EpisodePlan& plan, const RandomizationSpec& randomization,
                                       const std::function<void(int start)>& drawing) {
  Streams streams{Rng(plan.seeds.scene), Rng(plan.seeds.distractors), Rng(plan.seeds.places)};
  Rng light_rng(plan.seeds.light);
  const auto appearance = sim::DrawAppearance(randomization.light, scene->body_count(), light_rng);
  renderer.SetAppearance(sim::WithWorld(appearance, plan.world, *scene));
  renderer.SetCamera(plan.world.camera ? std::optional(ToCamera(*plan.world.camera)) : std::nullopt);
  const auto stages = StagesOf(plan.task, shapes, plan.clearance);
  SceneDraws draws;
  for (int number = 0; number < (plan.first_draw ? 1 : kStarts); ++number) {
    if (drawing) drawing(number);
    Rejection why;
    const auto start = Draw(plan, stages, randomization, streams, why);
    if (!start) {
      draws.rejected.push_back(std::move(why));
      continue;
    }
    draws.found = true;
    world.Reset();
    for (const auto& object : start->objects) world.SetObject(object.name, object.X_WO);
    world.SetArm(start->q);
    world.Forward();
    draws.failure = Settle(*start).value_or("");
    return draws;
  }
  draws.failure = (plan.first_draw ? "the task cannot be done from the first start that was drawn: "
                                   : "no start found in which the task can be done: ") +
                  draws.rejected.back().detail;
  return draws;
}

std::optional<EpisodeEnvironment::Start> EpisodeEnvironment::Draw(const EpisodePlan& plan,
                                                                  const std::vector<Stage>& stages,
                                                                  const RandomizationSpec& randomization,
                                                                  Streams& streams, Rejection& why) {
  Rng& rng = streams.scene;
  const Things things = ThingsOf(plan);
  const StartSpec& start_rule = plan.task.spec->start;
  auto objects = Arrange(plan, things.objects, randomization.yaw, streams);
  if (!objects) return why = {"no_arrangement", "no arrangement of the objects"}, std::nullopt;
  const PlacedObject* target = Find(*objects, plan.target);
  ETUDE_CHECK(target, "target={}", plan.target);
  StageContext now{.shapes = &shapes, .target = plan.target, .reference = plan.reference, .X_WO = target->X_WO};
  if (const PlacedObject* reference = Find(*objects, plan.reference)) now.X_WR = reference->X_WO;
  const Cast cast{.target = plan.target, .reference = plan.reference, .objects = Names(*objects)};
  const auto already = Already(*plan.task.spec, cast, *objects, shapes);
  if (!already) return why = {"no_such_object", already.error().message}, std::nullopt;
  if (*already) return why = {"already_done", **already}, std::nullopt;
  checker.ClearObjects();
  for (const auto& object : *objects) checker.SetObject(object.name, object.X_WO);
  const auto q = DrawArm(plan, randomization, rng);
  if (!q) return why = {"no_arm_start", "no free start of the arm"}, std::nullopt;
  now.X_WE = planner.kinematics().X_WE(*q);
  const auto first_move = std::ranges::find_if(stages, &Stage::moves);  // a task may begin by holding still
  if (things.ball && first_move != stages.end()) {
    std::vector<PlacedObject> keep_clear = *objects;
    for (const auto& place : start_rule.keep_clear)
      keep_clear.push_back({"", {now.X_WO.p + Eigen::Vector3d(place[0], place[1], 0), {}}});
    const auto placed = PlaceObstacle(*things.ball, plan.obstacle, keep_clear, *q, first_move->goal(now),
                                      planner.kinematics(), checker, rng);
    if (!placed) return why = {"no_obstacle_place", "no place for the obstacle"}, std::nullopt;
    objects->push_back(*placed);
  }
  if (const auto refused = CheckFeasible(stages, now, {&planner.kinematics(), &checker, *q}))
    return why = *refused, std::nullopt;
  Start start{*objects, *q};
  if (const auto refused = AddDistractors(plan, stages, now, randomization.yaw, start, streams.distractors))
    return why = *refused, std::nullopt;
  return start;
}

// Where weights decide on the target's place it is rejection sampling: each place comes as often as it would, times its
// weight, and the rest of the arrangement is as if nobody had asked. The smallest weight is a tenth of the largest.
std::optional<std::vector<PlacedObject>> EpisodeEnvironment::Arrange(const EpisodePlan& plan,
                                                                     const std::vector<sim::ObjectInfo>& objects,
                                                                     double yaw, Streams& streams) const {
  const auto& boxes = plan.task.spec->start.roomy() ? RoomyBoxes() : LocationBoxes();
  for (int left = kPlaceDraws;; --left) {
    auto placed = PlaceObjects(objects, boxes, yaw, streams.scene);
    if (!placed || left <= 1) return placed;
    const PlacedObject* target = Find(*placed, plan.target);
    ETUDE_CHECK(target, "target={}", plan.target);
    if (AcceptPlace(plan.place_weights, target->X_WO.p.x(), target->X_WO.p.y(), streams.places)) return placed;
  }
}

EpisodeEnvironment::Things EpisodeEnvironment::ThingsOf(const EpisodePlan& plan) const {
  Things things;
  for (const auto& object : scene->objects()) {
    if (object.name == kObstacleObject && plan.has_obstacle())
      things.ball = object;
    else if (IsDistractor(object.name))
      things.distractors.push_back(object);
    else
      things.objects.push_back(object);
  }
  return things;
}

std::optional<Rejection> EpisodeEnvironment::AddDistractors(const EpisodePlan& plan, const std::vector<Stage>& stages,
                                                            const StageContext& now, double yaw, Start& start,
                                                            Rng& rng) {
  const auto feasible = [&] {
    // the last check has moved the target through its task
    checker.Attach(plan.target, std::nullopt);
    checker.SetObject(plan.target, now.X_WO);
    checker.Allow({});
    checker.SetGripper(0);
    if (checker.Collides(start.q, kStartMargin)) return false;
    return !CheckFeasible(stages, now, {&planner.kinematics(), &checker, start.q});
  };
  const PlacedScene placed{.infos = &scene->objects(),
                           .objects = &start.objects,
                           .roles = {plan.target, plan.reference},
                           .yaw = yaw,
                           .feasible = feasible};
  const auto distractors = PlaceDistractors(ThingsOf(plan).distractors, placed, checker, rng);
  if (!distractors) return Rejection{"no_distractor_place", "no place for the distractors"};
  start.objects.insert(start.objects.end(), distractors->begin(), distractors->end());
  return std::nullopt;
}

std::optional<Eigen::VectorXd> EpisodeEnvironment::DrawArm(const EpisodePlan& plan,
                                                           const RandomizationSpec& randomization, Rng& rng) {
  checker.SetGripper(0);
  if (!plan.has_obstacle()) return DrawStart(scene->arm(), randomization, planner.kinematics(), checker, rng);
  const Eigen::Quaterniond q_home = planner.kinematics().X_WE(scene->arm().q_home).q;
  const double below = shapes.Reach(SceneGeometry::Part::kHand, false, q_home, -Eigen::Vector3d::UnitZ());
  return DrawLowStart(scene->arm(), below + kLowestStart, planner.kinematics(), checker, rng);
}

std::optional<std::string> EpisodeEnvironment::Settle(const Start& start) {
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
