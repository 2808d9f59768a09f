// SPDX-License-Identifier: Apache-2.0
// `etude eval`: rollouts of a checkpoint, or of a run that is being trained.
#include <fmt/format.h>

#include <optional>

#include "services/bus/directory.h"
#include "services/campaign/eval_report.h"
#include "services/campaign/scene_report.h"
#include "services/campaign/spec_file.h"
#include "services/cli/command_line.h"
#include "services/cli/evaluation.h"
#include "services/cli/service.h"
#include "services/core/hash.h"
#include "services/core/stop.h"
#include "services/store/safetensors.h"

namespace etude::cli {
namespace {

struct Arguments {
  std::string checkpoint, subscribe, scenes;
  EvaluationOptions evaluation;
  std::string out;
  int workers = DefaultWorkers();
  std::vector<std::string> overrides;
  bool first_draw = false;
  BusArguments bus;
  Claim claim = Claim::kRefuse;
};

// Which policy is asked: the run that it serves, and the server to start; none when one is running already.
struct PolicyChoice {
  Selector run;
  std::optional<ServiceOptions> service;
};

ServiceOptions ServiceOf(const Arguments& arguments, std::vector<std::string> policy_arguments) {
  ServiceOptions service;
  service.program = "etude-policy";
  service.log = arguments.evaluation.out / "logs" / "policy.log";
  service.arguments = std::move(policy_arguments);
  const auto flags = arguments.bus.Flags();
  service.arguments.insert(service.arguments.end(), flags.begin(), flags.end());
  service.environment = arguments.bus.Environment();
  return service;
}

// A server of our own, under an id that only this evaluation knows.
Result<PolicyChoice> ServeCheckpoint(const Arguments& arguments) {
  const auto bytes = ReadBinaryFile(arguments.checkpoint);
  if (!bytes) return Fail(Code::kInvalidArgument, "--checkpoint: " + bytes.error().message);
  // read here once: a policy server that cannot would be started again and again
  if (const auto content = store::DecodeSafetensors(*bytes); !content)
    return Fail(content.error().Wrap("read the checkpoint '" + arguments.checkpoint + "'"));
  const Selector run{"eval-" + Sha256Hex(*bytes).substr(0, 12), NewId()};
  return PolicyChoice{run, ServiceOf(arguments, {"--checkpoint", arguments.checkpoint, "--run", run.text()})};
}

// A run's name, NAME@ID, or its folder.
Result<Selector> RunOf(const std::string& text) {
  const auto selector = ParseSelector(text, "--subscribe");
  if (selector || !std::filesystem::is_directory(text)) return selector;
  ETUDE_ASSIGN_OR_RETURN(const Identity identity, ReadIdentity(text));
  return Selector{Path(text).lexically_normal().filename().string(), identity.id};
}

// The run that is meant, and its policy server if one is there: then it is asked, and none of our own.
Result<PolicyChoice> FollowRun(const bus::Participant& participant, const Arguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(Selector run, RunOf(arguments.subscribe));
  ETUDE_ASSIGN_OR_RETURN(auto directory, bus::Directory::Open(participant));
  const auto patience = std::chrono::seconds(1);
  ETUDE_ASSIGN_OR_RETURN(const auto training, directory.Find(bus::PresenceKind::kRun, run, patience));
  // what trains and what serves under one name must be one run, or it is not clear which one is meant
  if (training && !IsId(run.id)) run.id = training->id;
  ETUDE_ASSIGN_OR_RETURN(const auto server, directory.Find(bus::PresenceKind::kPolicy, run, patience));
  if (server) {
    fmt::print(stderr, "asking the policy server of run {}@{} on {}\n", server->name, server->id, server->host);
    return PolicyChoice{{run.name, server->id}, std::nullopt};
  }
  if (!IsId(run.id))
    return Fail(Code::kUnavailable,
                fmt::format("--subscribe '{}': neither a run nor a policy server of that name is live on domain {}; "
                            "start one, or give the run's folder or a --checkpoint",
                            arguments.subscribe, participant.domain()));
  return PolicyChoice{run, ServiceOf(arguments, {"--subscribe", run.text()})};
}

Result<CampaignSpec> Spec(const Arguments& arguments) {
  CampaignSpec base;
  if (!arguments.scenes.empty()) {
    ETUDE_ASSIGN_OR_RETURN(base, campaign::LoadSpec({arguments.scenes, {}, {}, {}}));
  }
  CampaignSpec spec = EvaluationSpec(base, arguments.evaluation);
  if (arguments.first_draw) spec.scenes = "first_draw";
  return campaign::WithOverrides(std::move(spec), arguments.overrides);
}

Status Eval(Arguments arguments) {
  arguments.evaluation.out = arguments.out;
  PolicyChoice choice;
  if (!arguments.checkpoint.empty()) {
    ETUDE_ASSIGN_OR_RETURN(choice, ServeCheckpoint(arguments));
  }
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open());
  if (arguments.checkpoint.empty()) {
    ETUDE_ASSIGN_OR_RETURN(choice, FollowRun(participant, arguments));
  }
  arguments.evaluation.run = choice.run.name;
  ETUDE_ASSIGN_OR_RETURN(const CampaignSpec spec, Spec(arguments));
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
  OrderedJson report;
  {
    ProgressDisplay display;
    ETUDE_ASSIGN_OR_RETURN(report, Evaluate(participant, spec, arguments.evaluation, host, display,
                                            [&] { return policy ? policy->Supervise() : Status(); }));
  }
  if (policy) policy->Stop(std::chrono::seconds(5));
  if (StopRequested()) fmt::print("stopped, run again to continue\n");
  fmt::print("{}{}report {}/eval.json  videos {}/videos\n", campaign::EvalTable(report), campaign::ScenesText(report),
             arguments.out, arguments.out);
  return {};
}

}  // namespace

