// SPDX-License-Identifier: Apache-2.0
// The WebSocket's side of the API: who has subscribed to what, and when the next snapshot is due.
#pragma once

#include <chrono>
#include <list>
#include <map>
#include <memory>
#include <string>

#include "dashboard/server/api/context.h"
#include "dashboard/server/http/socket.h"
#include "services/core/thread_annotations.h"

namespace etude::api {

/// Snapshots of windows, not patches: a browser that missed some has lost nothing. Computed once for all that watch the
/// same, at most at a channel's rate, and only when what was sent before has gone out. Thread-safe.
class LiveHub {
 public:
  /// @param most_bytes  of the snapshots that are kept for others who watch the same
  explicit LiveHub(Context& context, std::size_t most_bytes = std::size_t{32} << 20);
  ~LiveHub();

  /// For Server::Open.
  std::shared_ptr<http::SocketClient> Connect(const http::Request& request, std::shared_ptr<http::Socket> socket);
  /// Sends what is due. Call ten times a second.
  void Tick();

  std::size_t clients() const;
  std::size_t kept_bytes() const;

 private:
  class Client;
  struct Subscription {
    std::string id, channel;
    OrderedJson arguments;
    std::string key;  // of channel and arguments: what is computed once
    std::chrono::milliseconds period{500};
    MonotonicClock::time_point due{};
    bool under_way = false;
  };
  struct Snapshot {
    std::string text;
    MonotonicClock::time_point made{};
  };
  std::string Compute(const Subscription& subscription);
  void Deliver(const std::shared_ptr<Client>& client, const Subscription& subscription);
  void Keep(const std::string& key, const std::string& text) ETUDE_REQUIRES(mutex_);

  Context& context_;
  const std::size_t most_bytes_;
  mutable Mutex mutex_;
  std::list<std::weak_ptr<Client>> clients_ ETUDE_GUARDED_BY(mutex_);
  std::map<std::string, Snapshot> snapshots_ ETUDE_GUARDED_BY(mutex_);
  std::size_t snapshot_bytes_ ETUDE_GUARDED_BY(mutex_) = 0;  // of their texts
};

}  // namespace etude::api
