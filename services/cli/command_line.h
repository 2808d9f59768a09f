// SPDX-License-Identifier: Apache-2.0
// What the commands of `etude` share: how they are declared, and their common options.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "services/bus/arguments.h"
#include "services/core/result.h"

namespace etude::cli {

/// Filled in by the command that was chosen; main runs it.
using Body = std::function<Status()>;

using BusArguments = bus::Arguments;

/// A command that is one of several behind its name: `etude dataset info`.
inline CLI::App* AddGroup(CLI::App& app, const char* name, const char* description) {
  return app.add_subcommand(name, description)->require_subcommand(1);
}

/// Adds `--set KEY=VALUE`, repeatable.
inline void AddOverrides(CLI::App& app, std::vector<std::string>& overrides, const char* example) {
  app.add_option("--set", overrides, std::string("KEY=VALUE over the file's, e.g. ") + example)
      ->allow_extra_args(false)
      ->type_name("KEY=VALUE");
}

void AddCollect(CLI::App& app, Body& body);
void AddEval(CLI::App& app, Body& body);
void AddUp(CLI::App& app, Body& body);
void AddDataset(CLI::App& app, Body& body);
void AddCheckpoint(CLI::App& app, Body& body);
void AddConfig(CLI::App& app, Body& body);
void AddLanguage(CLI::App& app, Body& body);
void AddAttempt(CLI::App& app, Body& body);
void AddResults(CLI::App& app, Body& body);
void AddDoctor(CLI::App& app, Body& body);
void AddSecurity(CLI::App& app, Body& body);
void AddTop(CLI::App& app, Body& body);
void AddTopic(CLI::App& app, Body& body);
void AddCampaign(CLI::App& app, Body& body);
void AddPlay(CLI::App& app, Body& body);

/// Commands that are programs of their own, or a subcommand of one: name -> program, the arguments that
/// come first, and what `etude --help` says of it.
struct OwnProgram {
  const char* command;
  const char* program;
  const char* description;
  std::vector<std::string> prefix = {};
};
const std::vector<OwnProgram>& OwnPrograms();
/// Replaces this process by `program` with `arguments`; only returns on error.
Status ExecSibling(const std::string& program, const std::vector<std::string>& arguments);

}  // namespace etude::cli
