// SPDX-License-Identifier: Apache-2.0
#include "services/core/pinned_process.h"

#include <errno.h>
#include <sys/auxv.h>
#include <sys/prctl.h>
#include <unistd.h>

#include <cstdlib>
#include <sstream>
#include <string_view>

namespace etude {
namespace {

constexpr std::string_view kHwcaps = "glibc.cpu.hwcaps=";
// those of glibc 2.36 that libm's variants are chosen by
constexpr const char* kMasked = "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX512F";

// `tunables` with our hwcaps in the place of others
std::string TunablesWithMask(const std::string& tunables) {
  std::string result = kMasked;
  std::istringstream all(tunables);
  for (std::string one; std::getline(all, one, ':');)
    if (!one.empty() && !one.starts_with(kHwcaps)) result += ":" + one;
  return result;
}

const char* ValueOf(const char* name) { return std::getenv(name); }

}  // namespace

std::map<std::string, std::string> PinnedEnvironment(const char* (*value)(const char* name)) {
  const char* tunables = value("GLIBC_TUNABLES");
  return {{"GLIBC_TUNABLES", TunablesWithMask(tunables ? tunables : "")},
          {"GALLIUM_OVERRIDE_CPU_CAPS", "avx"},
          {"LP_NATIVE_VECTOR_WIDTH", "256"}};
}

void StartAgainWith(const std::map<std::string, std::string>& environment, char** argv) {
  // a program started anew through /proc/self/exe is called `exe` by ps and pkill
  ::prctl(PR_SET_NAME, program_invocation_short_name);
  // with capabilities of its file, or set-uid: glibc takes its tunables out of the environment at every start
  if (::getauxval(AT_SECURE) != 0) return;
  bool changed = false;
  for (const auto& [name, value] : environment) {
    const char* now = std::getenv(name.c_str());
    if (now && value == now) continue;
    ::setenv(name.c_str(), value.c_str(), 1);
    changed = true;
  }
  if (changed) ::execv("/proc/self/exe", argv);
}

// Without /proc the program goes on as it is, and its fingerprint says so.
void PinProcess(char** argv) {
  StartAgainWith(std::getenv("ETUDE_UNPINNED") ? std::map<std::string, std::string>() : PinnedEnvironment(ValueOf),
                 argv);
}

}  // namespace etude
