// SPDX-License-Identifier: Apache-2.0
// etude-policy: serves checkpoints. See trainer/serve/README.md.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <iostream>
#include <thread>

#include "services/bus/arguments.h"
#include "services/core/command.h"
#include "services/core/log.h"
#include "trainer/policy/torch_process.h"
#include "trainer/publish/sink.h"
#include "trainer/serve/server.h"

namespace etude::serve {
namespace {

struct Arguments {
  std::string subscribe, checkpoint, run, channel = "latest";
  bus::Arguments bus;
  int threads = 1;
};

// a run may be named by its name or by its folder
std::string RunName(const std::string& text) {
  return text.empty() || IsPlainName(text) ? text : publish::RunNameOf(text);
}

Status Serve(const Arguments& arguments) {
  if (arguments.subscribe.empty() == arguments.checkpoint.empty())
    return Fail(Code::kInvalidArgument, "give either --subscribe RUN or --checkpoint FILE (see --help)");
  policy::SetTorchThreads(1);
  std::shared_ptr<const Model> model;
  ServerOptions options{RunName(arguments.subscribe), arguments.channel, std::max(1, arguments.threads)};
  if (!arguments.checkpoint.empty()) {
    ETUDE_ASSIGN_OR_RETURN(model, Model::FromFile(arguments.checkpoint));
    options.run = arguments.run.empty() ? model->info().run : RunName(arguments.run);
  }
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open());
  ETUDE_ASSIGN_OR_RETURN(auto server, PolicyServer::Open(participant, options, model));
  if (model)
    Log().info("serving run={} step={} from '{}'", options.run, model->info().step, arguments.checkpoint);
  else
    ETUDE_RETURN_IF_ERROR(server.Follow());
  const Status status = server.Run();
  Log().info("answered {} observations", server.answered());
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
  app.add_option("--subscribe", arguments.subscribe, "run whose checkpoints to follow: its name, or its folder");
  app.add_option("--checkpoint", arguments.checkpoint, "one checkpoint file (.safetensors) instead");
  app.add_option("--run", arguments.run, "with --checkpoint: serve under this name (default: the checkpoint's run)");
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
