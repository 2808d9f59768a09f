// SPDX-License-Identifier: Apache-2.0
// What another program of Etude says when it is asked.
#pragma once

#include <string>
#include <vector>

#include "services/core/config.h"
#include "services/core/result.h"

namespace etude::cli {

struct SiblingText {
  int exit_code = 0;
  std::string text;  ///< stdout and stderr, without what it logs below an error; no newline at the end
};

/// Runs a program that lies beside this one to its end, a minute at most.
/// @error kNotFound, kUnavailable: it cannot be started; kTimeout
Result<SiblingText> AskSibling(const std::string& program, std::vector<std::string> arguments);
/// That it ends well. @error as above; else what it says, kInvalidArgument or kUnavailable by its exit code
Status CheckBySibling(const std::string& program, std::vector<std::string> arguments);
/// What it prints as JSON. @error as above; kInternal: it failed, or that is not JSON
Result<OrderedJson> AskSiblingJson(const std::string& program, const std::vector<std::string>& arguments);

}  // namespace etude::cli