void AddEval(CLI::App& app, Body& body) {
  auto* command = app.add_subcommand("eval", "roll a policy out on fresh scenes: success per task, errors, videos");
  auto arguments = std::make_shared<Arguments>();
  auto* checkpoint = command->add_option("--checkpoint", arguments->checkpoint, "a .safetensors file");
  auto* subscribe = command->add_option("--subscribe", arguments->subscribe,
                                        "a run's checkpoints on the bus: NAME, NAME@ID, or its folder");
  checkpoint->excludes(subscribe);
  EvaluationOptions& evaluation = arguments->evaluation;
  command->add_option("--episodes", evaluation.episodes, "rollouts")->capture_default_str();
  command->add_option("--seed", evaluation.seed, "of the scenes; never meets a collection's")->capture_default_str();
  command->add_option("--workers", arguments->workers, "local workers")
      ->check(CLI::Range(0, 100))
      ->capture_default_str();
  command->add_option("--out", arguments->out, "folder for eval.json, rollouts and videos")->required();
  command
      ->add_option("--tasks", evaluation.tasks, "comma-separated; left out: those of --scenes, else pick,push,put_down")
      ->delimiter(',')
      ->allow_extra_args(false);
  command->add_option("--videos", evaluation.videos, "at most so many mp4 files")->capture_default_str();
  command->add_option("--scenes", arguments->scenes,
                      "campaign file whose robots, tasks, camera, objects and randomisation to use");
  command->add_flag("--first-draw", arguments->first_draw,
                    "take scenes as they are drawn; those in which the expert cannot do the task are counted, shown "
                    "and left out of n");
  AddOverrides(*command, arguments->overrides, "rollout.replan_steps=10");
  bus::AddClaim(*command, arguments->claim);
  arguments->bus.Add(*command);
  command->callback([arguments, command, &body] {
    if (arguments->checkpoint.empty() && arguments->subscribe.empty())
      throw CLI::RequiredError("--checkpoint or --subscribe");
    body = [arguments] { return Eval(*arguments); };
  });
}

}  // namespace etude::cli
