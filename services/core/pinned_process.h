// SPDX-License-Identifier: Apache-2.0
// Numbers that do not depend on the CPU: which variants of its functions the C library takes, and which instructions
// Mesa's software renderer compiles to, are settled by the environment of a process before it starts.
#pragma once

#include <map>
#include <string>

namespace etude {

/// glibc's tunables `first`, then those of `second` that `first` does not name; lists as in GLIBC_TUNABLES.
std::string JoinTunables(const std::string& first, const std::string& second);

/// What a process needs in its environment so that episodes have the same bytes on every x86-64 CPU with AVX; given
/// what is in it now. glibc's libm has variants of sin, exp, pow ... for FMA and AVX2 that round differently: they are
/// masked, other tunables stay. llvmpipe's pictures differ between SSE2 and AVX: it gets AVX, 256 bits wide.
/// @param value  of a variable of the environment, null where it is not set: std::getenv
std::map<std::string, std::string> PinnedEnvironment(const char* (*value)(const char* name));

/// Sets `environment` and starts this program again with the same arguments; returns when all of it is set already, and
/// where a program cannot be started anew. For what a library reads only once, before main.
void StartAgainWith(const std::map<std::string, std::string>& environment, char** argv);

/// Call first in main. Sets PinnedEnvironment and starts this program again with the same arguments; returns when all
/// of it is set already, or when ETUDE_UNPINNED is (for tests that show what the pins are for).
void PinProcess(char** argv);

}  // namespace etude
