// SPDX-License-Identifier: Apache-2.0
// What a program can be told, as data: completion of the shell, the command reference and whoever asks the program
// itself take it from here, so that no option is written down twice. For mains only (CLI11).
#pragma once

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace etude {

/// {name, description, options: [{names, positional, value, choices, default, required, repeats, description}],
/// commands: [the same again]}. `value` is "" of a flag, else what CLI11 says of its type ("INT in [0 - 230]"); an
/// option of a group without a name, which `--help` hides, is left out here, too.
nlohmann::ordered_json CommandTable(const CLI::App& app);

/// Has every whole number of the program and its commands read as decimal, and none below 0 where there is no sign: to
/// CLI11 000010, an episode as its file is called, is octal, and -1 is 2^64 - 1. ParseCommandLine does it; for who
/// parses without that. Call it when all options are there.
void TakeDecimals(CLI::App& app);

/// Parses the arguments. Returns the exit code when that is all: after `--help` and `--version`, when they are wrong
/// (told on stderr), and after `PROGRAM --command-table`, which prints CommandTable(app).
std::optional<int> ParseCommandLine(CLI::App& app, int argc, char** argv);

/// For options that name a file to write: its ending, one of these, says what is written.
CLI::Validator EndsWith(const std::vector<std::string>& endings);
/// For options that name a place to write to: "" is what a variable that is not set makes of it.
CLI::Validator NamesAPlace();

}  // namespace etude
