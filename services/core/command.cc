// SPDX-License-Identifier: Apache-2.0
#include "services/core/command.h"

#include <fmt/format.h>

#include <cstdlib>
#include <exception>

#include "services/core/log.h"
#include "services/core/stop.h"

namespace etude {

int ExitCodeFor(const Error& error) {
  switch (error.code) {
    case Code::kInvalidArgument:
      return kExitUsage;
    case Code::kUnavailable:
      return kExitMachine;
    default:
      return kExitFailure;
  }
}

int RunMain(const std::string& name, const std::function<Status()>& body) {
  InstallStopSignals();
  const char* level = std::getenv("ETUDE_LOG");
  InitLog(name, level ? level : "info");
  try {
    const Status status = body();
    if (status) return kExitOk;
    fmt::print(stderr, "{}: {}\n", name, status.error().message);
    return ExitCodeFor(status.error());
  } catch (const std::exception& error) {
    fmt::print(stderr, "{}: unexpected exception: {}\n", name, error.what());
    return kExitFailure;
  } catch (...) {  // MuJoCo's compiler, for one, throws a type of its own
    fmt::print(stderr, "{}: unexpected exception of a library that says nothing about itself\n", name);
    return kExitFailure;
  }
}

std::string Version() { return ETUDE_VERSION; }

}  // namespace etude
