// SPDX-License-Identifier: Apache-2.0
// etude-trainer: trains a policy on a dataset, also while it is collected, and publishes
// checkpoints.
#include <CLI/CLI.hpp>
#include <atomic>
#include <cstdlib>
#include <filesystem>
#include <thread>

#include "services/bus/arguments.h"
#include "services/bus/topic.h"
#include "services/campaign/collector.h"
#include "services/core/command.h"
#include "services/core/log.h"
#include "services/core/stop.h"
#include "trainer/learn/trainer.h"
#include "trainer/policy/torch_process.h"
#include "trainer/publish/sink.h"

namespace etude {
namespace {

struct Arguments {
  std::string data, collect, config, out, name;
  std::vector<std::string> set;
  double minutes = 0;
  std::uint64_t steps = 0;
  std::uint64_t seed = 0;
  bool has_seed = false, resume = false, follow = false, offline = false;
  bus::Arguments bus;
};

/// The collector of --collect on a thread of its own.
class HostedCollector {
 public:
  static Result<std::unique_ptr<HostedCollector>> Start(const bus::Participant& participant,
                                                        const std::string& spec_file, const Path& dataset) {
    ETUDE_ASSIGN_OR_RETURN(const auto spec, LoadConfig<CampaignSpec>(spec_file));
    ETUDE_RETURN_IF_ERROR(spec.Validate());
    ETUDE_ASSIGN_OR_RETURN(auto collector, campaign::Collector::Open(participant, spec, dataset));
    return std::unique_ptr<HostedCollector>(new HostedCollector(std::move(collector)));
  }
  ~HostedCollector() {
    collector_.Stop();
    thread_.join();
  }

 private:
  explicit HostedCollector(campaign::Collector collector)
      : collector_(std::move(collector)), thread_([this] {
          const Status status = collector_.Run();
          if (!status) Log().error("the collector stopped: {}", status.error().message);
        }) {}

