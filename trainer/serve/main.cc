// SPDX-License-Identifier: Apache-2.0
// etude-policy: serves checkpoints. See trainer/serve/README.md.
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <iostream>
#include <thread>

#include "services/bus/arguments.h"
#include "services/bus/process_reporter.h"
#include "services/core/command.h"
#include "services/core/command_table.h"
#include "services/core/enum_name.h"
#include "services/core/identity.h"
#include "services/core/log.h"
#include "services/core/printable.h"
#include "services/core/run_name.h"
#include "services/core/service_manager.h"
#include "services/relay/relay_thread.h"
#include "trainer/checkpoint/difference.h"
#include "trainer/checkpoint/graph_picture.h"
#include "trainer/checkpoint/names.h"
#include "trainer/checkpoint/torchscript.h"
#include "trainer/policy/device.h"
#include "trainer/policy/policy_file.h"
#include "trainer/policy/torch_process.h"
#include "trainer/serve/robots.h"
#include "trainer/serve/server.h"
#include "trainer/serve/watch.h"

namespace etude::serve {
namespace {

struct Arguments {
  std::string subscribe, checkpoint, run, channel = "latest", clip, device = "cpu";
  bus::Arguments bus;
  security::VerifyArguments verify;
  RobotDomain robots;
  std::string relay;
  int threads = 1;
  bool any_camera = false;
};

// A checkpoint's file is served under an id of its own, unless one is given.
Result<Selector> RunOfFile(const Arguments& arguments, const Model& model) {
  ETUDE_ASSIGN_OR_RETURN(Selector run, arguments.run.empty()
                                           ? ParseSelector(model.metadata().run, "the checkpoint's run")
                                           : ParseRun(arguments.run, "--run"));
  if (run.id.empty()) run.id = NewId();
  return run;
}

std::vector<security::Role> RolesOf(const Arguments& arguments) {
  std::vector<security::Role> roles{security::Role::kPolicy};
  if (!arguments.relay.empty()) roles.push_back(security::Role::kRelay);
  return roles;
}

// None without --relay. It judges checkpoints on a thread of its own, with a verifier of its own.
Result<std::unique_ptr<relay::RelayThread>> StartRelay(const bus::Participant& participant, const Arguments& arguments,
                                                       const Selector& run) {
  if (arguments.relay.empty()) return std::unique_ptr<relay::RelayThread>();
  ETUDE_ASSIGN_OR_RETURN(auto verifier, arguments.verify.Open());
  const relay::RelayOptions options{.folder = arguments.relay, .accept = bus::AcceptSigned(std::move(verifier))};
  return std::make_unique<relay::RelayThread>(participant, run, options);
}

// A file's checkpoints are nobody's on the bus.
RunDomain RunDomainOf(const Arguments& arguments) {
  const bool verifies = !arguments.verify.key.empty() || !arguments.checkpoint.empty();
  return {.domain = arguments.bus.domain, .security = arguments.bus.security, .verifies = verifies};
}

Status CheckServing(const Arguments& arguments) {
  if (arguments.subscribe.empty() == arguments.checkpoint.empty())
    return Fail(Code::kInvalidArgument, "give either --subscribe RUN or --checkpoint FILE (see --help)");
  if (!arguments.verify.key.empty() && arguments.subscribe.empty())
    return Fail(Code::kInvalidArgument, "--verify is of published checkpoints: it needs --subscribe RUN");
  if (!arguments.relay.empty() && arguments.subscribe.empty())
    return Fail(Code::kInvalidArgument, "--relay is of published checkpoints: it needs --subscribe RUN");
  if (!arguments.run.empty() && arguments.checkpoint.empty())
    return Fail(Code::kInvalidArgument,
                "--run names what a --checkpoint is served as: with --subscribe the run has its name");
  return CheckRobotDomain(arguments.robots, RunDomainOf(arguments));
}

Status Serve(const Arguments& arguments) {
  ETUDE_RETURN_IF_ERROR(CheckServing(arguments));
  policy::SetTorchThreads(1);
  ETUDE_ASSIGN_OR_RETURN(const auto device, policy::OpenDevice(arguments.device));
  ETUDE_ASSIGN_OR_RETURN(auto verifier, arguments.verify.Open());
  std::shared_ptr<const Model> model;
  ServerOptions options{.channel = arguments.channel,
                        .threads = std::max(1, arguments.threads),
                        .device = device,
                        .clip_folders = std::make_shared<clip::Folders>(arguments.clip)};
  options.accept = bus::AcceptSigned(std::move(verifier));
  if (arguments.checkpoint.empty()) {
    ETUDE_ASSIGN_OR_RETURN(options.run, ParseRun(arguments.subscribe, "--subscribe"));
    // what is wrong with its folder the relay says; it keeps nobody from serving
    if (!arguments.relay.empty()) options.before = relay::KeptRun(arguments.relay).value_or(std::nullopt);
  } else {
    ETUDE_ASSIGN_OR_RETURN(model, Model::FromFile(arguments.checkpoint, options.clip_folders.get(), device,
                                                  arguments.any_camera ? Cameras::kAny : Cameras::kTrained));
    ETUDE_ASSIGN_OR_RETURN(options.run, RunOfFile(arguments, *model));
    options.folder = std::filesystem::absolute(arguments.checkpoint).string();
  }
  bus::ParticipantConfig config = arguments.bus.Config(RolesOf(arguments));
  config.joins_another = arguments.robots.domain.has_value();
  ETUDE_ASSIGN_OR_RETURN(const auto participant, bus::Participant::Open(config));
  ETUDE_ASSIGN_OR_RETURN(const auto robots, JoinRobotDomain(arguments.robots, arguments.bus.profile));
  if (robots) options.robots = &*robots;
  ETUDE_ASSIGN_OR_RETURN(const auto reporter, bus::ProcessReporter::Start(participant, {.role = "policy"}));
  ETUDE_ASSIGN_OR_RETURN(const auto relay, StartRelay(participant, arguments, options.run));
  ETUDE_ASSIGN_OR_RETURN(auto server, PolicyServer::Open(participant, options, model));
  if (model)
    Log().info("serving run={} step={} from '{}'", options.run.text(), model->metadata().step, arguments.checkpoint);
  else
    ETUDE_RETURN_IF_ERROR(server.Follow());
  ServiceManager::Get().Ready(fmt::format("run {}", options.run.text()));
  const Status status = server.Run();
  Log().info("answered {} observations: {}", server.answered(), ToString(server.latency()));
  return status;
}

void AddRobots(CLI::App& app, RobotDomain& robots) {
  auto* domain = app.add_option("--robot-domain", robots.domain,
                                "answer in this DDS domain, too: robots in it do not meet workers and trainers")
                     ->check(CLI::Range(0, 230));
  app.add_option("--robot-profile", robots.profile, "Cyclone DDS XML file for that domain (default: as for --profile)")
      ->needs(domain);
  app.add_option("--robot-security", robots.security,
                 "who this is among robots: DIR/NAME of an authority of their own, role policy")
      ->needs(domain);
}

// A checkpoint's file, or a policy's, by path or by name.
Result<checkpoint::Metadata> ReadGraph(const std::string& text) {
  if (Path(text).extension() == ".safetensors") {
    ETUDE_ASSIGN_OR_RETURN(auto read, checkpoint::ReadFile(text));
    return std::move(read.metadata);
  }
  ETUDE_ASSIGN_OR_RETURN(const Path experiments, policy::FindExperiments());
  ETUDE_ASSIGN_OR_RETURN(const auto json, policy::ReadPolicyMap(text, {experiments / "policies"}));
  checkpoint::Metadata metadata;
  ETUDE_ASSIGN_OR_RETURN(metadata.policy, FromJson<policy::PolicyConfig>(json, text));
  ETUDE_RETURN_IF_ERROR(metadata.policy.Validate());
  return metadata;
}

Status DrawGraph(const std::string& text, const std::string& svg) {
  ETUDE_ASSIGN_OR_RETURN(const auto metadata, ReadGraph(text));
  if (svg.empty()) {
    fmt::print("{}", PrintableLines(checkpoint::GraphText(metadata)));
    return {};
  }
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(svg, checkpoint::GraphSvg(metadata)));
  fmt::print("{}\n", svg);
  return {};
}

// [{part, state, relative, numbers, tensors}]; `relative` only of what changed.
OrderedJson DifferenceJson(const std::vector<checkpoint::PartDifference>& differences) {
  using State = checkpoint::PartDifference::State;
  OrderedJson list = OrderedJson::array();
  for (const auto& part : differences) {
    const auto state = EnumName(part.state, {{State::kSame, "same"},
                                             {State::kChanged, "changed"},
                                             {State::kReshaped, "reshaped"},
                                             {State::kOnlyInFirst, "only in the first"},
                                             {State::kOnlyInSecond, "only in the second"}});
    list.push_back({{"part", part.part}, {"state", state}, {"numbers", part.numbers}, {"tensors", part.tensors}});
    if (part.state == State::kChanged) list.back()["relative"] = part.relative;
  }
  return list;
}

Status ShowDifference(const std::string& first, const std::string& second, bool as_json) {
  ETUDE_ASSIGN_OR_RETURN(const auto a, checkpoint::ReadFile(first));
  ETUDE_ASSIGN_OR_RETURN(const auto b, checkpoint::ReadFile(second));
  const auto differences = checkpoint::Compare(a, b);
  fmt::print("{}",
             as_json ? DifferenceJson(differences).dump(1) + "\n" : PrintableLines(checkpoint::ToText(differences)));
  return {};
}

Status ExportTorchScript(const std::string& file, const std::string& out) {
  ETUDE_ASSIGN_OR_RETURN(const auto checkpoint, checkpoint::ReadFile(file));
  ETUDE_ASSIGN_OR_RETURN(const std::string bytes, checkpoint::ToTorchScript(checkpoint));
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(out, bytes));
  fmt::print("{}: {} bytes; forward({}) -> waypoints\n", out, bytes.size(),
             fmt::join(checkpoint::InputNames(checkpoint.metadata.policy), ", "));
  return {};
}

