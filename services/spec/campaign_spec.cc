// SPDX-License-Identifier: Apache-2.0
#include "services/spec/campaign_spec.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>

#include "services/core/check.h"
#include "services/core/hash.h"
#include "services/core/rng.h"
#include "services/spec/content_version.h"
#include "services/spec/episode_world.h"
#include "services/spec/object_names.h"
#include "services/spec/robot_names.h"
#include "services/spec/task_name.h"
#include "services/spec/task_roles.h"

namespace etude {
namespace {

constexpr int kMostObjects = 6;
constexpr int kMostThings = 8;  // objects and distractors
const std::vector<std::string> kModes{"demonstrate", "rollout"};
const std::vector<std::string> kScenes{"feasible", "first_draw"};
const std::vector<std::string> kDeterminism{"bytes", "physics", "none"};
const std::vector<std::string> kExecutions{"tracked", "authors"};
const std::vector<std::string> kRenderers{"software", "gpu"};

/// What is wrong so far.
class Problems {
 public:
  void Require(bool good, const std::string& message) {
    if (!good) errors_.push_back(message);
  }
  void Require(const Status& status, const char* key = nullptr) {
    if (!status) errors_.push_back(key ? fmt::format("{}: {}", key, status.error().message) : status.error().message);
  }
  void Known(const char* key, const std::string& value, const std::vector<std::string>& known) {
    if (std::find(known.begin(), known.end(), value) != known.end()) return;
    errors_.push_back(fmt::format("{}: {}", key, NotKnown(value, known)));
  }
  template <class T>
  void InRange(const char* key, T value, T low, T high) {
    Require(value >= low && value <= high, fmt::format("{}: {} not in {}..{}", key, value, low, high));
  }
  std::vector<std::string>& errors() { return errors_; }

