// SPDX-License-Identifier: Apache-2.0
// What `etude up` runs: a file such as deploy/up/quickstart.yaml.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "services/core/config.h"

namespace etude::cli {

struct UpTrainConfig {
  std::string config = "compact";  ///< experiment, by name or file
  std::string run = "quickstart";  ///< name of the run, also on the bus
  double minutes = 12;
  std::uint64_t start_episodes = 40;  ///< training starts when so many have arrived
  std::vector<std::string> set;       ///< KEY=VALUE over the experiment's

  template <class V>
  void Visit(V& v) {
    v("config", config);
    v("run", run);
    v("minutes", minutes);
    v("start_episodes", start_episodes);
    v("set", set);
  }
};

struct UpEvalConfig {
  std::uint64_t episodes = 20;
  std::uint64_t seed = 1;
  std::vector<std::string> tasks;  ///< empty: those that are collected
  int videos = 8;

  template <class V>
  void Visit(V& v) {
    v("episodes", episodes);
    v("seed", seed);
    v("tasks", tasks);
    v("videos", videos);
  }
};

struct UpConfig {
  std::string campaign;                   ///< campaign file, relative to this file
  std::vector<std::string> campaign_set;  ///< KEY=VALUE over the campaign file's
  int workers = 0;                        ///< 0: one a core
  std::uint32_t domain = 0;
  std::string out = "out/up";  ///< dataset/, run/, eval/ and logs/ go there
  UpTrainConfig train;
  UpEvalConfig eval;

  template <class V>
  void Visit(V& v) {
    v("campaign", campaign);
    v("campaign_set", campaign_set);
    v("workers", workers);
    v("domain", domain);
    v("out", out);
    v("train", train);
    v("eval", eval);
  }
};

}  // namespace etude::cli
