// SPDX-License-Identifier: Apache-2.0
// etude-policy: serves checkpoints. See trainer/serve/README.md.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <iostream>
#include <thread>

#include "services/bus/arguments.h"
#include "services/core/command.h"
#include "services/core/identity.h"
#include "services/core/log.h"
#include "trainer/checkpoint/names.h"
#include "trainer/policy/torch_process.h"
#include "trainer/serve/server.h"

namespace etude::serve {
namespace {

struct Arguments {
  std::string subscribe, checkpoint, run, channel = "latest";
  bus::Arguments bus;
  int threads = 1;
};

// NAME, NAME@ID, or the run's folder, which knows its id.
Result<Selector> RunOf(const std::string& text, const char* flag) {
  auto selector = ParseSelector(text, flag);
  if (selector || !std::filesystem::is_directory(text)) return selector;
  ETUDE_ASSIGN_OR_RETURN(const Identity identity, ReadIdentity(text));
  return Selector{checkpoint::RunNameOf(text), identity.id};
}

// A checkpoint's file is served under an id of its own, unless one is given.
Result<Selector> RunOfFile(const Arguments& arguments, const Model& model) {
  const std::string text = arguments.run.empty() ? model.metadata().run : arguments.run;
  ETUDE_ASSIGN_OR_RETURN(Selector run, RunOf(text, "--run"));
  if (run.id.empty()) run.id = NewId();
  return run;
}

Status Serve(const Arguments& arguments) {
  if (arguments.subscribe.empty() == arguments.checkpoint.empty())
    return Fail(Code::kInvalidArgument, "give either --subscribe RUN or --checkpoint FILE (see --help)");
  policy::SetTorchThreads(1);
  std::shared_ptr<const Model> model;
  ServerOptions options{.channel = arguments.channel, .threads = std::max(1, arguments.threads)};
  if (arguments.checkpoint.empty()) {
    ETUDE_ASSIGN_OR_RETURN(options.run, RunOf(arguments.subscribe, "--subscribe"));
  } else {
    ETUDE_ASSIGN_OR_RETURN(model, Model::FromFile(arguments.checkpoint));
    ETUDE_ASSIGN_OR_RETURN(options.run, RunOfFile(arguments, *model));
    options.folder = arguments.checkpoint;
  }
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open());
  ETUDE_ASSIGN_OR_RETURN(auto server, PolicyServer::Open(participant, options, model));
  if (model)
    Log().info("serving run={} step={} from '{}'", options.run.text(), model->metadata().step, arguments.checkpoint);
  else
    ETUDE_RETURN_IF_ERROR(server.Follow());
  const Status status = server.Run();
  Log().info("answered {} observations: {}", server.answered(), ToString(server.latency()));
  return status;
}

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
  app.add_option("--subscribe", arguments.subscribe, "run whose checkpoints to follow: NAME, NAME@ID, or its folder");
  app.add_option("--checkpoint", arguments.checkpoint, "one checkpoint file (.safetensors) instead");
  app.add_option("--run", arguments.run, "with --checkpoint: serve as NAME or NAME@ID (default: the checkpoint's run)");
  app.add_option("--channel", arguments.channel, "with --subscribe: latest or best")
      ->check(CLI::IsMember({"latest", "best"}))
      ->capture_default_str();
  arguments.bus.Add(app);
  app.add_option("--threads", arguments.threads, "observations evaluated side by side")->capture_default_str();
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? etude::kExitOk : etude::kExitUsage;
  }
  return etude::RunMain("etude-policy", [&] { return etude::serve::Serve(arguments); });
}
