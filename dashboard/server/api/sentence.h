// SPDX-License-Identifier: Apache-2.0
// The one sentence of state: on the Overview, in /readyz, in a terminal.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

namespace etude::api {

struct CollectionFacts {
  std::string name, state;
  std::uint64_t committed = 0, total = 0, given_up = 0;
  std::optional<double> eta_s;
};
struct TrainingFacts {
  std::string state, stage_name;
  std::uint64_t stage = 0, stages = 0, step = 0;
  std::optional<double> eta_s, elapsed_s;
};
struct PolicyFacts {
  std::optional<std::uint64_t> step;  ///< of the checkpoint that is served
  std::uint64_t servers = 0;
};
struct EvaluationFacts {
  std::string state;
  double share = 0;  ///< of successes, 0..1
  std::uint64_t done = 0, episodes = 0;
};

/// What is there; parts that are missing are not spoken of.
struct Facts {
  std::optional<CollectionFacts> collection;
  std::optional<TrainingFacts> training;
  std::optional<PolicyFacts> policy;
  std::optional<EvaluationFacts> evaluation;
  std::string looked_in;  ///< for when there is nothing: "out/quickstart and domain 0"
};

/// "quickstart: collecting 412 of 600, done in 3:05; training stage 5/5 CTRL, step 6,589; step 6,500 serves"
std::string Sentence(const Facts& facts);
/// "6,589"
std::string Grouped(std::uint64_t number);

}  // namespace etude::api
