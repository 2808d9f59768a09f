// SPDX-License-Identifier: Apache-2.0
// etude-trainer on synthetic episodes, small enough that a run takes seconds, and what it leaves.
#pragma once

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <map>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "services/campaign/process.h"
#include "services/core/config.h"
#include "services/core/file.h"
#include "services/store/safetensors.h"
#include "tests/faults/campaign_run.h"
#include "tests/support/etude_command.h"
#include "tests/trainer/learn/tiny_config.h"

namespace etude::faults {

inline constexpr int kInterval = 10;  ///< steps between two checkpoints
inline constexpr int kSteps = 40;     ///< of a run

struct TrainerRun {
  Path data, out, log;
  bool resume = false;
  int keep = 4;  ///< checkpoints
  Environment environment = {};
  std::vector<std::string> flags = {};  ///< behind the others
};

inline campaign::Process StartTrainer(const TrainerRun& run) {
  campaign::ProcessOptions options{.argv = {}, .log = run.log, .environment = run.environment};
  options.argv = {(ProgramsFolder() / "etude-trainer").string(),
                  "--data",
                  run.data.string(),
                  "--out",
                  run.out.string(),
                  "--name",
                  "faults",
                  "--offline"};
  if (run.resume) {
    options.argv.push_back("--resume");
  } else {
    auto overrides = learn::TinyOverrides();
    overrides.insert(overrides.end(), {fmt::format("steps={}", kSteps), "curriculum.latest_last=0.5",
                                       fmt::format("checkpoint.keep={}", run.keep), "ema=0.9"});
    for (const auto& change : overrides) options.argv.insert(options.argv.end(), {"--set", change});
  }
  options.argv.insert(options.argv.end(), run.flags.begin(), run.flags.end());
  auto process = campaign::Process::Start(options);
  EXPECT_TRUE(process) << process.error().message;
  return std::move(*process);
}

/// What validation measured, by step; of two lines of a step the later one. Times are left out.
inline std::map<int, std::string> Validations(const Path& run) {
  std::map<int, std::string> lines;
  std::istringstream text(ReadTextFile(run / "metrics.jsonl").value_or(""));
  for (std::string line; std::getline(text, line);) {
    auto json = OrderedJson::parse(line, nullptr, false);
    if (!json.is_object() || json.value("kind", "") != "valid") continue;
    json.erase("time");
    json.erase("elapsed_s");
    lines[json["step"].get<int>()] = json.dump();
  }
  return lines;
}

inline int LastValidation(const Path& run) {
  const auto lines = Validations(run);
  return lines.empty() ? 0 : lines.rbegin()->first;
}

/// Of the state that --resume goes on from; 0: there is none.
inline int StepOfState(const Path& run) {
  const auto state = store::ReadSafetensors(run / "training_state.safetensors");
  if (!state) return 0;
  return OrderedJson::parse(state->metadata.at("run"))["step"].get<int>();
}

inline bool IsWhole(const Path& checkpoint) { return store::ReadSafetensors(checkpoint).has_value(); }

}  // namespace etude::faults
