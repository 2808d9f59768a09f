// SPDX-License-Identifier: Apache-2.0
// `etude up`: collection, training, policy server and rollouts on this machine, supervised.
#include <fmt/format.h>

#include <map>
#include <optional>

#include "services/bus/directory.h"
#include "services/bus/process_reporter.h"
#include "services/bus/topic.h"
#include "services/campaign/eval_report.h"
#include "services/campaign/spec_file.h"
#include "services/cli/command_line.h"
#include "services/cli/dashboard_service.h"
#include "services/cli/evaluation.h"
#include "services/cli/results_folder.h"
#include "services/cli/service.h"
#include "services/cli/sibling_text.h"
#include "services/cli/up_config.h"
#include "services/cli/up_record.h"
#include "services/core/command.h"
#include "services/core/file_lock.h"
#include "services/core/log.h"
#include "services/core/stop.h"
#include "services/relay/relay_thread.h"
#include "services/security/identity.h"

namespace etude::cli {
namespace {

using namespace std::chrono_literals;

// a trainer saves its state and its last checkpoint when it is told to stop
constexpr auto kTrainerPatience = 60s;
constexpr auto kPolicyPatience = 5s;

struct UpArguments {
  std::string file;
  std::vector<std::string> overrides;
  std::optional<std::uint64_t> episodes;
  std::optional<double> minutes;
  std::optional<int> workers;
  std::optional<std::uint32_t> domain;
  std::string out;
  bool keep_running = false;
  bool no_dashboard = false;
  std::uint16_t dashboard_port = 8080;
  std::string profile;
  std::string log = "text";
  std::string security;
  Claim claim = Claim::kRefuse;
};

// The system and its life: collect and train side by side, then roll out.
class System {
 public:
  System(UpConfig config, CampaignSpec spec, BusArguments bus, Claim claim, Identity run, bus::Participant participant,
         bus::Reader<bus::TrainStatus> train_statuses, UpRecord* record, std::optional<DashboardService> dashboard)
      : config_(std::move(config)),
        spec_(std::move(spec)),
        bus_(std::move(bus)),
        claim_(claim),
        run_(std::move(run)),
        out_(config_.out),
        participant_(std::move(participant)),
        train_statuses_(std::move(train_statuses)),
        record_(record),
        dashboard_(std::move(dashboard)) {}

  Status Run(bool keep_running);

 private:
  Status CollectAndTrain();
  Status EndCollection();
  std::uint64_t EnoughToTrain() const { return std::min(config_.train.start_episodes, spec_.episodes); }
  Status TrainOnceThereIsEnough(const campaign::CollectorProgress& collected);
  Status StartTraining(bool grows);
  Status StartServing();
  Status Tick();
  void TickDashboard();
  Status RollOut();
  void StartRelay();
  void Drain();
  std::string Line();
  std::string TrainLine() const;
  void PrintWhere() const;

