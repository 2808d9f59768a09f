// SPDX-License-Identifier: Apache-2.0
#include "services/core/pinned_process.h"

#include <errno.h>
#include <sys/auxv.h>
#include <sys/prctl.h>
#include <unistd.h>

#include <cstdlib>
#include <sstream>

namespace etude {
namespace {

// those of glibc 2.36 that libm's variants are chosen by
constexpr const char* kMasked = "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX512F";

const char* ValueOf(const char* name) { return std::getenv(name); }

}  // namespace

std::string JoinTunables(const std::string& first, const std::string& second) {
  std::string result = first;
  std::istringstream all(second);
  for (std::string one; std::getline(all, one, ':');) {
    const std::string name = one.substr(0, one.find('=')) + "=";
    const bool named = (":" + first).find(":" + name) != std::string::npos;
    if (!one.empty() && !named) result += (result.empty() ? "" : ":") + one;
  }
  return result;
}

std::map<std::string, std::string> PinnedEnvironment(const char* (*value)(const char* name)) {
  const char* tunables = value("GLIBC_TUNABLES");
  return {{"GLIBC_TUNABLES", JoinTunables(kMasked, tunables ? tunables : "")},
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
