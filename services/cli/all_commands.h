// SPDX-License-Identifier: Apache-2.0
// The whole command line as data: for completion and the reference pages.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>

#include "services/core/config.h"
#include "services/core/result.h"

namespace etude::cli {

/// Of programs that are not built (the quickstart makes those that it needs).
enum class Missing : std::uint8_t {
  kFail,
  kSkip,  ///< the command keeps its name alone
};

/// CommandTable of `etude` as a user meets it: in the place of each command that is a program of its own stands what
/// that program says of itself. @error of a program that cannot be asked
Result<OrderedJson> AllCommands(const CLI::App& app, Missing missing = Missing::kFail);

/// Every command with its words, in order: {"dataset info", row}. Those that only group others are left out.
std::vector<std::pair<std::string, OrderedJson>> FlatCommands(const OrderedJson& commands);

}  // namespace etude::cli
