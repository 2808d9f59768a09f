// SPDX-License-Identifier: Apache-2.0
// etude: the front door. Each command is one file beside this one, or a program of its own.
#include <fmt/format.h>

#include <cstring>

#include "services/cli/command_line.h"
#include "services/cli/completion.h"
#include "services/cli/reference.h"
#include "services/core/command.h"
#include "services/core/command_table.h"
#include "services/core/config.h"

namespace etude::cli {
namespace {

// The commands that are programs of their own take their arguments, --help too, as they are.
const OwnProgram* FindOwnProgram(int argc, char** argv) {
  if (argc < 2) return nullptr;
  for (const auto& program : OwnPrograms())
    if (std::strcmp(argv[1], program.command) == 0) return &program;
  return nullptr;
}

// CLI11 only says that an argument was not expected; name the nearest command.
std::string NearestCommand(const CLI::App& app, const std::string& word) {
  std::vector<std::string> names;
  for (const auto* command : app.get_subcommands({})) names.push_back(command->get_name());
  return NearestMatch(word, names);
}

int Usage(const CLI::App& app, const CLI::ParseError& error, int argc, char** argv) {
  const int code = app.exit(error);
  if (code == 0) return kExitOk;
  if (argc > 1 && argv[1][0] != '-' && app.get_subcommands().empty())
    if (const auto nearest = NearestCommand(app, argv[1]); !nearest.empty() && nearest != argv[1])
      fmt::print(stderr, "etude: no command '{}': did you mean '{}'?\n", argv[1], nearest);
  return kExitUsage;
}

void AddCommands(CLI::App& app, Body& body) {
  AddUp(app, body);
  AddCollect(app, body);
  for (const auto& own : OwnPrograms()) app.add_subcommand(own.command, own.description);
  AddTop(app, body);
  AddCampaign(app, body);
  AddEval(app, body);
  AddPlay(app, body);
  AddDataset(app, body);
  AddAttempt(app, body);
  AddCheckpoint(app, body);
  AddTopic(app, body);
  AddConfig(app, body);
  AddLanguage(app, body);
  AddResults(app, body);
  AddSecurity(app, body);
  AddDoctor(app, body);
  AddCompletion(app, body);
  AddReference(app, body);
}

int Main(int argc, char** argv) {
  if (const OwnProgram* own = FindOwnProgram(argc, argv))
    return RunMain("etude " + std::string(own->command), [&] {
      std::vector<std::string> arguments = own->prefix;
      arguments.insert(arguments.end(), argv + 2, argv + argc);
      return ExecSibling(own->program, arguments);
    });

  CLI::App app(
      "Language-conditioned robot policies: many workers plan demonstrations in simulation, a trainer learns\n"
      "module by module while they arrive, and every checkpoint goes out on a topic.",
      "etude");
  app.set_version_flag("--version", Version());
  app.require_subcommand(1);
  app.get_formatter()->column_width(28);
  Body body;
  AddCommands(app, body);
  app.footer(
      "Each command has its own --help. Exit codes: 0 done, 2 wrong usage, 3 the machine cannot, 141 nobody reads the "
      "output any more, 1 else.");
  if (argc == 2 && std::strcmp(argv[1], "--command-table") == 0) return *ParseCommandLine(app, argc, argv);
  TakeDecimals(app);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return Usage(app, error, argc, argv);
  }
  return RunMain("etude", body);
}

}  // namespace
}  // namespace etude::cli

int main(int argc, char** argv) { return etude::cli::Main(argc, argv); }