/// What the command line asks for besides serving.
struct Looking {
  CLI::App *graph = nullptr, *difference = nullptr, *torchscript = nullptr, *watch = nullptr;
  std::string file, svg, first, second, run, out;
  bool as_json = false;
  WatchOptions watching;
  bus::Arguments bus;

  void Add(CLI::App& app) {
    graph = app.add_subcommand("graph", "draw a policy's modules: who reads what, is supervised where, says what");
    graph->add_option("policy", file, "a checkpoint or a run's folder, a policy's file, or a name: compact/obstacle")
        ->required()
        ->transform(CheckpointFile);
    graph->add_option("--svg", svg, "write a drawing to this file instead of text");
    difference = app.add_subcommand("diff", "which parts changed from one checkpoint to another, and by how much");
    difference->add_option("first", first, "checkpoint file, or a run's folder")->required()->transform(CheckpointFile);
    difference->add_option("second", second, "checkpoint file, or a run's folder")
        ->required()
        ->transform(CheckpointFile);
    difference->add_flag("--json", as_json, "as JSON");
    torchscript = app.add_subcommand("torchscript", "a checkpoint as a file that plain libtorch opens");
    torchscript->add_option("checkpoint", file, "checkpoint file, or a run's folder")
        ->required()
        ->transform(CheckpointFile);
    torchscript->add_option("out", out, "the file to write, .pt")->required();
    AddWatch(app);
  }

