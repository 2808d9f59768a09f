// SPDX-License-Identifier: Apache-2.0
// A WebSocket as those who push see it: slots of which the newest content wins.
#pragma once

#include <memory>
#include <string>

#include "dashboard/server/http/message.h"

namespace etude::http {

/// One browser. Thread-safe; calls after its end do nothing.
class Socket {
 public:
  virtual ~Socket() = default;
  /// Sends `text` when the ones before it have gone. What waits in the same slot is replaced by it; when all slots
  /// together hold more than 4 MiB it is dropped.
  virtual void Send(const std::string& slot, std::string text) = 0;
  /// Something of the slot has not gone out yet.
  virtual bool Waits(const std::string& slot) const = 0;
  /// 1; doubled, up to 16, by each write that took longer than 2 s: how much rarer to send to this browser.
  virtual int slowdown() const = 0;
  /// Bytes that wait, for tests.
  virtual std::size_t waiting_bytes() const = 0;
  virtual void Close() = 0;
};

/// What a browser says. Called on the network thread, one call at a time.
class SocketClient {
 public:
  virtual ~SocketClient() = default;
  virtual void OnText(const std::string& text) = 0;
  virtual void OnClosed() = 0;
};

}  // namespace etude::http
