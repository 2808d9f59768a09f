// SPDX-License-Identifier: Apache-2.0
#include "services/core/check.h"

#include <cstdio>
#include <cstdlib>

namespace etude::internal {

void CheckFailed(const char* expression, const char* file, int line, std::string_view explanation) {
  // fputs: fmt::print throws where stderr is closed, and a bug has to abort
  std::fputs(fmt::format("{}:{}: check failed: {} {}\n", file, line, expression, explanation).c_str(), stderr);
  std::fflush(stderr);
  std::abort();
}

}  // namespace etude::internal
