// SPDX-License-Identifier: Apache-2.0
#include "services/core/check.h"

#include <cstdio>
#include <cstdlib>

namespace etude::internal {

void CheckFailed(const char* expression, const char* file, int line, std::string_view explanation) {
  fmt::print(stderr, "{}:{}: check failed: {} {}\n", file, line, expression, explanation);
  std::fflush(stderr);
  std::abort();
}

}  // namespace etude::internal
