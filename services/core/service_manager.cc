// SPDX-License-Identifier: Apache-2.0
#include "services/core/service_manager.h"

#include <fmt/format.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <cstring>

#include "services/core/stop.h"

namespace etude {
namespace {

using namespace std::chrono_literals;

constexpr auto kBetweenLines = 1s;     // of STATUS=
constexpr auto kBetweenRounds = 10ms;  // of a loop that goes round more often, the lock is taken no more than so

std::uint64_t NumberIn(const char* variable) {
  const char* text = std::getenv(variable);
  return text ? std::strtoull(text, nullptr, 10) : 0;
}

// A line break would begin another assignment.
std::string Line(std::string_view text) {
  std::string line(text);
  std::ranges::replace(line, '\n', ' ');
  return line;
}

}  // namespace

struct ServiceManager::Socket {
  int fd = -1;
  sockaddr_un address{};
  socklen_t length = 0;  // 0: nobody listens

  explicit Socket(const std::string& name) {
    if (name.size() < 2 || name.size() >= sizeof address.sun_path || (name[0] != '/' && name[0] != '@')) return;
    fd = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (fd < 0) return;
    address.sun_family = AF_UNIX;
    std::memcpy(address.sun_path, name.data(), name.size());
    length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name.size());
    if (name[0] == '@')
      address.sun_path[0] = '\0';  // an abstract name is as long as it is
    else
      ++length;  // a path ends with a zero
  }
  ~Socket() {
    if (fd >= 0) ::close(fd);
  }
};

bool ServiceManager::IsThere() { return std::getenv("NOTIFY_SOCKET") != nullptr; }

ServiceManager::Environment ServiceManager::FromEnvironment() {
  Environment environment;
  if (IsThere()) environment.socket = std::getenv("NOTIFY_SOCKET");
  const std::uint64_t pid = NumberIn("WATCHDOG_PID");
  if (pid == 0 || pid == static_cast<std::uint64_t>(::getpid()))
    environment.watchdog = std::chrono::microseconds(NumberIn("WATCHDOG_USEC"));
  return environment;
}

ServiceManager& ServiceManager::Get() {
  static auto* const manager = new ServiceManager(FromEnvironment());  // threads may speak until the very end
  return *manager;
}

ServiceManager::ServiceManager(const Environment& environment)
    : watchdog_(environment.watchdog), socket_(std::make_unique<Socket>(environment.socket)) {}
ServiceManager::~ServiceManager() = default;

// A manager that does not read is not waited for: what is lost is a line for people or one of four signs of life.
void ServiceManager::Send(std::string_view message) {
  if (socket_->length == 0) return;
  [[maybe_unused]] const auto sent = ::sendto(socket_->fd, message.data(), message.size(), MSG_NOSIGNAL,
                                              reinterpret_cast<const sockaddr*>(&socket_->address), socket_->length);
}

void ServiceManager::Ready(std::string_view status) {
  const MutexLock lock(mutex_);
  if (ready_) return;
  ready_ = true;
  status_ = Line(status);
  Send(fmt::format("READY=1\nSTATUS={}", status_));
}

void ServiceManager::Say(std::string_view status) {
  const MutexLock lock(mutex_);
  const auto now = MonotonicClock::now();
  std::string line = Line(status);
  if (line == status_ || now - said_ < kBetweenLines) return;
  said_ = now;
  status_ = std::move(line);
  Send("STATUS=" + status_);
}

void ServiceManager::Stopping() {
  const MutexLock lock(mutex_);
  if (!ready_ || stopping_) return;
  stopping_ = true;
  Send("STOPPING=1");
}

void ServiceManager::Join(const void* loop) {
  const MutexLock lock(mutex_);
  loops_[loop] = MonotonicClock::now();
}

void ServiceManager::Leave(const void* loop) {
  const MutexLock lock(mutex_);
  loops_.erase(loop);
}

void ServiceManager::Moved(const void* loop, MonotonicClock::time_point now) {
  const MutexLock lock(mutex_);
  loops_[loop] = now;
  if (watchdog_ == 0us || now - fed_ < watchdog_ / 4) return;
  const bool all_move =
      std::ranges::all_of(loops_, [&](const auto& other) { return now - other.second < watchdog_ / 2; });
  if (!all_move) return;
  fed_ = now;
  Send("WATCHDOG=1");
}

WatchedLoop::WatchedLoop(ServiceManager& manager) : manager_(manager) { manager_.Join(this); }
WatchedLoop::~WatchedLoop() { manager_.Leave(this); }

void WatchedLoop::Moved(MonotonicClock::time_point now) {
  if (now - told_ < kBetweenRounds) return;
  told_ = now;
  manager_.Moved(this, now);
  if (StopRequested()) manager_.Stopping();
}

}  // namespace etude
