// SPDX-License-Identifier: Apache-2.0
// `etude eval`: rollouts of a checkpoint, or of a run that is being trained.
#include <fmt/format.h>

#include <optional>

#include "services/bus/topic.h"
#include "services/campaign/eval_report.h"
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
  BusArguments bus;
};

// Which policy is asked, and under which name it answers.
Result<ServiceOptions> PolicyService(Arguments& arguments) {
  ServiceOptions service;
  service.program = "etude-policy";
  service.log = arguments.evaluation.out / "logs" / "policy.log";
  if (!arguments.checkpoint.empty()) {
    const auto bytes = ReadBinaryFile(arguments.checkpoint);
    if (!bytes) return Fail(Code::kInvalidArgument, "--checkpoint: " + bytes.error().message);
    // read here once: a policy server that cannot would be started again and again
    if (const auto content = store::DecodeSafetensors(*bytes); !content)
      return Fail(content.error().Wrap("read the checkpoint '" + arguments.checkpoint + "'"));
    arguments.evaluation.run = "eval-" + Sha256Hex(*bytes).substr(0, 12);
    service.arguments = {"--checkpoint", arguments.checkpoint, "--run", arguments.evaluation.run};
  } else {
    // a run's name, or its folder
    arguments.evaluation.run = Path(arguments.subscribe).filename().string();
    if (!IsPlainName(arguments.evaluation.run))
      return Fail(Code::kInvalidArgument,
                  fmt::format("--subscribe '{}': the name of a run, or its folder", arguments.subscribe));
    service.arguments = {"--subscribe", arguments.subscribe};
  }
  const auto flags = arguments.bus.Flags();
  service.arguments.insert(service.arguments.end(), flags.begin(), flags.end());
  service.environment = arguments.bus.Environment();
  return service;
}

// True when a policy server answers for this run already: then it is asked, and none of our own.
Result<bool> AlreadyServed(const bus::Participant& participant, const std::string& run) {
  ETUDE_ASSIGN_OR_RETURN(const auto observations, bus::Writer<bus::Observation>::Open(participant, run));
  return observations.WaitForReaders(1, std::chrono::milliseconds(500));
}

Result<CampaignSpec> Spec(const Arguments& arguments) {
  CampaignSpec base;
  if (!arguments.scenes.empty()) {
    ETUDE_ASSIGN_OR_RETURN(base, campaign::LoadSpec({arguments.scenes, {}, {}, {}}));
  }
  OrderedJson json = ToJson(EvaluationSpec(base, arguments.evaluation));
  for (const auto& text : arguments.overrides) ETUDE_RETURN_IF_ERROR(ApplyOverride(json, text));
  ETUDE_ASSIGN_OR_RETURN(const auto spec, FromJson<CampaignSpec>(json, "--set"));
  ETUDE_RETURN_IF_ERROR(spec.Validate());
  return spec;
}

Status Eval(Arguments arguments) {
  arguments.evaluation.out = arguments.out;
  ETUDE_ASSIGN_OR_RETURN(const ServiceOptions service, PolicyService(arguments));
  ETUDE_ASSIGN_OR_RETURN(const CampaignSpec spec, Spec(arguments));
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open());
  std::optional<Service> policy;
  ETUDE_ASSIGN_OR_RETURN(const bool served, AlreadyServed(participant, spec.rollout.run));
  if (served) {
    fmt::print(stderr, "asking the policy server of run '{}' that is running\n", spec.rollout.run);
  } else {
    ETUDE_ASSIGN_OR_RETURN(auto started, Service::Start(service));
    policy.emplace(std::move(started));
  }
  const HostOptions host{.bus = arguments.bus,
                         .workers = arguments.workers,
                         .out = arguments.out,
                         .logs = arguments.evaluation.out / "logs"};
  OrderedJson report;
  {
    ProgressDisplay display;
    ETUDE_ASSIGN_OR_RETURN(report, Evaluate(participant, spec, arguments.evaluation, host, display,
                                            [&] { return policy ? policy->Supervise() : Status(); }));
  }
  if (policy) policy->Stop(std::chrono::seconds(5));
  if (StopRequested()) fmt::print("stopped, run again to continue\n");
  fmt::print("{}report {}/eval.json  videos {}/videos\n", campaign::EvalTable(report), arguments.out, arguments.out);
  return {};
}

}  // namespace

void AddEval(CLI::App& app, Body& body) {
  auto* command = app.add_subcommand("eval", "roll a policy out on fresh scenes: success per task, errors, videos");
  auto arguments = std::make_shared<Arguments>();
  auto* checkpoint = command->add_option("--checkpoint", arguments->checkpoint, "a .safetensors file");
  auto* subscribe = command->add_option("--subscribe", arguments->subscribe,
                                        "a run's checkpoints on the bus: its name, or its folder");
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
  AddOverrides(*command, arguments->overrides, "rollout.replan_steps=10");
  arguments->bus.Add(*command);
  command->callback([arguments, command, &body] {
    if (arguments->checkpoint.empty() && arguments->subscribe.empty())
      throw CLI::RequiredError("--checkpoint or --subscribe");
    body = [arguments] { return Eval(*arguments); };
  });
}

}  // namespace etude::cli
