// SPDX-License-Identifier: Apache-2.0
// `etude` as a user meets it: a process with arguments, an exit code and a text. Needs etude::campaign.
#pragma once

#include <chrono>
#include <filesystem>
#include <string>
#include <vector>

#include "services/campaign/process.h"
#include "services/core/file.h"
#include "tests/support/programs_folder.h"

namespace etude {

struct CommandOutcome {
  int exit_code = -1;
  std::string text;  // stdout and stderr
};

/// Runs `etude ARGUMENTS` to its end, at most a minute; its text passes through `log`, which it replaces.
inline CommandOutcome RunEtude(std::vector<std::string> arguments, const Path& log) {
  arguments.insert(arguments.begin(), (ProgramsFolder() / "etude").string());
  std::filesystem::remove(log);
  auto process = campaign::Process::Start({arguments, log, {}});
  if (!process) return {-1, process.error().message};
  const int exit_code = process->Wait(std::chrono::seconds(60)).value_or(-1);
  return {exit_code, ReadTextFile(log).value_or("")};
}

}  // namespace etude
