// SPDX-License-Identifier: Apache-2.0
// The end of $NOTIFY_SOCKET that a service manager reads.
#pragma once

#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <chrono>
#include <cstddef>
#include <cstring>
#include <string>
#include <vector>

#include "services/core/check.h"
#include "services/core/clock.h"

namespace etude {

class NotifySocket {
 public:
  /// `name`: a path that nothing is at, or "@name" for one of Linux's abstract sockets.
  explicit NotifySocket(std::string name) : name_(std::move(name)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    ETUDE_CHECK(name_.size() < sizeof address.sun_path, "'{}' is too long for a socket", name_);
    std::memcpy(address.sun_path, name_.data(), name_.size());
    if (name_[0] == '@') address.sun_path[0] = '\0';
    const auto length = offsetof(sockaddr_un, sun_path) + name_.size() + (name_[0] == '@' ? 0 : 1);
    fd_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    const int bound = ::bind(fd_, reinterpret_cast<const sockaddr*>(&address), static_cast<socklen_t>(length));
    ETUDE_CHECK(bound == 0, "errno={}", errno);
  }
  ~NotifySocket() { ::close(fd_); }
  NotifySocket(const NotifySocket&) = delete;
  NotifySocket& operator=(const NotifySocket&) = delete;

  const std::string& name() const { return name_; }

  /// What has come since, a string a datagram.
  std::vector<std::string> Take() {
    std::vector<std::string> messages;
    char buffer[4096];
    for (ssize_t got; (got = ::recv(fd_, buffer, sizeof buffer, MSG_DONTWAIT)) >= 0;)
      messages.emplace_back(buffer, static_cast<std::size_t>(got));
    return messages;
  }

  /// Waits for a message that has `text`; all that came until then, it last. Empty last line: it did not come.
  std::vector<std::string> WaitFor(const std::string& text, std::chrono::milliseconds timeout) {
    std::vector<std::string> all;
    for (const Stopwatch watch; 1000 * watch.Seconds() < static_cast<double>(timeout.count());) {
      pollfd readable{fd_, POLLIN, 0};
      ::poll(&readable, 1, 50);
      for (auto& message : Take()) {
        all.push_back(std::move(message));
        if (all.back().find(text) != std::string::npos) return all;
      }
    }
    all.emplace_back();
    return all;
  }

 private:
  std::string name_;
  int fd_ = -1;
};

}  // namespace etude
