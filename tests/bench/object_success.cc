// SPDX-License-Identifier: Apache-2.0
// Success of the expert on generated objects, by class: object_success [rounds] [seed] [robot]
// Each round has six objects of different classes, the round's instance of each, and twelve scenes for each base task.
#include <fmt/format.h>

#include <cstdlib>
#include <map>
#include <string>
#include <vector>

#include "services/core/rng.h"
#include "services/spec/episode_plan.h"
#include "services/spec/object_names.h"
#include "worker/task/attempt.h"

namespace {

using namespace etude;

struct Tally {
  int trials = 0, successes = 0;
};

/// Six objects of different classes, instance `instance` of each.
std::vector<std::string> SceneObjects(int instance, Rng& rng) {
  std::vector<std::string> classes = GeneratedClasses();
  rng.Shuffle(classes);
  classes.resize(6);
  std::vector<std::string> names;
  for (const std::string& name : classes) names.push_back(GeneratedObject(name, instance));
  return names;
}

}  // namespace

int main(int argc, char** argv) {
  const int rounds = argc > 1 ? std::atoi(argv[1]) : 10;
  const std::uint64_t seed = argc > 2 ? std::strtoull(argv[2], nullptr, 10) : 1;
  std::map<std::string, std::map<std::string, Tally>> of_class;
  double plan_s = 0, step_s = 0, render_s = 0, attempts = 0;
  Rng rng(seed);
  for (int round = 0; round < rounds; ++round)
    for (const char* name : {"pick", "push", "put_down"}) {
      CampaignSpec spec;
      if (argc > 3) spec.robots = {argv[3]};
      spec.tasks = {name};
      spec.seed = MixSeed({seed, static_cast<std::uint64_t>(round)}, name);
      spec.image_stride = 125;
      spec.objects = SceneObjects(round % kInstancesPerClass, rng);
      auto runner = task::AttemptRunner::Open(spec);
      if (!runner) {
        fmt::print(stderr, "object_success: {}\n", runner.error().message);
        return 3;
      }
      for (int index = 0; index < 12; ++index) {
        const auto result = runner->Demonstrate(index, 0).value();
        const std::string target = PlanEpisode(spec, index, 0).target;
        Tally& tally = of_class[ObjectNoun(target)][name];
        ++tally.trials;
        ++attempts;
        plan_s += result.plan_s;
        step_s += result.step_s;
        render_s += result.render_s;
        tally.successes += result.outcome == task::AttemptOutcome::kSuccess;
        if (result.outcome != task::AttemptOutcome::kSuccess)
          fmt::print("{} {} {}: {}: {}\n", name, target, index, task::ToString(result.outcome), result.reason);
      }
    }
  for (const auto& [name, tasks] : of_class) {
    fmt::print("{:<12}", name);
    for (const auto& [task, tally] : tasks) fmt::print("  {} {}/{}", task, tally.successes, tally.trials);
    fmt::print("\n");
  }
  fmt::print("ms an attempt: plan {:.0f} step {:.0f} render {:.0f}\n", 1e3 * plan_s / attempts, 1e3 * step_s / attempts,
             1e3 * render_s / attempts);
  return 0;
}
