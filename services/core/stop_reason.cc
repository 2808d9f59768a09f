// SPDX-License-Identifier: Apache-2.0
#include "services/core/stop_reason.h"

#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <utility>

#include "services/core/clock.h"
#include "services/core/log.h"
#include "services/core/pinned_process.h"
#include "services/core/service_manager.h"
#include "services/core/stop.h"
#include "services/core/thread_annotations.h"

namespace etude {
namespace {

constexpr char kStartedAgain[] = "ETUDE_STARTED_AGAIN";  // BootSeconds: a wall clock may be set back
const double kBegan = BootSeconds();                     // of this process
constexpr char kNewIdOption[] = "--new-id";              // of collectors and trainers (services/core/identity.h)

struct Reason {
  Mutex mutex;
  std::optional<Error> error ETUDE_GUARDED_BY(mutex);
  bool restart ETUDE_GUARDED_BY(mutex) = false;
  MoreArguments more ETUDE_GUARDED_BY(mutex);
};

Reason& GetReason() {
  static auto* const reason = new Reason;  // outlives all threads on purpose
  return *reason;
}

}  // namespace

void StopBecause(Error error) {
  auto& reason = GetReason();
  {
    const MutexLock lock(reason.mutex);
    if (!reason.error) reason.error = std::move(error);
  }
  RequestStop();
}

std::optional<Error> ReasonOfStop() {
  auto& reason = GetReason();
  const MutexLock lock(reason.mutex);
  return reason.error;
}

void RestartBecause(Error error) {
  if (StopRequested()) return;
  {
    auto& reason = GetReason();
    const MutexLock lock(reason.mutex);
    if (!reason.error) reason.restart = true;
  }
  StopBecause(std::move(error));
}

namespace {

std::atomic<int> holds{0};

}  // namespace

RestartHold::RestartHold() { ++holds; }
RestartHold::~RestartHold() { --holds; }

bool MayStartAgain() {
  if (holds > 0) return false;
  const char* const last = std::getenv(kStartedAgain);
  // whom a service manager starts again begins without that word
  const double since = last != nullptr             ? std::atof(last)
                       : ServiceManager::IsThere() ? kBegan
                                                   : BootSeconds() - kLeastLifeS;
  return BootSeconds() - since >= kLeastLifeS;
}

void RestartWith(MoreArguments more) {
  auto& reason = GetReason();
  const MutexLock lock(reason.mutex);
  reason.more = std::move(more);
}

namespace {

// Arguments of this process as it was started.
std::vector<std::string> OwnArguments() {
  std::ifstream file("/proc/self/cmdline", std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  std::vector<std::string> arguments;
  for (std::size_t at = 0, end; at < text.size(); at = end + 1) {
    end = std::min(text.find('\0', at), text.size());
    arguments.push_back(text.substr(at, end - at));
  }
  return arguments;
}

}  // namespace

void StartAgainIfWanted() {
  MoreArguments more;
  std::string why;
  {
    auto& reason = GetReason();
    const MutexLock lock(reason.mutex);
    if (!reason.restart || ServiceManager::IsThere()) return;
    more = reason.more;
    why = reason.error->message;
  }
  std::vector<std::string> arguments = OwnArguments();
  std::optional<std::vector<std::string>> added(std::in_place);
  if (more) added = more();
  if (arguments.empty() || !added) return;
  std::erase(arguments, kNewIdOption);  // it has one by now, and others have heard of it
  for (std::string& argument : *added)
    if (std::ranges::find(arguments, argument) == arguments.end()) arguments.push_back(std::move(argument));
  std::vector<char*> argv;
  for (std::string& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);
  Log().warn("this process starts again: {}", why);
  // sockets and locks of what has ended are not handed on
  (void)::close_range(STDERR_FILENO + 1, ~0u, CLOSE_RANGE_CLOEXEC);
  const auto now = static_cast<std::int64_t>(BootSeconds());
  StartAgainWith({{kStartedAgain, std::to_string(now)}}, argv.data());
}

}  // namespace etude