  UpConfig config_;
  CampaignSpec spec_;
  BusArguments bus_;
  Claim claim_;
  Identity run_;  // of the training run: its own policy server and no other is asked
  Path out_;
  bus::Participant participant_;
  bus::Reader<bus::TrainStatus> train_statuses_;
  UpRecord* record_;
  std::optional<DashboardService> dashboard_;
  std::optional<bus::TrainStatus> train_;
  std::unique_ptr<HostedCampaign> collection_;
  std::optional<campaign::CollectorProgress> collected_;  // final, once collection has ended
  std::optional<Service> trainer_, policy_;
  Stopwatch since_start_;
  ProgressDisplay display_;
  std::optional<relay::RelayThread> relay_;  // ends before the participant
};

Path RunFolder(const UpConfig& config) { return Path(config.out) / "run" / config.train.run; }

Path StateOfRun(const UpConfig& config) { return RunFolder(config) / "training_state.safetensors"; }

bool GoesOn(const UpConfig& config) {
  std::error_code ignored;
  return std::filesystem::exists(StateOfRun(config), ignored);
}

// What the trainer is told, but for the bus. An earlier `up` on the same folder that was stopped is gone on with.
// `grows`: data that is not there yet is waited for.
std::vector<std::string> TrainingWords(const UpConfig& config, bool grows) {
  std::vector<std::string> words{"--data",    (Path(config.out) / "dataset").string(),
                                 "--config",  config.train.config,
                                 "--out",     RunFolder(config).string(),
                                 "--name",    config.train.run,
                                 "--minutes", fmt::format("{}", config.train.minutes)};
  if (grows) words.emplace_back("--follow");
  for (const auto& text : config.train.set) words.insert(words.end(), {"--set", text});
  if (GoesOn(config)) words.emplace_back("--resume");
  return words;
}

// A complete collection may have less than training was to begin with, and nothing more will come.
Status System::TrainOnceThereIsEnough(const campaign::CollectorProgress& collected) {
  if (trainer_ || (!collected.complete && collected.committed < EnoughToTrain())) return {};
  ETUDE_RETURN_IF_ERROR(CheckNotAllGivenUp(collected, out_ / "dataset"));
  return StartTraining(!collected.complete);
}

Status System::StartTraining(bool grows) {
  const Path run = RunFolder(config_);
  ServiceOptions trainer;
  trainer.program = "etude-trainer";
  trainer.arguments = TrainingWords(config_, grows);
  const auto flags = bus_.Flags(security::Role::kTrainer);
  trainer.arguments.insert(trainer.arguments.end(), flags.begin(), flags.end());
  if (!GoesOn(config_)) {
    trainer.restart_arguments = {"--resume"};
    trainer.restart_needs = StateOfRun(config_);
  }
  // --new-id is done already
  if (claim_ == Claim::kAdopt) trainer.arguments.push_back("--adopt");
  trainer.environment = bus_.Environment();
  trainer.log = out_ / "logs" / "trainer.log";
  ETUDE_ASSIGN_OR_RETURN(auto started, Service::Start(trainer));
  trainer_.emplace(std::move(started));
  ETUDE_RETURN_IF_ERROR(StartServing());
  display_.Say(fmt::format("[{}] training starts: run '{}' in {}", FormatDuration(since_start_.Seconds()),
                           config_.train.run, run.string()));
  return {};
}

Status System::StartServing() {
  ServiceOptions policy;
  policy.program = "etude-policy";
  policy.arguments = {"--subscribe", Selector{config_.train.run, run_.id}.text()};
  const auto serving_flags = bus_.Flags(security::Role::kPolicy);
  policy.arguments.insert(policy.arguments.end(), serving_flags.begin(), serving_flags.end());
  policy.environment = bus_.Environment();
  policy.log = out_ / "logs" / "policy.log";
  policy.lasting = true;
  ETUDE_ASSIGN_OR_RETURN(auto serving, Service::Start(policy));
  policy_.emplace(std::move(serving));
  return {};
}

// Everything that is watched all the time.
Status System::Tick() {
  if (collection_) ETUDE_RETURN_IF_ERROR(collection_->Supervise());
  if (trainer_) ETUDE_RETURN_IF_ERROR(trainer_->Supervise());
  if (policy_) ETUDE_RETURN_IF_ERROR(policy_->Supervise());
  for (auto& status : train_statuses_.Take())
    if (status.run_id == run_.id) train_ = std::move(status);
  std::map<std::string, pid_t> children;
  if (const auto pid = trainer_ ? trainer_->pid() : std::nullopt) children["trainer"] = *pid;
  if (const auto pid = policy_ ? policy_->pid() : std::nullopt) children["policy"] = *pid;
  TickDashboard();
  if (const auto pid = dashboard_ ? dashboard_->pid() : std::nullopt) children["dashboard"] = *pid;
  record_->SetChildren(children);
  return {};
}

// Pages are for people: what is collected and trained does not depend on them.
void System::TickDashboard() {
  if (!dashboard_) return;
  const std::string before = dashboard_->address();
  const Status well = dashboard_->Supervise();
  if (!well) {
    display_.Say("no dashboard: " + well.error().message);
    dashboard_.reset();
  }
  const std::string now = dashboard_ ? dashboard_->address() : "";
  if (now == before) return;
  if (!now.empty()) display_.Say("dashboard   " + now);
  record_->SetAddress(now);
}

// `etude up OUT/up.yaml` goes on with it.
Status KeepForNextTime(const UpConfig& config, const CampaignSpec& spec) {
  UpConfig resolved = config;
  std::error_code ignored;
  resolved.campaign = std::filesystem::absolute(config.campaign, ignored).lexically_normal().string();
  resolved.out = std::filesystem::absolute(config.out, ignored).lexically_normal().string();
  // a file, or else a name
  if (std::filesystem::is_regular_file(config.train.config, ignored))
    resolved.train.config = std::filesystem::absolute(config.train.config, ignored).lexically_normal().string();
  std::erase_if(resolved.campaign_set, [](const std::string& set) { return set.starts_with("episodes="); });
  resolved.campaign_set.push_back(fmt::format("episodes={}", spec.episodes));
  return WriteFileAtomically(Path(config.out) / "up.yaml", ToYaml(ToJson(resolved)));
}

Status System::CollectAndTrain() {
  record_->SetPhase("collect and train",
                    fmt::format("{} demonstrations, {:g} min of training", spec_.episodes, config_.train.minutes));
  ETUDE_ASSIGN_OR_RETURN(collection_, HostedCampaign::Start(participant_, spec_,
                                                            {.bus = bus_,
                                                             .workers = config_.workers,
                                                             .out = out_ / "dataset",
                                                             .logs = out_ / "logs",
                                                             .claim = claim_,
                                                             .run_id = run_.id}));
  // not before: another campaign's dataset is refused, and its file must stay what made it
  ETUDE_RETURN_IF_ERROR(KeepForNextTime(config_, spec_));
  // what was asked for is collected, however short the training is; rollouts then have the cores to themselves
  const auto all_done = [this] { return trainer_ && trainer_->done() && !collection_; };
  while (!StopRequested() && !all_done()) {
    ETUDE_RETURN_IF_ERROR(Tick());
    if (collection_) {
      const auto progress = collection_->progress();
      ETUDE_RETURN_IF_ERROR(TrainOnceThereIsEnough(progress));
      if (collection_->ended()) ETUDE_RETURN_IF_ERROR(EndCollection());
    }
    if (display_.due()) display_.Show(Line());
    WaitForStop(100ms);
  }
  return StopRequested() ? Status() : CheckFinished(RunFolder(config_));
}

// It is complete, or somebody has stopped it: then there may be too little to begin to train with.
Status System::EndCollection() {
  ETUDE_RETURN_IF_ERROR(collection_->Finish());
  collected_ = collection_->progress();
  collection_.reset();
  display_.Say(
      fmt::format("[{}] collected:\n{}", FormatDuration(since_start_.Seconds()), campaign::SummaryText(*collected_)));
  if (StopRequested()) return {};
  ETUDE_RETURN_IF_ERROR(TrainOnceThereIsEnough(*collected_));
  if (trainer_) return {};
  return Fail(Code::kUnavailable,
              fmt::format("train: the campaign was stopped with {} of the {} episodes that training begins with "
                          "(train.start_episodes); run again to go on",
                          collected_->committed, EnoughToTrain()));
}

std::string System::TrainLine() const {
  if (!train_) return "training: starting";
  const auto& train = *train_;
  std::string line = fmt::format("training: step {}  stage {}/{} {}  loss {:.4f}  {:.0f} samples/s", train.step,
                                 train.stage, train.stages, train.stage_name, train.loss, train.samples_per_second);
  if (train.checkpoint_step > 0) line += fmt::format("  checkpoint {}", train.checkpoint_step);
  if (train.eta_s > 0) line += "  ETA " + FormatDuration(train.eta_s);
  return line;
}

std::string System::Line() {
  std::string line = fmt::format("[{}] ", FormatDuration(since_start_.Seconds()));
  if (collection_) line += campaign::ProgressLine(collection_->progress());
  if (collection_ && trainer_) line += " | ";
  if (trainer_) line += TrainLine();
  return line;
}

// The evaluation of the run's policy as it was at `step`.
EvaluationOptions UpEvaluation(const UpConfig& config, const std::string& run_id, std::uint64_t step) {
  const Path out = config.out;
  return {.run = config.train.run,
          .tasks = config.eval.tasks,
          .episodes = config.eval.episodes,
          .seed = config.eval.seed,
          .videos = config.eval.videos,
          // a new policy gets a new folder; the same one is resumed
          .out = out / "eval" / fmt::format("step-{:06}", step),
          .subject = {.run_id = run_id, .run = config.train.run},
          .run_folder = RunFolder(config)};
}

Status System::RollOut() {
  const std::uint64_t step = train_ ? train_->checkpoint_step : 0;
  const EvaluationOptions evaluation = UpEvaluation(config_, run_.id, step);
  const CampaignSpec spec = EvaluationSpec(spec_, evaluation);
  ETUDE_RETURN_IF_ERROR(spec.Validate());
  record_->SetPhase("roll out", fmt::format("{} rollouts", spec.episodes));
  display_.Say(fmt::format("[{}] rolling out {} episodes", FormatDuration(since_start_.Seconds()), spec.episodes));
  ETUDE_ASSIGN_OR_RETURN(const OrderedJson report, Evaluate(participant_, spec, evaluation,
                                                            {.bus = bus_,
                                                             .workers = config_.workers,
                                                             .out = evaluation.out,
                                                             .logs = out_ / "logs",
                                                             .claim = claim_,
                                                             .policy_id = run_.id},
                                                            display_, [this] { return Tick(); }));
  if (StopRequested()) return {};
  display_.Say("");
  fmt::print("{}", campaign::EvalTable(report));
  fmt::print("evaluation  {}/eval.json\nvideos      {}/videos\n", evaluation.out.string(), evaluation.out.string());
  return {};
}

void System::Drain() {
  record_->SetPhase("drain");
  if (collection_) (void)collection_->Finish();
  if (trainer_) trainer_->Stop(kTrainerPatience);
  if (policy_) policy_->Stop(kPolicyPatience);
  if (dashboard_) dashboard_->Stop(kPolicyPatience);
}

void System::PrintWhere() const {
  fmt::print("dataset     {}\nrun         {}\nlogs        {}\nelapsed     {}\n", (out_ / "dataset").string(),
             RunFolder(config_).string(), (out_ / "logs").string(), FormatDuration(since_start_.Seconds()));
  std::fflush(stdout);
}

// Has the run's newest checkpoints for a policy server that is started again when training is over, and for subscribers
// that come then.
void System::StartRelay() {
  if (!bus_.security.empty()) {
    const auto identity = security::ReadIdentityCertificate(Path(bus_.security) / "cert.pem");
    if (identity && !identity->Has(security::Role::kRelay))
      return display_.Say(
          fmt::format("no relay: identity '{}' has not the role relay, so that checkpoints on the bus go with their "
                      "trainer (etude security issue ... --role relay)",
                      identity->name));
  }
  relay_.emplace(participant_, Selector{config_.train.run, run_.id}, relay::RelayOptions{.folder = out_ / "relay"});
}

Status System::Run(bool keep_running) {
  StartRelay();
  const Status done = [&]() -> Status {
    ETUDE_RETURN_IF_ERROR(CollectAndTrain());
    if (StopRequested()) return {};
    return RollOut();
  }();
  if (done && keep_running && !StopRequested()) {
    record_->SetPhase("serve", "until it is stopped");
    PrintWhere();
    display_.Say(fmt::format("policy '{}' serves on domain {}; Ctrl-C ends it", config_.train.run, bus_.domain));
    while (!WaitForStop(200ms)) ETUDE_RETURN_IF_ERROR(Tick());
  }
  if (StopRequested()) display_.Say("draining: what is committed stays, run again to continue");
  Drain();
  relay_.reset();
  if (done && !keep_running) PrintWhere();
  return done;
}

Result<UpConfig> Load(const UpArguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(auto config, LoadConfig<UpConfig>(arguments.file, arguments.overrides));
  if (config.campaign.empty())
    return Fail(Code::kInvalidArgument, fmt::format("{}: campaign: name a campaign file", arguments.file));
  if (!IsPlainName(config.train.run))
    return Fail(Code::kInvalidArgument,
                fmt::format("{}: train.run: '{}' must match [a-z0-9_-]{{1,64}}", arguments.file, config.train.run));
  config.campaign = (Path(arguments.file).parent_path() / config.campaign).lexically_normal().string();
  std::error_code ignored;
  const Path file = arguments.file;
  if (!arguments.out.empty())
    config.out = arguments.out;
  else if (file.filename() == "up.yaml" && std::filesystem::exists(file.parent_path() / "up.json", ignored))
    config.out = std::filesystem::absolute(file, ignored).parent_path().string();  // it may have been moved
  if (arguments.minutes) config.train.minutes = *arguments.minutes;
  if (arguments.workers) config.workers = *arguments.workers;
  if (arguments.domain) config.domain = *arguments.domain;
  if (config.workers < 0 || config.workers > kMostWorkers)
    return Fail(Code::kInvalidArgument,
                fmt::format("{}: workers: {} not in 0..{}", arguments.file, config.workers, kMostWorkers));
  if (config.workers == 0) config.workers = DefaultWorkers();
  return config;
}

// What the rollouts at the end would refuse is said before the hours that come first.
Status CheckEvaluation(const UpConfig& config, const CampaignSpec& collected, const std::string& file) {
  const Status good = EvaluationSpec(collected, UpEvaluation(config, "", 0)).Validate();
  if (!good) return Fail(good.error().Wrap(file + ": eval"));
  return {};
}

// So is what the trainer would: it begins only when enough is collected.
Status CheckTraining(const UpConfig& config, const std::string& file) {
  std::vector<std::string> words = TrainingWords(config, true);
  words.emplace_back("--check");
  const Status good = CheckBySibling("etude-trainer", std::move(words));
  if (good) return {};
  return Fail(good.error().Wrap(fmt::format("{}: train", file)));
}

// And so is what the identities would of those that are started later: one without its own gets this one.
Status CheckIdentities(const BusArguments& bus) {
  if (bus.security.empty()) return {};
  for (const auto role : {security::Role::kWorker, security::Role::kTrainer, security::Role::kPolicy}) {
    const auto opened = security::OpenIdentity(security::IdentityFor(bus.security, role), {role});
    if (!opened)
      return Fail(opened.error().Wrap(fmt::format("what `etude up` starts as {0} takes the identity '{0}' beside '{1}'",
                                                  security::ToString(role), bus.security)));
  }
  return {};
}

// nullopt: it is not wanted, or it cannot be started; then it is said why.
std::optional<DashboardService> StartDashboard(const UpArguments& arguments, const Path& out, const BusArguments& bus) {
  if (arguments.no_dashboard) return std::nullopt;
  auto started = DashboardService::Start({out, arguments.dashboard_port, bus});
  if (started) return std::move(*started);
  fmt::print("no dashboard: {}\n", started.error().message);
  return std::nullopt;
}

Status Up(const UpArguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const UpConfig config, Load(arguments));
  ETUDE_ASSIGN_OR_RETURN(const CampaignSpec spec,
                         campaign::LoadSpec({config.campaign, arguments.episodes, {}, config.campaign_set}));
  ETUDE_RETURN_IF_ERROR(CheckEvaluation(config, spec, arguments.file));
  for (const char* program : {"etude-worker", "etude-trainer", "etude-policy"})
    ETUDE_RETURN_IF_ERROR(campaign::FindSibling(program));
  ETUDE_RETURN_IF_ERROR(CheckTraining(config, arguments.file));
  const BusArguments bus{config.domain, arguments.profile, arguments.log, arguments.security};
  ETUDE_RETURN_IF_ERROR(CheckIdentities(bus));
  ETUDE_RETURN_IF_ERROR(MakeFolders(config.out));
  ETUDE_ASSIGN_OR_RETURN(const FileLock lock,
                         FileLock::Take(Path(config.out) / ".up.lock", fmt::format("'{}' is brought up", config.out)));
  ETUDE_ASSIGN_OR_RETURN(auto participant, bus.Open({security::Role::kCollector, security::Role::kGateway}));
  ETUDE_ASSIGN_OR_RETURN(const auto reporter,
                         bus::ProcessReporter::Start(participant, {.role = "etude up", .folder = config.out}));
  const Path run_folder = RunFolder(config);
  ETUDE_ASSIGN_OR_RETURN(const Identity run, OpenIdentity(run_folder, arguments.claim));
  ETUDE_ASSIGN_OR_RETURN(auto statuses, bus::Reader<bus::TrainStatus>::Open(
                                            participant, bus::Owner{config.train.run, run.id}.partition()));
  const Path out = config.out;
  ETUDE_ASSIGN_OR_RETURN(
      auto record,
      UpRecord::Begin(
          out, config.domain,
          {{"dataset", out / "dataset"}, {"run", run_folder}, {"eval", out / "eval"}, {"logs", out / "logs"}}, ""));
  System system(config, spec, bus, arguments.claim, run, std::move(participant), std::move(statuses), &record,
                StartDashboard(arguments, out, bus));
  const Status done = system.Run(arguments.keep_running);
  record.SetChildren({});
  record.End(done ? kExitOk : ExitCodeFor(done.error()));
  return done;
}

}  // namespace

