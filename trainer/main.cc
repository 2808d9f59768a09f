// SPDX-License-Identifier: Apache-2.0
// etude-trainer: trains a policy on a dataset, also while it is collected, and publishes checkpoints.
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <filesystem>
#include <functional>
#include <optional>
#include <utility>

#include "services/bus/process_reporter.h"
#include "services/campaign/hosted_collector.h"
#include "services/core/command.h"
#include "services/core/command_table.h"
#include "services/core/config_reference.h"
#include "services/core/file_lock.h"
#include "services/core/log.h"
#include "services/core/service_manager.h"
#include "services/core/share.h"
#include "services/core/stop.h"
#include "services/core/stop_reason.h"
#include "trainer/arguments.h"
#include "trainer/learn/metrics_log.h"
#include "trainer/learn/trainer.h"
#include "trainer/local_ranks.h"
#include "trainer/policy/device.h"
#include "trainer/policy/torch_process.h"
#include "trainer/publish/sink.h"
#include "trainer/telemetry.h"

namespace etude {
namespace {

bool HasState(const Path& out) {
  std::error_code ignored;
  return std::filesystem::exists(out / "training_state.safetensors", ignored);
}

// Of a trainer that starts itself again: a run that began with other weights or modules, which --resume refuses to be
// told again, goes on by hand.
std::optional<std::vector<std::string>> GoingOn(const Arguments& arguments) {
  const bool begins = !arguments.init.empty() || !arguments.add.empty() || !arguments.copy.empty() ||
                      !arguments.fresh.empty() || !arguments.like.empty();
  if (!arguments.resume && begins) return std::nullopt;
  return HasState(arguments.out) ? std::vector<std::string>{"--resume"} : std::vector<std::string>();
}

Status CheckOut(const Arguments& arguments) {
  const bool there = HasState(arguments.out);
  if (there && !arguments.resume)
    return Fail(
        Code::kInvalidArgument,
        fmt::format("'{}' holds a run already: continue it with --resume, or give another --out", arguments.out));
  if (arguments.resume && !arguments.init.empty())
    return Fail(Code::kInvalidArgument, "--init begins a run, --resume goes on with one: give one of them");
  for (const auto& [option, parts] : {std::pair{"--add", &arguments.add},
                                      {"--copy", &arguments.copy},
                                      {"--fresh", &arguments.fresh},
                                      {"--like", &arguments.like}})
    if (arguments.resume && !parts->empty())
      return Fail(Code::kInvalidArgument, fmt::format("{} {}: says how a run begins, and --resume goes on with one",
                                                      option, fmt::join(*parts, ",")));
  if (!there && arguments.resume)
    return Fail(Code::kInvalidArgument, fmt::format("--resume: '{}' holds no run", arguments.out));
  return {};
}

// with --follow the dataset may be about to be made
Result<std::shared_ptr<data::Dataset>> OpenDataset(const std::vector<std::string>& folders, bool follow,
                                                   const std::function<Status()>& source) {
  bool said = false;
  while (true) {
    auto dataset = data::Dataset::Open(std::vector<Path>(folders.begin(), folders.end()));
    if (dataset || !follow || dataset.error().code != Code::kNotFound) return dataset;
    if (source) ETUDE_RETURN_IF_ERROR(source());
    if (!said) Log().info("waiting for dataset '{}'", fmt::join(folders, "', '"));
    said = true;
    if (WaitForStop(std::chrono::milliseconds(300)))
      return Fail(Code::kUnavailable,
                  fmt::format("stopped while waiting for dataset '{}'", fmt::join(folders, "', '")));
  }
}

/// What a run meets besides its data.
struct Surroundings {
  const bus::Participant* participant = nullptr;  ///< none: offline
  std::function<Status()> source;
  std::function<bool()> over;  ///< whether its collector has ended
  std::shared_ptr<learn::Ranks> ranks;
  torch::Device device = torch::kCPU;
};

learn::RunOptions OptionsOf(const Arguments& arguments, const Surroundings& around) {
  learn::RunOptions options{.out = arguments.out,
                            .resume = arguments.resume,
                            .follow = arguments.follows(),
                            .ranks = around.ranks,
                            .device = around.device,
                            .replicas = arguments.ranks > 1 ? ReplicasOfRank(arguments) : 0};
  // its collector is this process's own, or a service manager keeps both: whoever works for it may come tomorrow
  if (!arguments.collect.empty() || ServiceManager::IsThere()) options.patience = std::chrono::hours(24 * 365);
  return options;
}

// The files first, then a line in the run's metrics that says so: without it training goes on.
Status Keep(publish::CheckpointSink& sink, const Path& out, const checkpoint::Checkpoint& made) {
  ETUDE_ASSIGN_OR_RETURN(const publish::Kept kept, sink.Save(made));
  for (const auto& channel : kept.channels) {
    const Status noted = learn::NoteCheckpoint(out, made.metadata.step, kept.file, kept.sha256, channel);
    if (!noted) Log().warn("{}", noted.error().message);
  }
  return {};
}

/// Who is stopped while it waits for data has not failed: nothing was trained yet, and nothing is lost.
Status BeforeTraining(Error error) {
  if (!StopRequested() || error.code != Code::kUnavailable) return Fail(std::move(error));
  Log().info("{}: nothing was trained yet", error.message);
  return {};
}

Status TrainOn(std::shared_ptr<data::Dataset> dataset, const Arguments& arguments, const learn::TrainConfig& config,
               Telemetry& telemetry, const Surroundings& around) {
  if (!arguments.resume) ETUDE_RETURN_IF_ERROR(publish::SetCheckpointsAside(arguments.out, config.init.from));
  ETUDE_ASSIGN_OR_RETURN(auto sink, publish::CheckpointSink::Open(arguments.out, telemetry.run(), around.participant,
                                                                  config.checkpoint.keep, [&] {
                                                                    if (around.source) (void)around.source();
                                                                  }));
  learn::Hooks hooks{[&](const checkpoint::Checkpoint& made) { return Keep(sink, arguments.out, made); },
                     [&telemetry](const learn::Progress& progress) {
                       ServiceManager::Get().Say(fmt::format("step {}, {}", progress.step, progress.stage_name));
                       telemetry.Say(progress);
                     }};
  hooks.has_checkpoint = [&sink](std::uint64_t step) { return sink.Has(step); };
  hooks.has_best = [&sink] { return sink.HasBest(); };
  ErrorPublisher errors(around.participant, *dataset, telemetry.run().id);
  if (arguments.follows() && around.participant && dataset->folders() == 1 && dataset->spec().adaptive_sampling.on())
    hooks.on_errors = [&errors](const std::vector<ErrorCell>& cells, std::uint64_t step) { errors.Say(cells, step); };
  learn::RunOptions options = OptionsOf(arguments, around);
  options.source = around.source;
  options.over = around.over;
  auto trainer = learn::Trainer::Create(config, std::move(dataset), options, hooks);
  if (!trainer) return BeforeTraining(std::move(trainer).error());
  ETUDE_RETURN_IF_ERROR((*trainer)->Run());
  sink.AwaitSubscribers();
  return telemetry.status();
}

/// This process's place among those that train together.
struct Together {
  LocalRanks local;                     ///< the others, where they were started here
  std::shared_ptr<learn::Ranks> ranks;  ///< none: it trains alone
};

// Without --rank the others are processes of this machine, and this is rank 0.
Status JoinRanks(const Arguments& arguments, const torch::Device& device, Together& together) {
  if (arguments.ranks == 1) return {};
  ETUDE_ASSIGN_OR_RETURN(auto options, ReadRanks(arguments));
  options.device = device;
  options.watch = [&together] { return together.local.Check(); };
  ETUDE_ASSIGN_OR_RETURN(const auto meeting, learn::Meeting::Open(options));
  if (arguments.rank < 0) {
    std::vector<std::string> argv{ProgramFile().string()};
    argv.insert(argv.end(), arguments.words.begin(), arguments.words.end());
    ETUDE_ASSIGN_OR_RETURN(
        together.local,
        LocalRanks::Start(argv, arguments.ranks, fmt::format("{}:{}", options.host, meeting.port()), arguments.out));
  }
  ETUDE_ASSIGN_OR_RETURN(together.ranks, learn::Ranks::Join(meeting, options));
  Log().info("rank {} of {} sums gradients by {}", together.ranks->rank(), together.ranks->size(),
             together.ranks->by_nccl() ? "NCCL" : "Gloo");
  return {};
}

// A rank that does not lead: no bus, no files, the dataset as it stands on the disk.
Status TrainAlong(const Arguments& arguments, const learn::TrainConfig& config, const Surroundings& around) {
  auto dataset = OpenDataset(arguments.data, arguments.follows(), {});
  if (!dataset) return BeforeTraining(std::move(dataset).error());
  auto trainer = learn::Trainer::Create(config, std::move(*dataset), OptionsOf(arguments, around), {});
  if (!trainer) return BeforeTraining(std::move(trainer).error());
  return (*trainer)->Run();
}

// None when it trains offline.
Result<std::optional<bus::Participant>> JoinBus(const Arguments& arguments) {
  if (arguments.offline && !arguments.collect.empty())
    return Fail(Code::kInvalidArgument, "--collect needs the bus: leave out --offline");
  if (arguments.offline && !arguments.sign.empty())
    return Fail(Code::kInvalidArgument, "--sign signs what is published: leave out --offline");
  if (arguments.offline) return std::nullopt;
  std::vector<security::Role> roles{security::Role::kTrainer};
  if (!arguments.collect.empty()) roles.push_back(security::Role::kCollector);
  ETUDE_ASSIGN_OR_RETURN(auto participant, arguments.bus.Open(roles));
  return std::optional<bus::Participant>(std::move(participant));
}

// None without --sign.
Result<std::shared_ptr<const security::CheckpointSigner>> OpenSigner(const Arguments& arguments) {
  if (arguments.sign.empty()) return nullptr;
  ETUDE_ASSIGN_OR_RETURN(auto opened, security::CheckpointSigner::Open(arguments.sign));
  return std::make_shared<const security::CheckpointSigner>(std::move(opened));
}

// Rank 0, or alone: all but the others' steps.
Status Lead(const Arguments& arguments, const learn::TrainConfig& config, Together& together,
            const torch::Device& device) {
  ETUDE_ASSIGN_OR_RETURN(const std::string run, RunName(arguments));
  ETUDE_ASSIGN_OR_RETURN(auto participant, JoinBus(arguments));
  ETUDE_ASSIGN_OR_RETURN(auto signer, OpenSigner(arguments));
  std::unique_ptr<bus::ProcessReporter> reporter;
  if (participant) {
    ETUDE_ASSIGN_OR_RETURN(reporter,
                           bus::ProcessReporter::Start(*participant, {.role = "trainer", .folder = arguments.out}));
  }
  ETUDE_ASSIGN_OR_RETURN(auto telemetry,
                         Telemetry::Open(participant ? &*participant : nullptr, run, arguments.out, arguments.claim));
  telemetry.SignWith(std::move(signer));
  std::unique_ptr<campaign::HostedCollector> collector;
  if (!arguments.collect.empty()) {
    ETUDE_ASSIGN_OR_RETURN(collector,
                           campaign::HostedCollector::Start(*participant, arguments.collect, arguments.data.front(),
                                                            {.claim = arguments.claim, .run_id = telemetry.run().id}));
  }
  WatchedLoop watched;  // both waiting for data and training ask for their source about once a second
  const std::function<Status()> source = [&]() -> Status {
    watched.Moved();
    ETUDE_RETURN_IF_ERROR(together.local.Check());
    return collector ? collector->status() : Status();
  };
  ServiceManager::Get().Ready(fmt::format("run {}@{}", run, telemetry.run().id));
  auto opened = OpenDataset(arguments.data, arguments.follows(), source);
  if (!opened) return BeforeTraining(std::move(opened).error());
  auto dataset = std::move(*opened);
  Log().info("run {}@{} in '{}', data {}, {}, on {}", run, telemetry.run().id, arguments.out, dataset->text(),
             policy::DescribeTorch(), device.str());
  return TrainOn(std::move(dataset), arguments, config, telemetry,
                 {.participant = participant ? &*participant : nullptr,
                  .source = source,
                  .over = [&collector] { return collector && collector->ended(); },
                  .ranks = together.ranks,
                  .device = device});
}

Status CheckRank(const Arguments& arguments) {
  // one that is alone would train the whole run while the others wait for it
  if (arguments.ranks == 1 && (arguments.rank >= 0 || !arguments.meet.empty()))
    return Fail(Code::kInvalidArgument, "--rank, --meet: --ranks N has to say of how many");
  if (arguments.ranks > 1) ETUDE_RETURN_IF_ERROR(ReadRanks(arguments));
  if (arguments.rank < arguments.ranks) return {};
  return Fail(Code::kInvalidArgument,
              fmt::format("--rank {}: --ranks has to say of how many, more than {}", arguments.rank, arguments.rank));
}

// What would be refused hours later, where a run waits for its data. Nothing is written.
Status Check(const Arguments& arguments) {
  ETUDE_RETURN_IF_ERROR(CheckRank(arguments));
  ETUDE_RETURN_IF_ERROR(CheckOut(arguments));
  ETUDE_ASSIGN_OR_RETURN(const auto config, ReadConfig(arguments));
  ETUDE_RETURN_IF_ERROR(RunName(arguments));
  ETUDE_RETURN_IF_ERROR(policy::OpenDevice(arguments.device, std::max(0, arguments.rank)));
  ETUDE_RETURN_IF_ERROR(learn::CheckBeginning(config, arguments.resume));
  fmt::print("experiment '{}' is well\n", config.name);
  return {};
}

Status Train(const Arguments& arguments) {
  ETUDE_RETURN_IF_ERROR(CheckRank(arguments));
  const bool leads = arguments.rank <= 0;
  if (leads) ETUDE_RETURN_IF_ERROR(CheckOut(arguments));
  RestartWith([arguments] { return GoingOn(arguments); });
  ETUDE_ASSIGN_OR_RETURN(auto config, ReadConfig(arguments));
  ETUDE_RETURN_IF_ERROR(learn::RequireLimit(config));  // before a collector has begun for it
  ETUDE_ASSIGN_OR_RETURN(const auto device, policy::OpenDevice(arguments.device, std::max(0, arguments.rank)));
  ETUDE_RETURN_IF_ERROR(MakeFolders(arguments.out));
  std::optional<FileLock> lock;  // beside a dataset's own, which may lie in the same folder
  if (leads) {
    ETUDE_ASSIGN_OR_RETURN(lock, FileLock::Take(Path(arguments.out) / ".training.lock",
                                                fmt::format("run '{}' is being trained", arguments.out)));
  }
  Together together;
  if (auto joined = JoinRanks(arguments, device, together); !joined) return BeforeTraining(std::move(joined).error());
  policy::SetTorchThreads(config.threads.intra_op);
  if (!leads) return TrainAlong(arguments, config, {.ranks = together.ranks, .device = device});
  const Status ended = Lead(arguments, config, together, device);
  if (!ended && together.ranks && together.ranks->lost()) return Fail(together.local.Explain(ended.error()));
  return ended;
}

Status Doctor() {
  policy::SetTorchThreads(0);
  const auto product = torch::mm(torch::full({64, 64}, 0.5f), torch::full({64, 64}, 2.0f));
  if (product[0][0].item<float>() != 64.0f)
    return Fail(Code::kUnavailable, "torch: a matrix product came out wrong on this machine");
  fmt::print("{}\n", policy::DescribeTorch());
  return {};
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
  auto* describe =
      app.add_subcommand("describe", "every key of an experiment with its type, unit, default and meaning");
  bool as_json = false;
  describe->add_flag("--json", as_json, "as JSON");
  if (const auto ended = ParseCommandLine(app, argc, argv)) return *ended;
  return RunMain("etude-trainer", [&]() -> Status {
    if (doctor->parsed()) return Doctor();
    if (describe->parsed()) return PrintReference(ConfigReference<learn::TrainConfig>(), as_json), Status();
    ETUDE_RETURN_IF_ERROR(Complete(app, argc, argv, arguments));
    return arguments.check ? Check(arguments) : Train(arguments);
  });
}
