// SPDX-License-Identifier: Apache-2.0
#include "trainer/arguments.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <set>
#include <utility>

#include "services/core/config.h"
#include "services/core/cores.h"
#include "services/core/run_name.h"
#include "trainer/checkpoint/checkpoint.h"
#include "trainer/policy/policy_file.h"

namespace etude {
namespace {

// what the options say, as overrides; first, since those that follow may be about the graph that they choose
std::vector<std::string> Overrides(const Arguments& arguments) {
  std::vector<std::string> overrides;
  if (!arguments.init.empty()) {
    overrides.push_back("init.from=" + JsonText(arguments.init));
    if (arguments.config.empty()) overrides.push_back("policy=checkpoint");
  }
  for (const auto& [key, names] : {std::pair{"add", &arguments.add},
                                   {"init.copy", &arguments.copy},
                                   {"init.fresh", &arguments.fresh},
                                   {"init.freeze", &arguments.freeze},
                                   {"init.like", &arguments.like}})
    if (!names->empty()) overrides.push_back(fmt::format("{}={}", key, JsonText(*names)));
  overrides.insert(overrides.end(), arguments.set.begin(), arguments.set.end());
  return overrides;
}

Result<OrderedJson> ReadGraph(const std::string& file) {
  ETUDE_ASSIGN_OR_RETURN(const auto source, checkpoint::ReadFile(file));
  return checkpoint::GraphOf(source.metadata);
}

}  // namespace

void AddOptions(CLI::App& app, Arguments& arguments) {
  app.add_option("--data", arguments.data,
                 "the dataset's folder (with --collect by default OUT/dataset); several are read as one");
  app.add_option("--collect", arguments.collect,
                 "campaign file: host its collector here; workers anywhere stream into --data "
                 "while training runs");
  app.add_option("--config", arguments.config,
                 "experiment: compact, paper, faithful, or a YAML file (default compact; with --resume the run's own)");
  app.add_option("--set", arguments.set, "override, e.g. --set optimizer.lr=1e-3; may be repeated")
      ->allow_extra_args(false);
  app.add_option("--init", arguments.init,
                 "begin with this checkpoint (of a run's folder: its newest), and with its graph unless --config names "
                 "another")
      ->transform(CheckpointFile);
  const auto parts = [&](const char* option, std::vector<std::string>& names, const char* what) {
    app.add_option(option, names, what)->delimiter(',')->allow_extra_args(false);
  };
  parts("--add", arguments.add, "put modules on top of the graph: obstacle, multi_obstacle, relational, or a file");
  parts("--copy", arguments.copy, "parts to take from --init, e.g. image,language,LANG (default: all that both have)");
  parts("--fresh", arguments.fresh, "parts that begin anew all the same");
  parts("--freeze", arguments.freeze, "parts that stay as they are, bit for bit");
  parts("--like", arguments.like, "new parts that begin with another one's weights, e.g. OBST2D=TAR2D");
  app.add_option("--out", arguments.out, "the run's folder: config, metrics, checkpoints, state");
  app.add_option("--name", arguments.name,
                 "the run's name on the bus (default: what its folder keeps, at first from the folder's name)");
  app.add_option("--minutes", arguments.minutes, "stop after this much training; the learning rate follows");
  app.add_option("--steps", arguments.steps, "stop after this many steps; with --minutes whichever comes first");
  app.add_option("--ranks", arguments.ranks, "processes that train together, each on its part of every batch")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  app.add_option("--rank", arguments.rank, "which of them this is (default: rank 0, and the others are started here)")
      ->check(CLI::Range(0, 1023));
  app.add_option("--meet", arguments.meet, "HOST:PORT where rank 0 listens, with --rank");
  app.add_option("--device", arguments.device, "where the network is trained: cpu, cuda or cuda:NUMBER")
      ->capture_default_str();
  app.add_flag("--resume", arguments.resume, "go on where the run in --out stopped");
  app.add_flag("--follow", arguments.follow,
               "the dataset is still growing: wait for its first episodes, take in new ones");
  app.add_option("--sign", arguments.sign,
                 "sign published checkpoints with this key (etude security signing-key FILE)");
  app.add_flag("--offline", arguments.offline, "do not publish on the bus");
  app.add_flag("--check", arguments.check,
               "only say what is wrong with the options, the experiment and what the run begins with; --data need not "
               "be there yet");
  bus::AddClaim(app, arguments.claim);
  arguments.bus.Add(app);
  app.add_option("--seed", arguments.seed, "of weights and sample order (default: the experiment's)");
}

Status Complete(const CLI::App& app, int argc, const char* const* argv, Arguments& arguments) {
  arguments.words.assign(argv + 1, argv + argc);
  arguments.has_seed = app.count("--seed") > 0;
  if (arguments.data.empty() && !arguments.collect.empty() && !arguments.out.empty())
    arguments.data = {(Path(arguments.out) / "dataset").string()};
  if (arguments.data.empty() || arguments.out.empty())
    return Fail(Code::kInvalidArgument, "give --data DATASET or --collect SPEC, and --out RUN (see --help)");
  for (const std::string& word : arguments.words)
    if (!IsUtf8(word))
      return Fail(Code::kInvalidArgument, fmt::format("'{}': not UTF-8, which config.yaml has to be", word));
  std::set<Path> folders;
  for (const std::string& folder : arguments.data) {
    std::error_code error;
    if (!folders.insert(std::filesystem::weakly_canonical(folder, error)).second)
      return Fail(Code::kInvalidArgument,
                  fmt::format("--data names '{}' twice: its episodes would count double", folder));
  }
  if (arguments.data.size() > 1 && !arguments.collect.empty())
    return Fail(Code::kInvalidArgument,
                "--collect collects into one folder, --data names several: start `etude collector` by itself, and "
                "train on all of them with --follow");
  return {};
}

Result<learn::TrainConfig> ReadConfig(const Arguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const Path experiments, policy::FindExperiments());
  // a run that resumes is what it was, unless told otherwise
  const Path saved = Path(arguments.out) / "config.yaml";
  std::string source = arguments.config.empty() ? "compact" : arguments.config;
  if (arguments.resume && arguments.config.empty()) source = saved.string();
  ETUDE_ASSIGN_OR_RETURN(auto config, learn::LoadTrainConfig(source, experiments, Overrides(arguments), ReadGraph));
  if (arguments.minutes != 0 || arguments.steps > 0) {  // what is no time at all is refused with the rest
    config.minutes = arguments.minutes;
    config.steps = arguments.steps;
  }
  if (arguments.has_seed) config.seed = arguments.seed;
  return config;
}