 private:
  std::vector<std::string> errors_;
};

int OnTable(const CampaignSpec& spec) {
  return spec.objects_per_scene == 0 ? static_cast<int>(spec.objects.size()) : spec.objects_per_scene;
}

// Whether some object can be the target, and with a reference another one that.
void CheckRoles(const TaskName& task, const CampaignSpec& spec, Problems& problems) {
  if (!task.relation()) return;
  if (OnTable(spec) < 2)
    return problems.Require(false, fmt::format("objects: task '{}' needs a second one to refer to", task.base));
  problems.Require(!PossibleTargets(*task.spec, spec.objects).empty(),
                   fmt::format("objects: task '{}' needs one of {} to refer to, and another one to move", task.base,
                               fmt::join(task.spec->reference.only, ", ")));
}

void CheckTasks(const CampaignSpec& spec, Problems& problems) {
  problems.Require(!spec.tasks.empty(), "tasks: at least one");
  for (const auto& name : spec.tasks) {
    if (std::ranges::count(spec.tasks, name) > 1 && &name == &*std::ranges::find(spec.tasks, name))
      problems.Require(false, fmt::format("tasks: '{}' twice; task_weights says how often each is drawn", name));
    const auto task = ParseTask(name);
    problems.Require(task ? Status() : Fail(task.error()), "tasks");
    if (task) CheckRoles(*task, spec, problems);
  }
  problems.Require(spec.task_weights.empty() || spec.task_weights.size() == spec.tasks.size(),
                   fmt::format("task_weights: {} for {} tasks", spec.task_weights.size(), spec.tasks.size()));
  for (const double weight : spec.task_weights)
    problems.Require(std::isfinite(weight) && weight > 0, fmt::format("task_weights: {} must be > 0", weight));
}

// {train: 1600, valid: 0.1, test: 400}: a share that was left as it is by default would make all of them shares.
bool HasCountsAndFractions(const SplitSpec& split) {
  const auto parts = {split.train, split.valid, split.test};
  const auto is_whole = [](double part) { return part == std::floor(part); };
  return std::ranges::any_of(parts, [&](double part) { return part > 1 && is_whole(part); }) &&
         !std::ranges::all_of(parts, is_whole);
}

bool HasObstacle(const CampaignSpec& spec) {
  return std::ranges::any_of(spec.tasks, [](const std::string& name) {
    const auto task = ParseTask(name);
    return task && task->avoid == "obstacle";
  });
}

void CheckObjects(const CampaignSpec& spec, Problems& problems) {
  const int on_table = OnTable(spec);
  problems.Require(on_table >= 1 && on_table <= kMostObjects,
                   fmt::format("objects: {} on the table, between 1 and {} fit{}", on_table, kMostObjects,
                               spec.objects_per_scene == 0 ? "; set objects_per_scene to draw some of them" : ""));
  problems.Require(spec.objects_per_scene <= static_cast<int>(spec.objects.size()),
                   fmt::format("objects_per_scene: {} of {} objects", spec.objects_per_scene, spec.objects.size()));
  // a sentence names a class, so that no two of one class stand on the table together
  std::set<std::string> nouns, scene_names;
  for (const auto& object : spec.objects) {
    const std::string called = SceneName(object);
    nouns.insert(ObjectNoun(object));
    scene_names.insert(called);
    problems.Require(CheckObjectName(object));
    // words go by the name: those of the built-in one need not be true of another
    const bool built_in = std::ranges::count(TabletopObjects(), called) > 0 || called == kObstacleObject;
    problems.Require(!IsObjectPath(object) || !built_in,
                     fmt::format("objects: '{}': sentences would call it what the built-in {} is called; give its "
                                 "folder another name",
                                 object, called));
  }
  problems.Require(on_table <= static_cast<int>(nouns.size()),
                   fmt::format("objects: {} on the table of {} classes; one of each at most", on_table, nouns.size()));
  problems.Require(scene_names.size() == spec.objects.size(), "objects: each name at most once");
  problems.Require(
      !scene_names.contains(kObstacleObject) || !HasObstacle(spec),
      fmt::format("objects: the {} is put there by the tasks with +obstacle; leave it out", kObstacleObject));
}

void CheckCamera(const CameraSpec& camera, Problems& problems) {
  const auto pixels_ok = [](int n) { return n >= 16 && n <= 2048; };
  problems.Require(pixels_ok(camera.width) && pixels_ok(camera.height),
                   fmt::format("camera: {}x{} not in 16..2048", camera.width, camera.height));
  problems.Require(camera.fovy_deg > 1 && camera.fovy_deg < 170, "camera.fovy_deg: not in 1..170");
  const auto three = [](const std::vector<double>& numbers) {
    return numbers.size() == 3 && std::ranges::all_of(numbers, [](double number) { return std::isfinite(number); });
  };
  problems.Require(three(camera.position), "camera.position: three numbers");
  constexpr double kFarthest = 11;  // m: 12 m from the camera, drawing ends
  if (three(camera.position))
    problems.Require(std::hypot(camera.position[0], camera.position[1], camera.position[2]) <= kFarthest,
                     fmt::format("camera.position: more than {} m from the table, where it sees nothing", kFarthest));
  problems.Require(three(camera.euler), "camera.euler: three numbers");
}

bool NamesSides(const CampaignSpec& spec) {
  return std::ranges::any_of(spec.tasks, [](const std::string& name) {
    const auto task = ParseTask(name);
    return task && std::ranges::any_of(task->spec->stages, [](const StageSpec& stage) {
             const auto* carry = std::get_if<CarrySpec>(&stage);
             return carry && (carry->whereto() == Whereto::kLeft || carry->whereto() == Whereto::kRight ||
                              carry->whereto() == Whereto::kFront || carry->whereto() == Whereto::kBehind);
           });
  });
}

// Left, right, front and behind are the world's (worker/task/predicates): as a camera at +y shows them. Through one
// that looks from elsewhere every sentence would say another side than the picture, and success would agree with it.
void CheckSides(const CampaignSpec& spec, Problems& problems) {
  const auto& camera = spec.camera;
  if (camera.position.size() != 3 || camera.euler.size() != 3 || !NamesSides(spec)) return;
  const Eigen::Vector3d right = ToCamera(camera).X_WC.q * Eigen::Vector3d::UnitX();
  problems.Require(
      right.x() < -0.7,
      "camera: tasks that say left, right, front or behind are as seen from +y, and this camera looks from "
      "elsewhere (camera.position, camera.euler): it would show another side than the sentence says");
}

void CheckRandomization(const RandomizationSpec& randomization, Problems& problems) {
  problems.InRange("randomization.yaw", randomization.yaw, 0.0, 3.2);
  problems.InRange("randomization.start_position", randomization.start_position, 0.0, 0.3);
  problems.InRange("randomization.start_orientation", randomization.start_orientation, 0.0, 0.8);
  problems.InRange("randomization.disturbance", randomization.disturbance, 0.0, 0.2);
  problems.InRange("randomization.disturbance_probability", randomization.disturbance_probability, 0.0, 1.0);
  problems.InRange("randomization.light", randomization.light, 0.0, 1.0);
  randomization.world.Check(problems.errors());
}

constexpr std::size_t kLongestRobot = 128;  // bytes; proto/policy.idl, Observation::robot

bool NamesTheBall(const CampaignSpec& spec) {
  return std::ranges::count(spec.objects, kObstacleObject) > 0 || HasObstacle(spec);
}

// What has a range of its own is looked at before this.
void CheckRandomWorld(const CampaignSpec& spec, Problems& problems) {
  const WorldRandomizationSpec& world = spec.randomization.world;
  const auto classes = PossibleDistractorClasses(spec).size();
  problems.Require(world.distractors <= static_cast<int>(classes),
                   fmt::format("randomization.world.distractors: {} of {} classes that no sentence names",
                               world.distractors, classes));
  problems.Require(OnTable(spec) + world.distractors <= kMostThings,
                   fmt::format("randomization.world.distractors: {} beside {} objects, {} fit in all",
                               world.distractors, OnTable(spec), kMostThings));
  problems.Require(world.distractor_balls == 0 || !NamesTheBall(spec),
                   fmt::format("randomization.world.distractor_balls: {} where sentences name the {}",
                               world.distractor_balls, kObstacleObject));
  if (!world.moves_camera() || spec.camera.position.size() != 3 || spec.camera.euler.size() != 3) return;
  problems.Require(SeesWorkVolume(spec.camera),
                   "camera: does not see all of the work volume; nor would one that moves (randomization.world)");
}

void CheckRollout(const RolloutSpec& rollout, Problems& problems) {
  problems.Require(IsPlainName(rollout.run), fmt::format("rollout.run: '{}' must be a run's name", rollout.run));
  problems.InRange("rollout.replan_steps", rollout.replan_steps, 1, 120);
  problems.InRange("rollout.max_steps", rollout.max_steps, 1, 100'000);
  problems.Require(
      rollout.latency_ms == -1 || (rollout.latency_ms >= 0 && rollout.latency_ms <= 960),
      fmt::format("rollout.latency_ms: {} not in 0..960, nor -1 (what the server measured)", rollout.latency_ms));
  problems.Known("rollout.execution", rollout.execution, kExecutions);
  problems.InRange("rollout.occlude", rollout.occlude, 0.0, 1.0);
  rollout.pushes.Check(problems.errors());
}

// What a spec of before these keys could not say is no part of the hash while nothing is said.
void EraseUnset(OrderedJson& rollout) {
  const OrderedJson unset = ToJson(RolloutSpec());
  for (const char* key : {"execution", "occlude", "pushes", "sentences"})
    if (rollout[key] == unset[key]) rollout.erase(key);
}

// What hosts have to have in common, and how they render.
void CheckHosts(const CampaignSpec& spec, Problems& problems) {
  problems.Known("determinism", spec.determinism, kDeterminism);
  problems.InRange("recheck", spec.recheck, 0.0, 1.0);
  problems.Require(spec.recheck == 0 || (spec.mode == "demonstrate" && spec.determinism == "bytes"),
                   "recheck: only for mode demonstrate with determinism: bytes");
  problems.Known("renderer", spec.renderer, kRenderers);
  problems.InRange("device", spec.device, -1, 63);
  problems.Require(spec.device == -1 || spec.renderer == "gpu", "device: only with renderer: gpu");
}

}  // namespace

Status CampaignSpec::Validate() const {
  Problems problems;
  problems.Require(IsPlainName(name), fmt::format("name: '{}' must match [a-z0-9_-]{{1,64}}", name));
  problems.Known("mode", mode, kModes);
  problems.Known("scenes", scenes, kScenes);
  CheckHosts(*this, problems);
  problems.Require(!robots.empty(), "robots: at least one");
  for (const auto& robot : robots) {
    const auto found = FindRobot(robot);
    problems.Require(found ? Status() : Fail(found.error()), "robots");
    problems.Require(robot.size() <= kLongestRobot,
                     fmt::format("robots: '{:.40}...' has {} bytes, and messages take {}: give a shorter path", robot,
                                 robot.size(), kLongestRobot));
  }
  CheckTasks(*this, problems);
  CheckObjects(*this, problems);
  problems.Require(episodes >= 1 && episodes <= 10'000'000, fmt::format("episodes: {} not in 1..10^7", episodes));
  problems.InRange("image_stride", image_stride, 1, 125);
  problems.Require(max_attempts >= 1 && max_attempts <= 1000,
                   fmt::format("max_attempts: {} not in 1..1000", max_attempts));
  problems.InRange("stall_timeout_s", stall_timeout_s, 1.0, 86'400.0);
  CheckCamera(camera, problems);
  CheckSides(*this, problems);
  CheckRandomization(randomization, problems);
  CheckRandomWorld(*this, problems);
  world.Check(problems.errors());
  problems.InRange("obstacle.in_the_way", obstacle.in_the_way, 0.0, 1.0);
  problems.InRange("obstacle.clearance", obstacle.clearance, 0.01, 0.3);
  adaptive_sampling.Check(problems.errors());
  if (mode == "rollout") {
    problems.Require(!adaptive_sampling.on(), "adaptive_sampling: only for mode demonstrate");
    CheckRollout(rollout, problems);
    CheckSentences(*this, problems.errors());
  }
  const double whole = split.train + split.valid + split.test;
  problems.Require(split.train >= 0 && split.valid >= 0 && split.test >= 0 && whole > 0 && std::isfinite(whole),
                   "split: fractions must be >= 0 and not all 0");
  problems.Require(
      !HasCountsAndFractions(split),
      fmt::format("split: {:g}, {:g} and {:g} of train, valid and test are counts and a fraction; write whole "
                  "numbers for all three, or fractions",
                  split.train, split.valid, split.test));
  if (problems.errors().empty()) return {};
  return Fail(Code::kInvalidArgument, fmt::format("campaign '{}': {}", name, fmt::join(problems.errors(), "; ")));
}

std::string SpecHash(const CampaignSpec& spec) {
  OrderedJson json = ToJson(spec);
  for (const char* key : {"name", "episodes", "max_attempts", "stall_timeout_s", "determinism", "recheck", "device"})
    json.erase(key);
  if (spec.renderer == CampaignSpec().renderer) json.erase("renderer");
  if (!spec.adaptive_sampling.on()) json.erase("split");
  if (spec.adaptive_sampling == AdaptiveSamplingSpec{}) json.erase("adaptive_sampling");
  if (spec.obstacle.clearance == ObstacleSpec().clearance) json["obstacle"].erase("clearance");
  if (spec.randomization.world == WorldRandomizationSpec{})
    json["randomization"].erase("world");
  else if (spec.randomization.world.distractor_balls == 0)
    json["randomization"]["world"].erase("distractor_balls");
  EraseUnset(json["rollout"]);
  json["content"] = kContentVersion;
  if (spec.mode == "rollout") json["rollout"]["version"] = kRolloutVersion;
  // what the tasks' files say, not only what they are called
  OrderedJson& tasks = json["task_files"] = OrderedJson::array();
  for (const auto& name : spec.tasks) {
    const auto task = ParseTask(name);
    tasks.push_back(task ? task->spec->sha256 : "unknown");
  }
  return Sha256Hex(json.dump());
}

SceneSpec::SceneSpec(const CampaignSpec& spec)
    : robot(spec.robots.at(0)),
      objects(spec.objects),
      camera(spec.camera),
      world(spec.world),
      tables(spec.randomization.world.tables),
      backdrop(spec.randomization.world.background > 0) {}

namespace {

constexpr double kLongestSplitBlock = 10'000;

std::string SplitAt(const SplitSpec& split, double place) {
  if (place < split.train) return "train";
  return place < split.train + split.valid ? "valid" : "test";
}

// A whole number that std::gcd can take.
bool IsCount(double weight) { return weight >= 0 && weight <= 1e15 && weight == std::floor(weight); }

}  // namespace

std::uint64_t SplitBlock(const SplitSpec& split) {
  if (!IsCount(split.train) || !IsCount(split.valid) || !IsCount(split.test)) return 0;
  const auto train = static_cast<std::uint64_t>(split.train), valid = static_cast<std::uint64_t>(split.valid),
             test = static_cast<std::uint64_t>(split.test);
  const std::uint64_t divisor = std::gcd(std::gcd(train, valid), test);
  ETUDE_CHECK(divisor > 0, "all of the split is 0");
  const std::uint64_t block = (train + valid + test) / divisor;
  return static_cast<double>(block) <= kLongestSplitBlock ? block : 0;
}

std::string SplitOf(const CampaignSpec& spec, std::uint64_t index) {
  const double total = spec.split.train + spec.split.valid + spec.split.test;
  const std::uint64_t block = SplitBlock(spec.split);
  if (block == 0) return SplitAt(spec.split, Rng(MixSeed({spec.seed, index}, "split")).Uniform() * total);
  std::vector<std::uint64_t> order(block);
  std::iota(order.begin(), order.end(), std::uint64_t{0});
  Rng rng(MixSeed({spec.seed, index / block}, "split block"));
  rng.Shuffle(order);
  // the middle of the place's share, so that rounding cannot move it over a boundary
  const double place = static_cast<double>(order[index % block]) + 0.5;
  return SplitAt(spec.split, place * (total / static_cast<double>(block)));
}

}  // namespace etude
