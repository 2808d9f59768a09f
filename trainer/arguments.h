// SPDX-License-Identifier: Apache-2.0
// What etude-trainer is told on its command line, and what that means for a run.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <string>
#include <vector>

#include "services/bus/arguments.h"
#include "services/core/identity.h"
#include "trainer/learn/config.h"
#include "trainer/learn/ranks.h"

namespace etude {

/// As the options say it; their help is in arguments.cc.
struct Arguments {
  std::vector<std::string> data;
  std::string collect, config, out, name;
  std::string init;
  std::vector<std::string> set, add, copy, fresh, freeze, like;
  double minutes = 0;
  std::uint64_t steps = 0;
  std::uint64_t seed = 0;
  int ranks = 1, rank = -1;
  std::string meet, device = "cpu", sign;
  std::vector<std::string> words;  ///< of the command line, for other ranks
  bool has_seed = false, resume = false, follow = false, offline = false, check = false;
  Claim claim = Claim::kRefuse;
  bus::Arguments bus;

  /// The dataset grows while it trains.
  bool follows() const { return follow || !collect.empty(); }
};

void AddOptions(CLI::App& app, Arguments& arguments);

/// Fills in what the options leave open, once they are parsed: where the dataset is, the words for other ranks.
/// @error kInvalidArgument: a run lacks something, or two options contradict each other
Status Complete(const CLI::App& app, int argc, const char* const* argv, Arguments& arguments);

/// The experiment with everything that the options change; of a run that resumes, its own.
/// @error of learn::LoadTrainConfig and of the checkpoint that --init names
Result<learn::TrainConfig> ReadConfig(const Arguments& arguments);

/// @error kInvalidArgument: no plain name
Result<std::string> RunName(const Arguments& arguments);

/// @error kInvalidArgument: --meet is missing or no HOST:PORT
Result<learn::RanksOptions> ReadRanks(const Arguments& arguments);
/// How many copies of the network one rank trains. Ranks of one host share its cores; on hosts of their own each has
/// them all.
int ReplicasOfRank(const Arguments& arguments);

}  // namespace etude
