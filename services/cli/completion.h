// SPDX-License-Identifier: Apache-2.0
// `etude completion bash|zsh`: what a shell offers after TAB. The script has everything in it, so that no program is
// started while somebody types.
#pragma once

#include <string>

#include "services/cli/command_line.h"
#include "services/core/config.h"

namespace etude::cli {

/// `app` has to live until the body has run: what it offers is asked for then.
void AddCompletion(CLI::App& app, Body& body);

/// @param commands  AllCommands. Completes command words, options, values that are of a set, and else files.
std::string BashCompletion(const OrderedJson& commands);
/// The same with what each word means.
std::string ZshCompletion(const OrderedJson& commands);

}  // namespace etude::cli