void AddUp(CLI::App& app, Body& body) {
  auto* command = app.add_subcommand("up", "the whole loop on this machine: collect, train, serve, roll out");
  auto arguments = std::make_shared<UpArguments>();
  command->add_option("config", arguments->file, "what to run (YAML), e.g. deploy/up/quickstart.yaml")->required();
  command->add_option("--episodes", arguments->episodes, "demonstrations, instead of the campaign file's count");
  command->add_option("--minutes", arguments->minutes, "of training");
  command->add_option("--out", arguments->out, "folder for dataset, run, evaluation and logs; resumes what is there");
  command->add_option("--workers", arguments->workers, "local workers")->check(CLI::Range(1, kMostWorkers));
  command->add_flag("--keep-running", arguments->keep_running, "keep the policy server up at the end, until Ctrl-C");
  command->add_flag("--no-dashboard", arguments->no_dashboard, "without the web pages");
  command
      ->add_option("--dashboard-port", arguments->dashboard_port,
                   "where the web pages are, on this machine; 0: any free port")
      ->capture_default_str();
  command->add_option("--domain", arguments->domain, "DDS domain")->check(CLI::Range(0, 230));
  command->add_option("--profile", arguments->profile, "Cyclone DDS XML file");
  BusArguments::AddSecurity(*command, arguments->security);
  BusArguments::AddLog(*command, arguments->log);
  bus::AddClaim(*command, arguments->claim);
  AddOverrides(*command, arguments->overrides, "train.config=paper");
  command->callback([arguments, &body] { body = [arguments] { return Up(*arguments); }; });
}

}  // namespace etude::cli
