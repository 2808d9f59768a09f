// SPDX-License-Identifier: Apache-2.0
// The one sentence of state: on the Overview and in `etude top`.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "services/bus/messages.h"

namespace etude::monitor {

struct CollectionFacts {
  std::string name;
  std::string state;  ///< finished | running | paused | draining | stopping | silent | failed
  std::uint64_t committed = 0, total = 0, given_up = 0;
  std::optional<double> eta_s;
};
struct TrainingFacts {
  std::string state;  ///< finished | running | silent | stopped | failed
  std::string stage_name;
  std::uint64_t stage = 0, stages = 0, step = 0;
  std::optional<double> eta_s, elapsed_s;
};
struct PolicyFacts {
  std::optional<std::uint64_t> step;  ///< of the checkpoint that is served
  std::uint64_t servers = 0;
  std::optional<std::uint64_t> sessions;  ///< that ask; not said by a server that does not publish its status
  bool may_drive = true;
};
struct EvaluationFacts {
  std::string state;
  double share = 0;  ///< of successes, 0..1
  std::uint64_t done = 0, episodes = 0;
};

CollectionFacts FactsOf(const std::string& name, const bus::CampaignStatus& status);
TrainingFacts FactsOf(const bus::TrainStatus& status);
PolicyFacts FactsOf(const bus::PolicyStatus& status);

/// "collecting 412 of 600, done in 3:05", "paused at 412 of 600", "collected 600, gave up 2"
std::string Text(const CollectionFacts& facts);
/// "training stage 5/5 CTRL, step 6,589"
std::string Text(const TrainingFacts& facts);
/// "step 6,500 serves 1 session"
std::string Text(const PolicyFacts& facts);
/// "98.8 % success of 400"
std::string Text(const EvaluationFacts& facts);

/// What is there; parts that are missing are not spoken of.
struct Facts {
  std::optional<CollectionFacts> collection;
  std::optional<TrainingFacts> training;
  std::optional<PolicyFacts> policy;
  std::optional<EvaluationFacts> evaluation;
  std::string looked_in;  ///< for when there is nothing: "out/quickstart and domain 0"
};

/// "quickstart: collecting 412 of 600, done in 3:05; training stage 5/5 CTRL, step 6,589; step 6,500 serves 1 session"
std::string Sentence(const Facts& facts);
/// "6,589"
std::string Grouped(std::uint64_t number);

}  // namespace etude::monitor
