// SPDX-License-Identifier: Apache-2.0
#include "services/core/command.h"

#include <fmt/format.h>
#include <poll.h>
#include <pthread.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <system_error>

#include "services/core/file.h"
#include "services/core/log.h"
#include "services/core/log_format.h"
#include "services/core/service_manager.h"
#include "services/core/stop.h"
#include "services/core/stop_reason.h"

namespace etude {
namespace {

// The pipe is asked, because the socket of a library breaks with the same error.
bool NobodyReads() {
  pollfd streams[] = {{STDOUT_FILENO, 0, 0}, {STDERR_FILENO, 0, 0}};
  return ::poll(streams, 2, 0) > 0 && ((streams[0].revents | streams[1].revents) & (POLLERR | POLLHUP)) != 0;
}

// Says it on stderr, or to nobody: an end has no further use for an error of its own.
void SayEnd(const std::string& name, const std::string& message) {
  std::fputs(fmt::format("{}: {}\n", name, message).c_str(), stderr);
}

int End(int exit_code, const std::string& name, const std::string& message) {
  if (GetLogFormat() == LogFormat::kJson)
    Log().error("{}", message);
  else
    SayEnd(name, message);
  return exit_code;
}

// What a body printed may still be in the buffer, and a failed write in the middle of it is not said again.
int EndOfOutput(const std::string& name) {
  errno = 0;
  if (std::fflush(stdout) == 0 && std::ferror(stdout) == 0) return kExitOk;
  const int error_number = errno == 0 ? EIO : errno;
  if (NobodyReads()) return kExitUnread;
  const Error error = ErrnoError("write", "standard output", error_number);
  return End(ExitCodeFor(error), name, error.message);
}

// Of the exception that is being handled.
std::string ExceptionText() {
  try {
    throw;
  } catch (const std::exception& exception) {
    return fmt::format("unexpected exception: {}", exception.what());
  } catch (...) {  // MuJoCo's compiler, for one, throws a type of its own
    return "unexpected exception of a library that says nothing about itself";
  }
}

// One in a thread of its own comes past no RunMain.
[[noreturn]] void OnTerminate() {
  char thread[16] = "";
  ::pthread_getname_np(::pthread_self(), thread, sizeof(thread));
  try {
    SayEnd(fmt::format("thread '{}'", thread),
           std::current_exception() ? ExceptionText() : "std::terminate was called");
  } catch (...) {
    std::fputs("std::bad_alloc, and no memory for more words\n", stderr);
  }
  std::abort();
}

}  // namespace

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

Code CodeForExit(int exit_code) {
  return exit_code == kExitUsage     ? Code::kInvalidArgument
         : exit_code == kExitMachine ? Code::kUnavailable
                                     : Code::kInternal;
}

int RunMain(const std::string& name, const std::function<Status()>& body) {
  InstallStopSignals();
  const char* level = std::getenv("ETUDE_LOG");
  InitLog(name, level ? level : "info");
  std::set_terminate(OnTerminate);
  try {
    Status status = body();
    if (const auto reason = ReasonOfStop()) {
      StartAgainIfWanted();  // also where the body answered the stop with an error of its own
      if (status) status = Fail(*reason);
    }
    ServiceManager::Get().Stopping();
    if (status) return EndOfOutput(name);
    return End(ExitCodeFor(status.error()), name, status.error().message);
  } catch (const std::system_error& error) {
    if (error.code() == std::errc::broken_pipe && NobodyReads()) return kExitUnread;
    if (std::ferror(stdout) != 0) {  // fmt could not write
      const Error unwritten = ErrnoError("write", "standard output", error.code().value());
      return End(ExitCodeFor(unwritten), name, unwritten.message);
    }
    return End(kExitFailure, name, ExceptionText());
  } catch (...) {
    return End(kExitFailure, name, ExceptionText());
  }
}

std::string Version() { return ETUDE_VERSION; }

std::string BuildVersion() {
#ifdef ETUDE_COMMIT
  return Version() + "+" ETUDE_COMMIT;
#else
  return Version();
#endif
}

}  // namespace etude
