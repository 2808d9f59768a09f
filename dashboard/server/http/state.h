// SPDX-License-Identifier: Apache-2.0
// What the server's connections share. Internal to dashboard/server/http.
#pragma once

#include <atomic>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/thread_pool.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http/message.hpp>
#include <boost/beast/http/string_body.hpp>
#include <list>
#include <memory>

#include "dashboard/server/http/server.h"

namespace etude::http {

namespace net = boost::asio;
namespace beast = boost::beast;

struct Server::State {
  State(const ServerOptions& server_options, const Service& served, SocketFactory factory)
      : options(server_options),
        service(served),
        sockets(std::move(factory)),
        acceptor(network),
        files(server_options.file_threads),
        episodes(1),
        bus(server_options.bus_threads),
        play(server_options.play_threads) {}

  void Accept();
  /// Runs `work` on a thread of the lane. What it throws is logged: a pool ends the process for it.
  void Post(Lane lane, std::function<void()> work);

  // first, as connections end with the network, and one that was given up with its last handler, on a pool's thread
  std::atomic<std::size_t> open_connections = 0;
  const ServerOptions options;
  const Service& service;
  const SocketFactory sockets;
  net::io_context network{1};
  net::ip::tcp::acceptor acceptor;
  net::thread_pool files, episodes, bus, play;
  std::list<net::steady_timer> timers;
};

using BeastRequest = beast::http::request<beast::http::string_body>;

/// Reads and answers requests of one connection until it ends. Counts itself among `state`'s.
void StartConnection(Server::State& state, beast::tcp_stream stream);
/// Takes the connection over as a WebSocket.
/// @param ended  called once it is over
void StartSocket(Server::State& state, beast::tcp_stream stream, BeastRequest upgrade, const Request& request,
                 std::function<void()> ended);

}  // namespace etude::http