  void AddWatch(CLI::App& app) {
    watch = app.add_subcommand("watch", "what the modules of a policy say while it drives, and what they would say");
    watch->add_option("--run", run, "the run that is served: NAME, NAME@ID, or its folder")->required();
    watch->add_option("--session", watching.session, "whose observations (default: anybody's)");
    watch->add_option("--sentence", watching.sentence, "what if this had been said?");
    watch->add_option("--hide", watching.hide, "what if this part of the picture were grey? U,V,WIDTH,HEIGHT, px")
        ->allow_extra_args(false);
    watch
        ->add_option("--look-away", watching.look_away,
                     "what if no module attended to this part of the picture? U,V,WIDTH,HEIGHT, px")
        ->allow_extra_args(false);
    watch->add_option("--say", watching.say, "what if a module said something else? TAR3D.position=[0.1,0.3,0.04]")
        ->allow_extra_args(false);
    watch->add_option("--think", watching.think, "what if its register were of another sentence? TAR2D='push the coke'")
        ->allow_extra_args(false);
    watch->add_flag("--worth", watching.worth, "how far the waypoints move without each word and joint");
    watch->add_option("--count", watching.count, "so many answers, then end");
    watch->add_flag("--json", watching.as_json, "a line of JSON each");
    bus.Add(*watch);
  }

