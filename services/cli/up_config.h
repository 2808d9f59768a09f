// SPDX-License-Identifier: Apache-2.0
// What `etude up` runs: a file such as deploy/up/quickstart.yaml.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "services/core/config.h"

namespace etude::cli {

struct UpTrainConfig {
  std::string config = "compact";
  std::string run = "quickstart";
  double minutes = 12;
  std::uint64_t start_episodes = 40;
  std::vector<std::string> set;

  void Visit(auto& v) {
    v("config", config, "", "experiment: its name, or a file");
    v("run", run, "", "name of the run, also on the bus");
    v("minutes", minutes, "min", "how long training lasts");
    v("start_episodes", start_episodes, "-", "training starts when so many episodes have arrived");
    v("set", set, "", "KEY=VALUE over the experiment's");
  }
};

struct UpEvalConfig {
  std::uint64_t episodes = 20;
  std::uint64_t seed = 1;
  std::vector<std::string> tasks;
  int videos = 8;

  void Visit(auto& v) {
    v("episodes", episodes, "-", "rollouts of the evaluation");
    v("seed", seed, "-", "of the evaluation's scenes");
    v("tasks", tasks, "", "tasks to evaluate; none: those that are collected");
    v("videos", videos, "-", "rollouts shown as videos, failures first");
  }
};

struct UpConfig {
  std::string campaign;
  std::vector<std::string> campaign_set;
  int workers = 0;
  std::uint32_t domain = 0;
  std::string out = "out/up";
  UpTrainConfig train;
  UpEvalConfig eval;

  void Visit(auto& v) {
    v("campaign", campaign, "", "campaign file, relative to this file");
    v("campaign_set", campaign_set, "", "KEY=VALUE over the campaign file's");
    v("workers", workers, "-", "worker processes; 0: one a core");
    v("domain", domain, "-", "DDS domain of all that is started");
    v("out", out, "", "folder for dataset/, run/, eval/ and logs/");
    v("train", train, "", "the training");
    v("eval", eval, "", "the rollouts at its end");
  }
};

}  // namespace etude::cli
