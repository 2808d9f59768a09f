// SPDX-License-Identifier: Apache-2.0
// ETUDE_CHECK: an assumption of the programmer, always armed. A failed one is a bug and aborts with the
// expression and a formatted explanation. Never used on input from a user, a file or the network.
#pragma once

#include <fmt/format.h>

#include <string_view>

namespace etude::internal {
[[noreturn]] void CheckFailed(const char* expression, const char* file, int line, std::string_view explanation);
}

/// ETUDE_CHECK(cond) or ETUDE_CHECK(cond, "i={} n={}", i, n).
#define ETUDE_CHECK(condition, ...)                                                                  \
  do {                                                                                               \
    if (!(condition)) [[unlikely]]                                                                   \
      ::etude::internal::CheckFailed(#condition, __FILE__, __LINE__, ::fmt::format("" __VA_ARGS__)); \
  } while (false)