  campaign::Collector collector_;
  std::thread thread_;
};

bus::TrainStatus ToMessage(const std::string& run, const learn::Progress& progress) {
  bus::TrainStatus status;
  status.run = run;
  status.step = progress.step;
  status.stage = static_cast<std::uint32_t>(progress.stage);
  status.stages = static_cast<std::uint32_t>(progress.stages);
  status.stage_name = progress.stage_name;
  status.loss = progress.loss;
  status.samples_per_second = progress.samples_per_second;
  status.data_wait = progress.data_wait;
  status.episodes = progress.train_episodes;
  status.eta_s = progress.eta_s;
  status.checkpoint_step = progress.checkpoint_step;
  status.metrics_json = OrderedJson(progress.metrics).dump();
  status.finished = progress.finished;
  return status;
}

Path ExecutablePath() {
  std::error_code error;
  const Path path = std::filesystem::read_symlink("/proc/self/exe", error);
  return error ? Path("bin/etude-trainer") : path;
}

Result<learn::TrainConfig> ReadConfig(const Arguments& arguments) {
  const char* share = std::getenv("ETUDE_SHARE");
  ETUDE_ASSIGN_OR_RETURN(const Path experiments, learn::FindExperiments(share ? share : "", ExecutablePath()));
  // a run that resumes is what it was, unless told otherwise
  const Path saved = Path(arguments.out) / "config.yaml";
  std::string source = arguments.config.empty() ? "compact" : arguments.config;
  if (arguments.resume && arguments.config.empty()) source = saved.string();
  ETUDE_ASSIGN_OR_RETURN(auto config, learn::LoadTrainConfig(source, experiments, arguments.set));
  if (arguments.minutes > 0 || arguments.steps > 0) {
    config.minutes = arguments.minutes;
    config.steps = arguments.steps;
  }
  if (arguments.has_seed) config.seed = arguments.seed;
  return config;
}

Status CheckOut(const Arguments& arguments) {
  const bool there = std::filesystem::exists(Path(arguments.out) / "training_state.safetensors");
  if (there && !arguments.resume)
    return Fail(
        Code::kInvalidArgument,
        fmt::format("'{}' holds a run already: continue it with --resume, or give another --out", arguments.out));
  if (!there && arguments.resume)
    return Fail(Code::kInvalidArgument, fmt::format("--resume: '{}' holds no run", arguments.out));
  return {};
}

// with --follow the dataset may be about to be made
Result<std::shared_ptr<data::Dataset>> OpenDataset(const Path& path, bool follow) {
  bool said = false;
  while (true) {
    auto dataset = data::Dataset::Open(path);
    if (dataset || !follow || dataset.error().code != Code::kNotFound) return dataset;
    if (!said) Log().info("waiting for dataset '{}'", path.string());
    said = true;
    if (WaitForStop(std::chrono::milliseconds(300)))
      return Fail(Code::kUnavailable, fmt::format("stopped while waiting for dataset '{}'", path.string()));
  }
}

Status TrainOn(std::shared_ptr<data::Dataset> dataset, const Arguments& arguments, const learn::TrainConfig& config,
               const std::string& run, const bus::Participant* participant) {
  std::optional<bus::Writer<bus::TrainStatus>> status_writer;
  if (participant) {
    ETUDE_ASSIGN_OR_RETURN(status_writer, bus::Writer<bus::TrainStatus>::Open(*participant, run));
  }
  ETUDE_ASSIGN_OR_RETURN(auto sink, publish::CheckpointSink::Open(arguments.out, run, participant));
  const learn::Hooks hooks{[&sink](const learn::CheckpointRequest& request) { return sink.Save(request); },
                           [&](const learn::Progress& progress) {
                             if (!status_writer) return;
                             const Status written = status_writer->Write(ToMessage(run, progress));
                             if (!written) Log().debug("telemetry: {}", written.error().message);
                           }};
  const learn::RunOptions options{arguments.out, arguments.resume, arguments.follow || !arguments.collect.empty()};
  ETUDE_ASSIGN_OR_RETURN(auto trainer, learn::Trainer::Create(config, std::move(dataset), options, hooks));
  return trainer->Run();
}

Status Train(const Arguments& arguments) {
  ETUDE_RETURN_IF_ERROR(CheckOut(arguments));
  ETUDE_ASSIGN_OR_RETURN(const auto config, ReadConfig(arguments));
  const std::string run = arguments.name.empty() ? publish::RunNameOf(arguments.out) : arguments.name;
  if (!IsPlainName(run))
    return Fail(Code::kInvalidArgument, fmt::format("--name '{}': must match [a-z0-9_-]{{1,64}}", run));
  policy::SetTorchThreads(config.threads.intra_op);

  std::optional<bus::Participant> participant;
  if (!arguments.offline) {
    ETUDE_ASSIGN_OR_RETURN(participant, arguments.bus.Open());
  } else if (!arguments.collect.empty()) {
    return Fail(Code::kInvalidArgument, "--collect needs the bus: leave out --offline");
  }
  std::unique_ptr<HostedCollector> collector;
  if (!arguments.collect.empty()) {
    ETUDE_ASSIGN_OR_RETURN(collector, HostedCollector::Start(*participant, arguments.collect, arguments.data));
  }
  ETUDE_ASSIGN_OR_RETURN(auto dataset, OpenDataset(arguments.data, arguments.follow || collector));
  Log().info("run '{}' in '{}', data '{}', {}", run, arguments.out, arguments.data, policy::DescribeTorch());
  return TrainOn(std::move(dataset), arguments, config, run, participant ? &*participant : nullptr);
}

Status Doctor() {
  policy::SetTorchThreads(0);
  const auto product = torch::mm(torch::full({64, 64}, 0.5f), torch::full({64, 64}, 2.0f));
  if (product[0][0].item<float>() != 64.0f)
    return Fail(Code::kUnavailable, "torch: a matrix product came out wrong on this machine");
  fmt::print("{}\n", policy::DescribeTorch());
  return {};
}

void AddOptions(CLI::App& app, Arguments& arguments) {
  app.add_option("--data", arguments.data, "the dataset's folder (with --collect by default OUT/dataset)");
  app.add_option("--collect", arguments.collect,
                 "campaign file: host its collector here; workers anywhere stream into --data "
                 "while training runs");
  app.add_option("--config", arguments.config,
                 "experiment: compact, paper, or a YAML file (default compact; with --resume the run's own)");
  app.add_option("--set", arguments.set, "override, e.g. --set optimizer.lr=1e-3; may be repeated")
      ->allow_extra_args(false);
  app.add_option("--out", arguments.out, "the run's folder: config, metrics, checkpoints, state");
  app.add_option("--name", arguments.name, "the run's name on the bus (default: from the folder's name)");
  app.add_option("--minutes", arguments.minutes, "stop after this much training; the learning rate follows");
  app.add_option("--steps", arguments.steps, "stop after this many steps; with --minutes whichever comes first");
  app.add_flag("--resume", arguments.resume, "go on where the run in --out stopped");
  app.add_flag("--follow", arguments.follow,
               "the dataset is still growing: wait for its first episodes, take in new ones");
  app.add_flag("--offline", arguments.offline, "do not publish on the bus");
  arguments.bus.Add(app);
  app.add_option("--seed", arguments.seed, "of weights and sample order (default: the experiment's)");
}

}  // namespace
}  // namespace etude

int main(int argc, char** argv) {
  using namespace etude;
  policy::PrepareTorchProcess(argv);
  Arguments arguments;
  CLI::App app{
      "Trains a policy module by module and publishes every checkpoint.\n"
      "Ctrl-C saves and exits; --resume goes on. Checkpoints: "
      "OUT/checkpoints/{latest,best}.safetensors."};
  AddOptions(app, arguments);
  auto* doctor = app.add_subcommand("doctor", "check torch on this machine and say what it uses");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? kExitOk : kExitUsage;
  }
  return RunMain("etude-trainer", [&]() -> Status {
    if (doctor->parsed()) return Doctor();
    arguments.has_seed = app.count("--seed") > 0;
    if (arguments.data.empty() && !arguments.collect.empty() && !arguments.out.empty())
      arguments.data = (Path(arguments.out) / "dataset").string();
    if (arguments.data.empty() || arguments.out.empty())
      return Fail(Code::kInvalidArgument, "give --data DATASET or --collect SPEC, and --out RUN (see --help)");
    return Train(arguments);
  });
}