Result<std::string> RunName(const Arguments& arguments) {
  const std::string run = arguments.name.empty() ? RunNameOf(arguments.out) : arguments.name;
  if (IsPlainName(run)) return run;
  return Fail(Code::kInvalidArgument, fmt::format("--name '{}': must match [a-z0-9_-]{{1,64}}", run));
}

Result<learn::RanksOptions> ReadRanks(const Arguments& arguments) {
  learn::RanksOptions options{.size = arguments.ranks, .rank = std::max(0, arguments.rank)};
  if (arguments.meet.empty() != (arguments.rank < 0))
    return Fail(Code::kInvalidArgument, arguments.meet.empty()
                                            ? "--rank: needs --meet HOST:PORT, where rank 0 is met"
                                            : "--meet: needs --rank I; without it all ranks are started here");
  if (arguments.meet.empty()) return options;
  const auto colon = arguments.meet.rfind(':');
  const int port = colon == std::string::npos ? 0 : std::atoi(arguments.meet.c_str() + colon + 1);
  if (port < 1 || port > 65535)
    return Fail(Code::kInvalidArgument, fmt::format("--meet '{}': must be HOST:PORT", arguments.meet));
  options.host = arguments.meet.substr(0, colon);
  options.port = static_cast<std::uint16_t>(port);
  return options;
}

int ReplicasOfRank(const Arguments& arguments) {
  constexpr int kMost = 256;  // that a configuration may say
  const int cores = std::min(Cores(), kMost);
  const std::string host = arguments.meet.substr(0, arguments.meet.rfind(':'));
  const bool here = arguments.rank < 0 || host == learn::RanksOptions().host || host == "localhost";
  return here ? std::max(1, cores / arguments.ranks) : cores;
}

}  // namespace etude
