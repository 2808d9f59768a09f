// SPDX-License-Identifier: Apache-2.0
#include "services/core/crash_point.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <unistd.h>

#include <cstdlib>
#include <map>
#include <string>

#include "services/core/thread_annotations.h"

namespace etude::internal {
namespace {

constexpr char kCrashAt[] = "ETUDE_CRASH_AT";
constexpr char kCrashLog[] = "ETUDE_CRASH_LOG";

std::string Variable(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

// NAME:N, or NAME for NAME:1
struct Target {
  std::string name;
  std::uint64_t times = 1;
};

Target ParseTarget(const std::string& text) {
  const auto colon = text.rfind(':');
  if (colon == std::string::npos) return {text, 1};
  return {text.substr(0, colon), std::strtoull(text.c_str() + colon + 1, nullptr, 10)};
}

// One write(2) to a file that is opened each time: lines of several processes do not mix.
void Note(const std::string& file, std::string_view name, std::uint64_t number) {
  const int fd = ::open(file.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
  if (fd < 0) return;
  const std::string line = fmt::format("{} {}\n", name, number);
  (void)!::write(fd, line.data(), line.size());
  ::close(fd);
}

}  // namespace

const bool kCrashPointsArmed = std::getenv(kCrashAt) != nullptr || std::getenv(kCrashLog) != nullptr;

void ReachCrashPoint(std::string_view name, std::uint64_t number) {
  static Mutex mutex;
  static const std::string log = Variable(kCrashLog);
  static const Target target = ParseTarget(Variable(kCrashAt));
  static std::uint64_t reached = 0;
  const MutexLock lock(mutex);
  if (!log.empty()) Note(log, name, number);
  if (name != target.name || ++reached != target.times) return;
  ::kill(::getpid(), SIGKILL);
  while (true) ::pause();
}

}  // namespace etude::internal
