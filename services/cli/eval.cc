// SPDX-License-Identifier: Apache-2.0
// `etude eval`: rollouts of a checkpoint, or of a run that is being trained.
#include <fmt/format.h>

#include <optional>
#include <set>

#include "services/bus/directory.h"
#include "services/bus/process_reporter.h"
#include "services/campaign/eval_comparison.h"
#include "services/campaign/eval_report.h"
#include "services/campaign/scene_report.h"
#include "services/campaign/spec_file.h"
#include "services/campaign/suite_report.h"
#include "services/cli/command_line.h"
#include "services/cli/evaluation.h"
#include "services/cli/evaluation_record.h"
#include "services/cli/sentence_suite.h"
#include "services/cli/service.h"
#include "services/cli/training_words.h"
#include "services/core/command_table.h"
#include "services/core/config.h"
#include "services/core/identity.h"
#include "services/core/log.h"
#include "services/core/printable.h"
#include "services/core/progress.h"
#include "services/core/run_name.h"
#include "services/core/stop.h"

namespace etude::cli {
namespace {

struct EvalArguments {
  std::string checkpoint, subscribe, scenes;
  EvaluationOptions evaluation;
  std::string out;
  int workers = DefaultWorkers();
  std::vector<std::string> overrides;
  bool first_draw = false, any_camera = false, as_json = false;
  std::string sentences;  // table8, table11 or a file
  std::uint64_t scenes_each = 3;
  std::string compare;
  BusArguments bus;
  Claim claim = Claim::kRefuse;
};

// Which policy is asked: the run that it serves, and the server to start; none when one is running already.
struct PolicyChoice {
  Selector run;
  std::optional<ServiceOptions> service;
  campaign::EvalSubject subject = {};
};

ServiceOptions ServiceOf(const EvalArguments& arguments, std::vector<std::string> policy_arguments) {
  ServiceOptions service;
  service.program = "etude-policy";
  service.log = arguments.evaluation.out / "logs" / "policy.log";
  service.arguments = std::move(policy_arguments);
  const auto flags = arguments.bus.Flags(security::Role::kPolicy);
  service.arguments.insert(service.arguments.end(), flags.begin(), flags.end());
  service.environment = arguments.bus.Environment();
  return service;
}

// The id of the run whose folder RUN/checkpoints the file lies in; "" where it lies elsewhere.
std::string TrainedAs(const Path& checkpoint) {
  std::error_code error;
  const Path file = std::filesystem::canonical(checkpoint, error);
  if (error || file.parent_path().filename() != "checkpoints") return "";
  const auto identity = ReadIdentity(file.parent_path().parent_path());
  return identity ? identity->id : "";
}

// A server of our own, under an id that only this evaluation knows.
Result<PolicyChoice> ServeCheckpoint(const EvalArguments& arguments) {
  // a run's `latest` is a link that moves while it trains: what is measured is the file that it names now
  std::error_code missing;
  Path file = std::filesystem::canonical(arguments.checkpoint, missing);
  if (missing) file = arguments.checkpoint;
  const auto bytes = ReadBinaryFile(file);
  if (!bytes) return Fail(Code::kInvalidArgument, "--checkpoint: " + bytes.error().message);
  // read here once: a policy server that cannot would be started again and again
  auto facts = FactsOfCheckpoint(*bytes, file);
  if (!facts) return Fail(facts.error().Wrap("read the checkpoint '" + arguments.checkpoint + "'"));
  if (!facts->refused.empty())  // the policy server would refuse every question
    return Fail(Code::kInvalidArgument, fmt::format("--checkpoint '{}' may not drive a robot yet: {}",
                                                    arguments.checkpoint, Printable(facts->refused)));
  const Selector run{"eval-" + facts->subject.sha256.substr(0, 12), NewId()};
  facts->subject.run_id = TrainedAs(file);
  std::vector<std::string> serve{"--checkpoint", file.string(), "--run", run.text()};
  if (arguments.any_camera) serve.emplace_back("--any-camera");
  return PolicyChoice{run, ServiceOf(arguments, std::move(serve)), std::move(facts->subject)};
}

// The run that is meant, and its policy server if one is there: then it is asked, and none of our own.
Result<PolicyChoice> FollowRun(const bus::Participant& participant, const EvalArguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(Selector run, ParseRun(arguments.subscribe, "--subscribe"));
  ETUDE_ASSIGN_OR_RETURN(auto directory, bus::Directory::Open(participant));
  directory.WaitForOthers();  // a server that was not authenticated yet would get a second one beside it
  const auto patience = std::chrono::seconds(1);
  ETUDE_ASSIGN_OR_RETURN(const auto training, directory.FindPublisher(run, patience));
  // what trains and what serves under one name must be one run, or it is not clear which one is meant
  if (training && !IsId(run.id)) run.id = training->id;
  ETUDE_ASSIGN_OR_RETURN(const auto server, directory.Find(bus::PresenceKind::kPolicy, run, patience));
  if (server) {
    ProgressDisplay().Say(
        Printable(fmt::format("asking the policy server of run {}@{} on {}", server->name, server->id, server->host)));
    return PolicyChoice{{run.name, server->id}, std::nullopt};
  }
  if (!training && StopRequested()) return Fail(Code::kTimeout, "stopped");
  if (!training)
    return Fail(Code::kUnavailable,
                fmt::format("--subscribe '{}': neither a run nor a policy server of that name is live on domain {}; "
                            "start one, or evaluate what a run has left: --checkpoint, with its folder or a file",
                            arguments.subscribe, participant.domain()));
  return PolicyChoice{run, ServiceOf(arguments, {"--subscribe", run.text()})};
}

// The campaign whose scenes are used.
Result<CampaignSpec> BaseSpec(const EvalArguments& arguments) {
  if (arguments.scenes.empty()) return CampaignSpec();
  return campaign::LoadSpecOrDataset({arguments.scenes, {}, {}, {}});
}

Result<CampaignSpec> Spec(const CampaignSpec& base, EvalArguments& arguments) {
  EvaluationOptions& evaluation = arguments.evaluation;
  if (!arguments.sentences.empty()) {
    ETUDE_ASSIGN_OR_RETURN(evaluation.sentences, LoadSentences(arguments.sentences));
    evaluation.episodes = arguments.scenes_each * evaluation.sentences.size();
  }
  CampaignSpec spec = EvaluationSpec(base, evaluation);
  if (arguments.first_draw) spec.scenes = "first_draw";
  const std::uint64_t mixed_seed = spec.seed;
  ETUDE_ASSIGN_OR_RETURN(spec, campaign::WithOverrides(std::move(spec), arguments.overrides));
  if (spec.seed != mixed_seed)
    return Fail(Code::kInvalidArgument, "--set seed: say --seed, which never meets a collection's");
  if (arguments.compare.empty()) return spec;
  // said now, not after an hour of rollouts that cannot be paired
  ETUDE_ASSIGN_OR_RETURN(const auto other, campaign::ReadEvaluation(arguments.compare));
  ETUDE_RETURN_IF_ERROR(campaign::CheckSameScenes(spec, other.spec, arguments.compare));
  const OrderedJson now{{"rules", campaign::EvalRules(spec)}};
  ETUDE_RETURN_IF_ERROR(campaign::CheckSameRules(now, other.report, arguments.compare));
  return spec;
}

// OUT against the other evaluation: printed, and OUT/comparison.json.
Status Compare(const EvalArguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const OrderedJson comparison, campaign::CompareEvaluations(arguments.out, arguments.compare));
  const Path file = Path(arguments.out) / "comparison.json";
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(file, JsonText(comparison, 1) + "\n"));
  if (arguments.as_json)
    fmt::print("{}\n", JsonText(comparison, 1));
  else
    fmt::print("{}comparison {}\n", campaign::ComparisonText(comparison), file.string());
  return {};
}

