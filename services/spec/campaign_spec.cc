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
#include "services/spec/object_names.h"
#include "services/spec/robot_names.h"
#include "services/spec/task_name.h"
#include "services/spec/task_roles.h"

namespace etude {
namespace {

constexpr int kMostObjects = 6;
const std::vector<std::string> kModes{"demonstrate", "rollout"};
const std::vector<std::string> kScenes{"feasible", "first_draw"};

void CheckKnown(const char* key, const std::string& value, const std::vector<std::string>& known,
                std::vector<std::string>& errors) {
  if (std::find(known.begin(), known.end(), value) != known.end()) return;
  errors.push_back(fmt::format("{}: {}", key, NotKnown(value, known)));
}

// Whether some object can be the target, and with a reference another one that.
void CheckRoles(const TaskName& task, const std::vector<std::string>& objects, int on_table,
                std::vector<std::string>& errors) {
  if (!task.relation()) return;
  const auto& only = task.spec->reference.only;
  if (on_table < 2)
    errors.push_back(fmt::format("objects: task '{}' needs a second one to refer to", task.base));
  else if (PossibleTargets(*task.spec, objects).empty())
    errors.push_back(fmt::format("objects: task '{}' needs one of {} to refer to, and another one to move", task.base,
                                 fmt::join(only, ", ")));
}

}  // namespace

Status CampaignSpec::Validate() const {
  std::vector<std::string> errors;
  const auto require = [&](bool good, const std::string& message) {
    if (!good) errors.push_back(message);
  };
  require(IsPlainName(name), fmt::format("name: '{}' must match [a-z0-9_-]{{1,64}}", name));
  CheckKnown("mode", mode, kModes, errors);
  CheckKnown("scenes", scenes, kScenes, errors);
  require(!robots.empty(), "robots: at least one");
  for (const auto& robot : robots)
    if (const auto found = FindRobot(robot); !found) errors.push_back("robots: " + found.error().message);
  const int on_table = objects_per_scene == 0 ? static_cast<int>(objects.size()) : objects_per_scene;
  require(!tasks.empty(), "tasks: at least one");
  for (const auto& name : tasks) {
    const auto task = ParseTask(name);
    if (!task) errors.push_back("tasks: " + task.error().message);
    if (task) CheckRoles(*task, objects, on_table, errors);
  }
  require(task_weights.empty() || task_weights.size() == tasks.size(),
          fmt::format("task_weights: {} for {} tasks", task_weights.size(), tasks.size()));
  for (double weight : task_weights)
    require(std::isfinite(weight) && weight > 0, fmt::format("task_weights: {} must be > 0", weight));
  require(on_table >= 1 && on_table <= kMostObjects,
          fmt::format("objects: {} on the table, between 1 and {} fit{}", on_table, kMostObjects,
                      objects_per_scene == 0 ? "; set objects_per_scene to draw some of them" : ""));
  require(objects_per_scene <= static_cast<int>(objects.size()),
          fmt::format("objects_per_scene: {} of {} objects", objects_per_scene, objects.size()));
  // a sentence names a class, so that no two of one class stand on the table together
  std::set<std::string> nouns;
  for (const auto& object : objects) nouns.insert(ObjectNoun(object));
  require(on_table <= static_cast<int>(nouns.size()),
          fmt::format("objects: {} on the table of {} classes; one of each at most", on_table, nouns.size()));
  for (const auto& object : objects)
    if (const Status known = CheckObjectName(object); !known) errors.push_back(known.error().message);
  std::set<std::string> scene_names;
  for (const auto& object : objects) scene_names.insert(SceneName(object));
  require(scene_names.size() == objects.size(), "objects: each name at most once");
  require(episodes >= 1 && episodes <= 10'000'000, fmt::format("episodes: {} not in 1..10^7", episodes));
  require(image_stride >= 1 && image_stride <= 125, fmt::format("image_stride: {} not in 1..125", image_stride));
  require(max_attempts >= 1 && max_attempts <= 1000, fmt::format("max_attempts: {} not in 1..1000", max_attempts));
  const auto pixels_ok = [](int n) { return n >= 16 && n <= 2048; };
  require(pixels_ok(camera.width) && pixels_ok(camera.height),
          fmt::format("camera: {}x{} not in 16..2048", camera.width, camera.height));
  require(camera.fovy_deg > 1 && camera.fovy_deg < 170, "camera.fovy_deg: not in 1..170");
  require(camera.position.size() == 3, "camera.position: three numbers");
  require(camera.euler.size() == 3, "camera.euler: three numbers");
  const auto in_range = [&](const char* key, double value, double high) {
    require(value >= 0 && value <= high, fmt::format("randomization.{}: {} not in 0..{}", key, value, high));
  };
  in_range("yaw", randomization.yaw, 3.2);
  in_range("start_position", randomization.start_position, 0.3);
  in_range("start_orientation", randomization.start_orientation, 0.8);
  in_range("disturbance", randomization.disturbance, 0.2);
  in_range("disturbance_probability", randomization.disturbance_probability, 1);
  in_range("light", randomization.light, 1);
  world.Check(errors);
  require(obstacle.in_the_way >= 0 && obstacle.in_the_way <= 1,
          fmt::format("obstacle.in_the_way: {} not in 0..1", obstacle.in_the_way));
  if (mode == "rollout") {
    require(IsPlainName(rollout.run), fmt::format("rollout.run: '{}' must be a run's name", rollout.run));
    require(rollout.replan_steps >= 1 && rollout.replan_steps <= 120,
            fmt::format("rollout.replan_steps: {} not in 1..120", rollout.replan_steps));
    require(rollout.max_steps >= 1 && rollout.max_steps <= 100'000,
            fmt::format("rollout.max_steps: {} not in 1..100000", rollout.max_steps));
    require(rollout.latency_ms == -1 || (rollout.latency_ms >= 0 && rollout.latency_ms <= 960),
            fmt::format("rollout.latency_ms: {} not in 0..960, nor -1 (what the server measured)", rollout.latency_ms));
  }
  require(split.train >= 0 && split.valid >= 0 && split.test >= 0 && split.train + split.valid + split.test > 0,
          "split: fractions must be >= 0 and not all 0");
  if (errors.empty()) return {};
  return Fail(Code::kInvalidArgument, fmt::format("campaign '{}': {}", name, fmt::join(errors, "; ")));
}

std::string SpecHash(const CampaignSpec& spec) {
  OrderedJson json = ToJson(spec);
  for (const char* key : {"name", "episodes", "split", "max_attempts"}) json.erase(key);
  json["content"] = kContentVersion;
  // what the tasks' files say, not only what they are called
  OrderedJson& tasks = json["task_files"] = OrderedJson::array();
  for (const auto& name : spec.tasks) {
    const auto task = ParseTask(name);
    tasks.push_back(task ? task->spec->sha256 : "unknown");
  }
  return Sha256Hex(json.dump());
}

SceneSpec::SceneSpec(const CampaignSpec& spec)
    : robot(spec.robots.at(0)), objects(spec.objects), camera(spec.camera), world(spec.world) {}

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
