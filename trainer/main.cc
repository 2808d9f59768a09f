// SPDX-License-Identifier: Apache-2.0
// etude-trainer: trains a policy on a dataset, also while it is collected, and publishes
// checkpoints.
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <thread>

#include "services/bus/arguments.h"
#include "services/bus/directory.h"
#include "services/bus/process_reporter.h"
#include "services/bus/topic.h"
#include "services/campaign/hosted_collector.h"
#include "services/core/command.h"
#include "services/core/command_table.h"
#include "services/core/config_reference.h"
#include "services/core/log.h"
#include "services/core/service_manager.h"
#include "services/core/stop.h"
#include "services/core/stop_reason.h"
#include "trainer/learn/metrics_log.h"
#include "trainer/learn/trainer.h"
#include "trainer/local_ranks.h"
#include "trainer/policy/device.h"
#include "trainer/policy/policy_file.h"
#include "trainer/policy/torch_process.h"
#include "trainer/publish/sink.h"

namespace etude {
namespace {

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
  bool has_seed = false, resume = false, follow = false, offline = false;
  Claim claim = Claim::kRefuse;
  bus::Arguments bus;
};

bus::TrainStatus ToMessage(const publish::RunIdentity& run, const learn::Progress& progress) {
  bus::TrainStatus status;
  status.run = run.name;
  status.run_id = run.id;
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

// what the options say, as overrides; first, since those that follow may be about the graph that they choose
std::vector<std::string> Overrides(const Arguments& arguments) {
  std::vector<std::string> overrides;
  if (!arguments.init.empty()) {
    overrides.push_back("init.from=" + OrderedJson(arguments.init).dump());
    if (arguments.config.empty()) overrides.push_back("policy=checkpoint");
  }
  for (const auto& [key, names] : {std::pair{"add", &arguments.add},
                                   {"init.copy", &arguments.copy},
                                   {"init.fresh", &arguments.fresh},
                                   {"init.freeze", &arguments.freeze},
                                   {"init.like", &arguments.like}})
    if (!names->empty()) overrides.push_back(fmt::format("{}={}", key, OrderedJson(*names).dump()));
  overrides.insert(overrides.end(), arguments.set.begin(), arguments.set.end());
  return overrides;
}

Result<OrderedJson> ReadGraph(const std::string& file) {
  ETUDE_ASSIGN_OR_RETURN(const auto source, checkpoint::ReadFile(file));
  return checkpoint::GraphOf(source.metadata);
}

Result<learn::TrainConfig> ReadConfig(const Arguments& arguments) {
  const char* share = std::getenv("ETUDE_SHARE");
  ETUDE_ASSIGN_OR_RETURN(const Path experiments, policy::FindExperiments(share ? share : "", ExecutablePath()));
  // a run that resumes is what it was, unless told otherwise
  const Path saved = Path(arguments.out) / "config.yaml";
  std::string source = arguments.config.empty() ? "compact" : arguments.config;
  if (arguments.resume && arguments.config.empty()) source = saved.string();
  ETUDE_ASSIGN_OR_RETURN(auto config, learn::LoadTrainConfig(source, experiments, Overrides(arguments), ReadGraph));
  if (arguments.minutes > 0 || arguments.steps > 0) {
    config.minutes = arguments.minutes;
    config.steps = arguments.steps;
  }
  if (arguments.has_seed) config.seed = arguments.seed;
  return config;
}

bool HasState(const Path& out) {
  std::error_code ignored;
  return std::filesystem::exists(out / "training_state.safetensors", ignored);
}

// Of a trainer that starts itself again: a run that began with other weights goes on by hand.
std::optional<std::vector<std::string>> GoingOn(const Arguments& arguments) {
  if (!arguments.init.empty() && !arguments.resume) return std::nullopt;
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

/// A run on the bus: it is in the directory and says how it goes.
class Telemetry {
 public:
  /// Settles who the run is: its folder's id, and a start that is larger than any before. Without a participant only
  /// that. @error kUnavailable: the id is live elsewhere (see Claim).
  static Result<Telemetry> Open(const bus::Participant* participant, const std::string& name, const Path& folder,
                                Claim claim) {
    ETUDE_ASSIGN_OR_RETURN(const Identity identity, OpenIdentity(folder, claim));
    Telemetry telemetry;
    telemetry.run_ = {name, identity.id, publish::NextStart(folder)};
    if (!participant) return telemetry;
    bus::Presence presence = bus::MakePresence(bus::PresenceKind::kRun, name, identity.id, folder.string());
    presence.epoch = telemetry.run_.start;
    ETUDE_ASSIGN_OR_RETURN(telemetry.presence_, bus::Announcement::Open(*participant, presence, claim));
    telemetry.run_.start = telemetry.presence_->presence().epoch;
    ETUDE_ASSIGN_OR_RETURN(telemetry.writer_, bus::Writer<bus::TrainStatus>::Open(
                                                  *participant, bus::Owner{name, identity.id}.partition()));
    return telemetry;
  }

  const publish::RunIdentity& run() const { return run_; }
  void SignWith(std::shared_ptr<const security::CheckpointSigner> signer) { run_.signer = std::move(signer); }
  void Say(const learn::Progress& progress) {
    if (!writer_) return;
    if (const Status written = writer_->Write(ToMessage(run_, progress)); !written)
      Log().debug("telemetry: {}", written.error().message);
    const auto successor = superseded_ ? std::nullopt : presence_->Successor();
    if (!successor) return;
    superseded_ = bus::GivingWay(presence_->presence(), *successor);
    RequestStop();
  }
  /// Why the run was stopped, when another one has the better right to its id.
  Status status() const { return superseded_ ? Status(Fail(*superseded_)) : Status(); }

 private:
  publish::RunIdentity run_;
  std::optional<bus::Announcement> presence_;
  std::optional<bus::Writer<bus::TrainStatus>> writer_;
  std::optional<Error> superseded_;
};

/// Tells the campaign that grows the dataset where validation errs. What cannot be said is logged: training goes on.
class ErrorPublisher {
 public:
  ErrorPublisher(const bus::Participant* participant, const data::Dataset& dataset, const std::string& run_id)
      : participant_(participant), dataset_(dataset.path()) {
    message_.campaign = dataset.spec().name;
    message_.run_id = run_id;
  }

  void Say(const std::vector<ErrorCell>& cells, std::uint64_t step) {
    message_.step = step;
    message_.errors_json = ErrorCellsText(cells);
    const Status said = writer_ ? writer_->Write(message_) : Join();
    if (!said) Log().warn("cannot tell campaign={} where validation errs: {}", message_.campaign, said.error().message);
  }

 private:
  // not before there is something to say: a folder gets its id a moment after its dataset
  Status Join() {
    ETUDE_ASSIGN_OR_RETURN(const Identity campaign, ReadIdentity(dataset_));
    message_.campaign_id = campaign.id;
    const bus::Owner owner{message_.campaign, campaign.id};
    ETUDE_ASSIGN_OR_RETURN(writer_, bus::Writer<bus::ValidationErrors>::Open(*participant_, owner.partition()));
    constexpr std::chrono::seconds kPatience{5};
    if (!writer_->WaitForReaders(1, kPatience)) return {};  // it may be complete, and its collector gone
    return writer_->Write(message_);
  }

  const bus::Participant* participant_;
  Path dataset_;
  bus::ValidationErrors message_;
  std::optional<bus::Writer<bus::ValidationErrors>> writer_;
};

/// What a run meets besides its data.
struct Surroundings {
  const bus::Participant* participant = nullptr;  ///< none: offline
  std::function<Status()> source;
  std::shared_ptr<learn::Ranks> ranks;
  torch::Device device = torch::kCPU;
};

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
  ETUDE_ASSIGN_OR_RETURN(auto sink, publish::CheckpointSink::Open(arguments.out, telemetry.run(), around.participant,
                                                                  config.checkpoint.keep));
  learn::Hooks hooks{[&](const checkpoint::Checkpoint& made) { return Keep(sink, arguments.out, made); },
                     [&telemetry](const learn::Progress& progress) {
                       ServiceManager::Get().Say(fmt::format("step {}, {}", progress.step, progress.stage_name));
                       telemetry.Say(progress);
                     }};
  const bool follow = arguments.follow || !arguments.collect.empty();
  ErrorPublisher errors(around.participant, *dataset, telemetry.run().id);
  if (follow && around.participant && dataset->folders() == 1 && dataset->spec().adaptive_sampling.on())
    hooks.on_errors = [&errors](const std::vector<ErrorCell>& cells, std::uint64_t step) { errors.Say(cells, step); };
  const learn::RunOptions options{.out = arguments.out,
                                  .resume = arguments.resume,
                                  .follow = follow,
                                  .source = around.source,
                                  .ranks = around.ranks,
                                  .device = around.device};
  auto trainer = learn::Trainer::Create(config, std::move(dataset), options, hooks);
  if (!trainer) return BeforeTraining(std::move(trainer).error());
  ETUDE_RETURN_IF_ERROR((*trainer)->Run());
  return telemetry.status();
}

// "10.0.0.7:29500"
Result<learn::RanksOptions> ReadRanks(const Arguments& arguments) {
  learn::RanksOptions options{.size = arguments.ranks, .rank = std::max(0, arguments.rank)};
  if (arguments.meet.empty()) {
    if (arguments.rank > 0) return Fail(Code::kInvalidArgument, "--rank: needs --meet HOST:PORT of rank 0");
    return options;
  }
  const auto colon = arguments.meet.rfind(':');
  const int port = colon == std::string::npos ? 0 : std::atoi(arguments.meet.c_str() + colon + 1);
  if (port < 1 || port > 65535)
    return Fail(Code::kInvalidArgument, fmt::format("--meet '{}': must be HOST:PORT", arguments.meet));
  options.host = arguments.meet.substr(0, colon);
  options.port = static_cast<std::uint16_t>(port);
  return options;
}

/// This process's place among those that train together.
struct Together {
  LocalRanks local;                     ///< the others, where they were started here
  std::shared_ptr<learn::Ranks> ranks;  ///< none: it trains alone
};

// Without --rank the others are processes of this machine, and this is rank 0.
Status JoinRanks(const Arguments& arguments, Together& together) {
  if (arguments.ranks == 1) return {};
  ETUDE_ASSIGN_OR_RETURN(auto options, ReadRanks(arguments));
  options.watch = [&together] { return together.local.Check(); };
  ETUDE_ASSIGN_OR_RETURN(const auto meeting, learn::Meeting::Open(options));
  if (arguments.rank < 0) {
    std::vector<std::string> argv{ExecutablePath().string()};
    argv.insert(argv.end(), arguments.words.begin(), arguments.words.end());
    ETUDE_ASSIGN_OR_RETURN(
        together.local,
        LocalRanks::Start(argv, arguments.ranks, fmt::format("{}:{}", options.host, meeting.port()), arguments.out));
  }
  ETUDE_ASSIGN_OR_RETURN(together.ranks, learn::Ranks::Join(meeting, options));
  return {};
}

// A rank that does not lead: no bus, no files, the dataset as it stands on the disk.
Status TrainAlong(const Arguments& arguments, const learn::TrainConfig& config, const Surroundings& around) {
  const bool follow = arguments.follow || !arguments.collect.empty();
  ETUDE_ASSIGN_OR_RETURN(auto dataset, OpenDataset(arguments.data, follow, {}));
  const learn::RunOptions options{.out = arguments.out,
                                  .resume = arguments.resume,
                                  .follow = follow,
                                  .ranks = around.ranks,
                                  .device = around.device};
  ETUDE_ASSIGN_OR_RETURN(auto trainer, learn::Trainer::Create(config, std::move(dataset), options, {}));
  return trainer->Run();
}

Result<std::string> RunName(const Arguments& arguments) {
  const std::string run = arguments.name.empty() ? checkpoint::RunNameOf(arguments.out) : arguments.name;
  if (IsPlainName(run)) return run;
  return Fail(Code::kInvalidArgument, fmt::format("--name '{}': must match [a-z0-9_-]{{1,64}}", run));
}

// None when it trains offline.
Result<std::optional<bus::Participant>> JoinBus(const Arguments& arguments) {
  if (arguments.offline && !arguments.collect.empty())
    return Fail(Code::kInvalidArgument, "--collect needs the bus: leave out --offline");
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

// Ranks of one host share its cores; on hosts of their own each has them all.
int ReplicasOfRank(const Arguments& arguments) {
  constexpr int kMost = 256;  // that a configuration may say
  const int cores = std::clamp(static_cast<int>(std::thread::hardware_concurrency()), 1, kMost);
  const std::string host = arguments.meet.substr(0, arguments.meet.rfind(':'));
  const bool here = arguments.rank < 0 || host == learn::RanksOptions().host || host == "localhost";
  return here ? std::max(1, cores / arguments.ranks) : cores;
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
  auto opened = OpenDataset(arguments.data, arguments.follow || collector, source);
  if (!opened) return BeforeTraining(std::move(opened).error());
  auto dataset = std::move(*opened);
  Log().info("run {}@{} in '{}', data {}, {}, on {}", run, telemetry.run().id, arguments.out, dataset->text(),
             policy::DescribeTorch(), device.str());
  return TrainOn(std::move(dataset), arguments, config, telemetry,
                 {participant ? &*participant : nullptr, source, together.ranks, device});
}

Status Train(const Arguments& arguments) {
  if (arguments.rank >= arguments.ranks)
    return Fail(Code::kInvalidArgument,
                fmt::format("--rank {}: --ranks has to say of how many, more than {}", arguments.rank, arguments.rank));
  const bool leads = arguments.rank <= 0;
  if (leads) ETUDE_RETURN_IF_ERROR(CheckOut(arguments));
  RestartWith([arguments] { return GoingOn(arguments); });
  ETUDE_ASSIGN_OR_RETURN(auto config, ReadConfig(arguments));
  ETUDE_ASSIGN_OR_RETURN(const auto device, policy::OpenDevice(arguments.device, std::max(0, arguments.rank)));
  if (config.threads.replicas == 0 && arguments.ranks > 1) config.threads.replicas = ReplicasOfRank(arguments);
  ETUDE_RETURN_IF_ERROR(MakeFolders(arguments.out));
  Together together;
  ETUDE_RETURN_IF_ERROR(JoinRanks(arguments, together));
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

void AddOptions(CLI::App& app, Arguments& arguments) {
  app.add_option("--data", arguments.data,
                 "the dataset's folder (with --collect by default OUT/dataset); several are read as one");
  app.add_option("--collect", arguments.collect,
                 "campaign file: host its collector here; workers anywhere stream into --data "
                 "while training runs");
  app.add_option("--config", arguments.config,
                 "experiment: compact, paper, or a YAML file (default compact; with --resume the run's own)");
  app.add_option("--set", arguments.set, "override, e.g. --set optimizer.lr=1e-3; may be repeated")
      ->allow_extra_args(false);
  app.add_option("--init", arguments.init,
                 "begin with this checkpoint, and with its graph unless --config names another");
  const auto parts = [&](const char* option, std::vector<std::string>& names, const char* what) {
    app.add_option(option, names, what)->delimiter(',')->allow_extra_args(false);
  };
  parts("--add", arguments.add, "put modules on top of the graph: obstacle, multi_obstacle, relational, or a file");
  parts("--copy", arguments.copy, "parts to take from --init, e.g. image,language,LANG (default: all that both have)");
  parts("--fresh", arguments.fresh, "parts that begin anew all the same");
  parts("--freeze", arguments.freeze, "parts that stay as they are, bit for bit");
  parts("--like", arguments.like, "new parts that begin with another one's weights, e.g. OBST2D=TAR2D");
  app.add_option("--out", arguments.out, "the run's folder: config, metrics, checkpoints, state");
  app.add_option("--name", arguments.name, "the run's name on the bus (default: from the folder's name)");
  app.add_option("--minutes", arguments.minutes, "stop after this much training; the learning rate follows");
  app.add_option("--steps", arguments.steps, "stop after this many steps; with --minutes whichever comes first");
  app.add_option("--ranks", arguments.ranks, "processes that train together, each on its part of every batch")
      ->check(CLI::Range(1, 1024));
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
  bus::AddClaim(app, arguments.claim);
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
  auto* describe =
      app.add_subcommand("describe", "every key of an experiment with its type, unit, default and meaning");
  bool as_json = false;
  describe->add_flag("--json", as_json, "as JSON");
  if (const auto ended = ParseCommandLine(app, argc, argv)) return *ended;
  return RunMain("etude-trainer", [&]() -> Status {
    if (doctor->parsed()) return Doctor();
    if (describe->parsed()) return PrintReference(ConfigReference<learn::TrainConfig>(), as_json), Status();
    arguments.words.assign(argv + 1, argv + argc);
    arguments.has_seed = app.count("--seed") > 0;
    if (arguments.data.empty() && !arguments.collect.empty() && !arguments.out.empty())
      arguments.data = {(Path(arguments.out) / "dataset").string()};
    if (arguments.data.empty() || arguments.out.empty())
      return Fail(Code::kInvalidArgument, "give --data DATASET or --collect SPEC, and --out RUN (see --help)");
    if (arguments.data.size() > 1 && !arguments.collect.empty())
      return Fail(Code::kInvalidArgument,
                  "--collect collects into one folder, --data names several: start `etude collector` by itself, and "
                  "train on all of them with --follow");
    return Train(arguments);
  });
}