// The words of the training of the policy that is evaluated.
std::optional<std::set<std::string>> WordsOf(const bus::Participant& participant, const EvalArguments& arguments,
                                             const PolicyChoice& choice) {
  if (!arguments.checkpoint.empty()) return TrainingWordsOf(arguments.checkpoint);
  if (!arguments.evaluation.run_folder.empty())
    return TrainingWordsOf((arguments.evaluation.run_folder / "checkpoints" / "latest.safetensors").string());
  return TrainingWords(participant, choice.run.text());
}

Status Report(const bus::Participant& participant, const EvalArguments& arguments, const PolicyChoice& choice,
              const CampaignSpec& base, OrderedJson report) {
  if (report.contains("per_sentence")) {
    // the collector has ended: nobody else writes the file now
    const auto said = WordsOf(participant, arguments, choice);
    const Status added = AddNeverSeen(said, base.tasks, base.objects, report);
    if (!added) Log().warn("which words training never said: {}", added.error().message);
    ETUDE_RETURN_IF_ERROR(WriteFileAtomically(arguments.evaluation.out / "eval.json", JsonText(report, 1) + "\n"));
  }
  if (arguments.as_json) {
    if (arguments.compare.empty()) fmt::print("{}\n", JsonText(report, 1));
    return {};
  }
  fmt::print("{}{}{}{}report {}/eval.json  videos {}/videos\n", campaign::EvalTable(report),
             campaign::SuitesText(report), campaign::SentencesText(report), campaign::ScenesText(report), arguments.out,
             arguments.out);
  return {};
}

