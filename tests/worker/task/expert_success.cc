// SPDX-License-Identifier: Apache-2.0
// Success of the expert over seeded scenes, per task: expert_success [scenes per task] [seed] [task...]
// Environment: ETUDE_ROBOT (ur5), ETUDE_OBJECTS (a comma-separated list), ETUDE_STRIDE (125), ETUDE_FIRST (index, 0).
// Prints one line per failed attempt, then per task success, steps and where the time went.
#include <fmt/format.h>

#include <cstdlib>
#include <map>
#include <numeric>
#include <sstream>
#include <string>
#include <vector>

#include "services/core/statistics.h"
#include "tests/worker/task/largest_turn.h"
#include "worker/task/attempt.h"

namespace {

using namespace etude;

struct Tally {
  std::uint64_t trials = 0, successes = 0, disturbed = 0, pushes = 0;
  std::vector<double> steps;
  double turn = 0;  // largest change of the 6D rotation in a control step, commanded or achieved
  std::map<std::string, int> planned, blocked;
  std::map<std::string, std::uint64_t> stage_steps;
  double plan_s = 0, step_s = 0, render_s = 0, deflate_s = 0;
};

std::vector<std::string> Split(const std::string& list) {
  std::vector<std::string> items;
  std::istringstream stream(list);
  for (std::string item; std::getline(stream, item, ',');) items.push_back(item);
  return items;
}

void Count(const task::AttemptResult& result, Tally& tally) {
  ++tally.trials;
  tally.plan_s += result.plan_s;
  tally.step_s += result.step_s;
  tally.render_s += result.render_s;
  tally.deflate_s += result.deflate_s;
  if (result.outcome != task::AttemptOutcome::kSuccess) return;
  ++tally.successes;
  const Episode& episode = result.episode;
  tally.steps.push_back(episode.steps());
  tally.turn = std::max(tally.turn, task::LargestTurn(episode));
  for (auto phase : episode.phase) ++tally.stage_steps[episode.stage_names[phase]];
  tally.disturbed += !episode.details["disturbed_objects"].empty();
  tally.pushes += episode.details["pushes"].get<std::uint64_t>();
  for (const auto& stage : episode.details["planned"]) {
    const std::string blocked = stage["blocked"].get<std::string>();
    if (!blocked.empty()) ++tally.blocked[blocked];
    ++tally.planned[stage["stage"].get<std::string>() + "/" + stage["way"].get<std::string>()];
  }
}

void Print(const std::string& name, const Tally& tally) {
  if (tally.trials == 0) return;
  const Interval interval = WilsonInterval(tally.successes, tally.trials);
  const double n = static_cast<double>(tally.trials);
  fmt::print(
      "{}: {}/{} = {:.1f} % [{:.1f}, {:.1f}], steps mean {:.0f} min {:.0f} max {:.0f}, "
      "{} with others moved, {} pushes, 6D rotation at most {:.4f} a step\n",
      name, tally.successes, tally.trials, 100 * tally.successes / n, 100 * interval.low, 100 * interval.high,
      Mean(tally.steps), Quantile(tally.steps, 0), Quantile(tally.steps, 1), tally.disturbed, tally.pushes, tally.turn);
  fmt::print("  ms an episode: plan {:.1f} step {:.1f} render {:.1f} deflate {:.1f}\n", 1e3 * tally.plan_s / n,
             1e3 * tally.step_s / n, 1e3 * tally.render_s / n, 1e3 * tally.deflate_s / n);
  for (const auto& [stage, steps] : tally.stage_steps)
    fmt::print("  {} {:.0f} steps", stage, static_cast<double>(steps) / tally.successes);
  fmt::print("\n");
  for (const auto& [kind, count] : tally.planned) fmt::print("  {} {}\n", kind, count);
  for (const auto& [why, count] : tally.blocked) fmt::print("  blocked {}: {}\n", count, why);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && argv[1][0] == '-') {
    fmt::print(
        "expert_success [SCENES] [SEED] [TASK...]: success of the expert over seeded scenes\n"
        "environment: ETUDE_ROBOT (ur5), ETUDE_OBJECTS (a comma-separated list), ETUDE_STRIDE (125), ETUDE_FIRST\n");
    return 0;
  }
  const int scenes = argc > 1 ? std::atoi(argv[1]) : 300;
  const std::uint64_t seed = argc > 2 ? std::strtoull(argv[2], nullptr, 10) : 1;
  std::vector<std::string> tasks(argv + std::min(argc, 3), argv + argc);
  if (tasks.empty()) tasks = {"pick", "push", "put_down"};
  const char* stride = std::getenv("ETUDE_STRIDE");
  const char* robot = std::getenv("ETUDE_ROBOT");
  const char* objects = std::getenv("ETUDE_OBJECTS");
  const char* from = std::getenv("ETUDE_FIRST");
  const int first = from ? std::atoi(from) : 0;
  bool good = true;
  for (const auto& name : tasks) {
    CampaignSpec spec;
    spec.tasks = {name};
    spec.seed = seed;
    if (robot) spec.robots = {robot};
    if (objects) spec.objects = Split(objects);
    spec.objects_per_scene = std::min<int>(6, static_cast<int>(spec.objects.size()));
    spec.image_stride = stride ? std::atoi(stride) : 125;
    auto runner = task::AttemptRunner::Open(spec);
    if (!runner) {
      fmt::print(stderr, "expert_success: {}\n", runner.error().message);
      return 3;
    }
    Tally tally;
    for (int index = first; index < first + scenes; ++index) {
      const auto result = runner->Demonstrate(index, 0).value();
      Count(result, tally);
      if (result.outcome != task::AttemptOutcome::kSuccess)
        fmt::print("{} {}: {}: {}\n", name, index, task::ToString(result.outcome), result.reason);
    }
    Print(name, tally);
    good = good && tally.successes >= 0.97 * tally.trials && tally.turn <= 0.05;
  }
  return good ? 0 : 1;
}
