// SPDX-License-Identifier: Apache-2.0
// The sockets: one thread for the network, a few for files, one for episodes, two for the bus, two for commands to play
// sessions. Boost.Beast stays behind this header.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "dashboard/server/http/service.h"
#include "dashboard/server/http/socket.h"

namespace etude::http {

struct ServerOptions {
  std::string address = "127.0.0.1";
  std::uint16_t port = 8080;  ///< 0: any free one
  std::string socket_path = "/api/v1/live";
  std::size_t connections = 256;
  std::size_t request_bytes = 64 * 1024;  ///< of a body
  std::size_t header_bytes = 16 * 1024;
  std::chrono::milliseconds read_time{30'000};    ///< for a whole request, from the end of the one before it
  std::chrono::milliseconds handle_time{10'000};  ///< then the answer is 504
  std::chrono::milliseconds write_time{60'000};   ///< without progress
  unsigned file_threads = 2;
  unsigned bus_threads = 2;
  unsigned play_threads = 2;
};

/// Makes the client of a WebSocket that was let in.
using SocketFactory = std::function<std::shared_ptr<SocketClient>(const Request&, std::shared_ptr<Socket>)>;

class Server {
 public:
  /// Listens from here on. `service` is borrowed and must outlive the server.
  /// @error kUnavailable: the address or the port cannot be had; says which and what to do. kInvalidArgument: no
  /// address
  static Result<std::unique_ptr<Server>> Open(const ServerOptions& options, const Service& service,
                                              SocketFactory sockets);
  ~Server();

  std::uint16_t port() const;
  /// Serves until Stop; the calling thread is the network's.
  void Run();
  /// From any thread.
  void Stop();

  /// Runs `work` on a thread of the lane; what it throws is logged. From any thread.
  void InLane(Lane lane, std::function<void()> work);
  /// Runs `work` on the network thread every `period`, until Stop. Call before Run.
  void Every(std::chrono::milliseconds period, std::function<void()> work);

  struct State;

 private:
  explicit Server(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace etude::http