// The run that is followed; the evaluation is told of it.
Result<PolicyChoice> Follow(const bus::Participant& participant, EvalArguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(PolicyChoice choice, FollowRun(participant, arguments));
  choice.subject.run = choice.run.name;
  choice.subject.run_id = choice.run.id;
  // a folder of that name may be another run's
  const auto identity = ReadIdentity(arguments.subscribe);
  if (identity && identity->id == choice.run.id) arguments.evaluation.run_folder = arguments.subscribe;
  return choice;
}

Result<OrderedJson> RollOut(const bus::Participant& participant, const CampaignSpec& spec,
                            const EvalArguments& arguments, const PolicyChoice& choice) {
  std::optional<Service> policy;
  if (choice.service) {
    ETUDE_ASSIGN_OR_RETURN(auto started, Service::Start(*choice.service));
    policy.emplace(std::move(started));
  }
  const HostOptions host{.bus = arguments.bus,
                         .workers = arguments.workers,
                         .out = arguments.out,
                         .logs = arguments.evaluation.out / "logs",
                         .claim = arguments.claim,
                         .policy_id = choice.run.id};
  ProgressDisplay display;
  auto report = Evaluate(participant, spec, arguments.evaluation, host, display,
                         [&] { return policy ? policy->Supervise() : Status(); });
  if (policy) policy->Stop(std::chrono::seconds(5));
  return report;
}

Status Eval(EvalArguments arguments) {
  arguments.evaluation.out = arguments.out;
  if (arguments.checkpoint.empty() && arguments.subscribe.empty()) return Compare(arguments);
  // what can be said before anything is read or started
  ETUDE_RETURN_IF_ERROR(CheckOverlay(arguments.evaluation, CampaignSpec()));
  PolicyChoice choice;
  if (!arguments.checkpoint.empty()) {
    ETUDE_ASSIGN_OR_RETURN(choice, ServeCheckpoint(arguments));
  }
  std::vector<security::Role> roles{security::Role::kCollector};
  if (arguments.evaluation.overlay || arguments.evaluation.insight)
    roles.push_back(security::Role::kGateway);  // it asks for insights
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open(roles));
  ETUDE_ASSIGN_OR_RETURN(const auto reporter,
                         bus::ProcessReporter::Start(participant, {.role = "etude eval", .folder = arguments.out}));
  if (arguments.checkpoint.empty()) {
    ETUDE_ASSIGN_OR_RETURN(choice, Follow(participant, arguments));
  }
  arguments.evaluation.run = choice.run.name;
  arguments.evaluation.subject = choice.subject;
  ETUDE_ASSIGN_OR_RETURN(const CampaignSpec base, BaseSpec(arguments));
  ETUDE_ASSIGN_OR_RETURN(const CampaignSpec spec, Spec(base, arguments));
  ETUDE_RETURN_IF_ERROR(CheckOverlay(arguments.evaluation, spec));
  ETUDE_ASSIGN_OR_RETURN(auto report, RollOut(participant, spec, arguments, choice));
  if (StopRequested()) ProgressDisplay().Say("stopped, run again to continue");
  ETUDE_RETURN_IF_ERROR(Report(participant, arguments, choice, base, std::move(report)));
  return arguments.compare.empty() ? Status() : Compare(arguments);
}

}  // namespace

