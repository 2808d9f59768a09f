// SPDX-License-Identifier: Apache-2.0
// etude-trainer on synthetic episodes, small enough that a run takes seconds.
#pragma once

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <string>
#include <utility>

#include "services/campaign/process.h"
#include "services/core/file.h"
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
  auto process = campaign::Process::Start(options);
  EXPECT_TRUE(process) << process.error().message;
  return std::move(*process);
}

}  // namespace etude::faults