  Status Watch() {
    ETUDE_ASSIGN_OR_RETURN(watching.run, ParseRun(run, "--run"));
    ETUDE_ASSIGN_OR_RETURN(const auto participant, bus.Open({security::Role::kGateway}));
    return serve::Watch(participant, watching);
  }
};

}  // namespace
}  // namespace etude::serve

int main(int argc, char** argv) {
  etude::policy::PrepareTorchProcess(argv);
  etude::serve::Arguments arguments;
  CLI::App app{
      "Answers observations of a run with actions and with what every module thinks.\n"
      "With --subscribe it takes over each new checkpoint of the run; one that does not fit is "
      "refused and the last "
      "good one serves on."};
  auto* subscribe = app.add_option("--subscribe", arguments.subscribe,
                                   "run whose checkpoints to follow: NAME, NAME@ID, or its folder");
  auto* checkpoint = app.add_option("--checkpoint", arguments.checkpoint,
                                    "one checkpoint file (.safetensors) instead, or a run's folder: its newest")
                         ->transform(etude::CheckpointFile);
  app.add_flag("--any-camera", arguments.any_camera,
               "answer for pictures of another camera than it was trained with, too, which else are refused")
      ->needs(checkpoint);
  app.add_option("--run", arguments.run, "with --checkpoint: serve as NAME or NAME@ID (default: the checkpoint's run)");
  app.add_option("--channel", arguments.channel, "with --subscribe: latest or best")
      ->needs(subscribe)
      ->check(CLI::IsMember({"latest", "best"}))
      ->capture_default_str();
  app.add_option("--clip", arguments.clip,
                 "folder of CLIP's files, in place of the one that a policy with language clip:DIR names")
      ->envname("ETUDE_CLIP");
  arguments.bus.Add(app);
  etude::bus::AddVerify(app, arguments.verify);
  app.add_option("--relay", arguments.relay,
                 "with --subscribe: folder in which the run's newest checkpoints are kept, to publish them when it has "
                 "ended");
  etude::serve::AddRobots(app, arguments.robots);
  app.add_option("--threads", arguments.threads, "observations evaluated side by side")->capture_default_str();
  app.add_option("--device", arguments.device, "where they are: cpu, cuda or cuda:NUMBER")->capture_default_str();
  etude::serve::Looking looking;
  looking.Add(app);
  if (const auto ended = etude::ParseCommandLine(app, argc, argv)) return *ended;
  return etude::RunMain("etude-policy", [&] {
    if (looking.graph->parsed()) return etude::serve::DrawGraph(looking.file, looking.svg);
    if (looking.watch->parsed()) return looking.Watch();
    if (looking.torchscript->parsed()) return etude::serve::ExportTorchScript(looking.file, looking.out);
    if (looking.difference->parsed())
      return etude::serve::ShowDifference(looking.first, looking.second, looking.as_json);
    return etude::serve::Serve(arguments);
  });
}