namespace {

// Which scenes, and what is said in them.
void AddScenes(CLI::App& command, EvalArguments& arguments) {
  EvaluationOptions& evaluation = arguments.evaluation;
  auto* episodes = command.add_option("--episodes", evaluation.episodes, "rollouts")->capture_default_str();
  command.add_option("--seed", evaluation.seed, "of the scenes; never meets a collection's")->capture_default_str();
  auto* tasks = command.add_option("--tasks", evaluation.tasks,
                                   "comma-separated; left out: those of --scenes, else pick,push,put_down");
  tasks->delimiter(',')->allow_extra_args(false);
  command.add_option(
      "--scenes", arguments.scenes,
      "campaign file, or a dataset's folder, whose robots, tasks, camera, objects and randomisation to use");
  command.add_flag("--first-draw", arguments.first_draw,
                   "take scenes as they are drawn; those in which the expert cannot do the task are counted, shown "
                   "and left out of n");
  auto* sentences =
      command.add_option("--sentences", arguments.sentences,
                         "say these, each in scenes of what it means: table8 | table11 (the paper's, which training "
                         "never says) | a file with a line 'TASK OBJECT [REFERENCE]: SENTENCE' each");
  sentences->excludes(tasks)->excludes(episodes);
  command.add_option("--scenes-each", arguments.scenes_each, "scenes in which each of --sentences is said")
      ->check(CLI::Range(1, 1000))
      ->needs(sentences)
      ->capture_default_str();
}

// What makes it harder.
void AddHardships(CLI::App& command, EvaluationOptions& evaluation) {
  command
      .add_option(
          "--occlude", evaluation.occlude,
          "share of the target's pixels under grey blocks, in every picture (the paper's: 0.2, 0.42, 0.68, 0.8)")
      ->check(CLI::Range(0.0, 1.0));
  command
      .add_option("--pushes", evaluation.pushes,
                  "times that the target is slid 3 to 6 cm away before the robot has touched it (more: --set "
                  "rollout.pushes.KEY=VALUE)")
      ->check(CLI::Range(0, 10));
}

// What is there to look at afterwards.
void AddVideos(CLI::App& command, EvaluationOptions& evaluation) {
  command.add_option("--videos", evaluation.videos, "at most so many mp4 files")->capture_default_str();
  command.add_flag("--overlay", evaluation.overlay,
                   "draw into the videos what the policy saw and said: where its modules look, pixels, the object "
                   "that it names, displacement and planned waypoints, and the judge's state");
  command.add_flag("--insight", evaluation.insight,
                   "keep what every module said and attended to at each decision, in OUT/insights: the page Inside "
                   "walks through it when nobody serves the policy any more");
}

}  // namespace

void AddEval(CLI::App& app, Body& body) {
  auto* command = app.add_subcommand("eval", "roll a policy out on fresh scenes: success per task, errors, videos");
  auto arguments = std::make_shared<EvalArguments>();
  auto* checkpoint =
      command->add_option("--checkpoint", arguments->checkpoint, "a .safetensors file, or a run's folder: its newest")
          ->transform(CheckpointFile);
  auto* subscribe = command->add_option("--subscribe", arguments->subscribe,
                                        "a run's checkpoints on the bus: NAME, NAME@ID, or its folder");
  checkpoint->excludes(subscribe);
  command
      ->add_flag("--any-camera", arguments->any_camera,
                 "show it pictures of another camera than it was trained with, too, which else it refuses")
      ->needs(checkpoint);
  command->add_option("--workers", arguments->workers, "local workers")
      ->check(CLI::Range(0, kMostWorkers))
      ->capture_default_str();
  command->add_option("--out", arguments->out, "folder for eval.json, rollouts and videos")
      ->required()
      ->check(NamesAPlace());
  AddVideos(*command, arguments->evaluation);
  AddScenes(*command, *arguments);
  AddHardships(*command, arguments->evaluation);
  command->add_option("--compare", arguments->compare,
                      "folder of another evaluation of the same scenes: then who succeeded where, and whether it can "
                      "be chance; without a policy OUT is one, too");
  command->add_flag("--json", arguments->as_json, "print what eval.json says, or with --compare comparison.json");
  AddOverrides(*command, arguments->overrides, "rollout.replan_steps=10");
  bus::AddClaim(*command, arguments->claim);
  arguments->bus.Add(*command);
  command->callback([arguments, command, &body] {
    if (arguments->checkpoint.empty() && arguments->subscribe.empty() && arguments->compare.empty())
      throw CLI::RequiredError("--checkpoint or --subscribe");
    if (arguments->evaluation.overlay && arguments->checkpoint.empty() && arguments->subscribe.empty())
      throw CLI::RequiredError("--overlay asks the policy: --checkpoint or --subscribe");
    if (arguments->evaluation.insight && arguments->checkpoint.empty() && arguments->subscribe.empty())
      throw CLI::RequiredError("--insight asks the policy: --checkpoint or --subscribe");
    body = [arguments] { return Eval(*arguments); };
  });
}

}  // namespace etude::cli
