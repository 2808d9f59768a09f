// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/http/server.h"

#include <fmt/format.h>

#include <boost/asio/ip/v6_only.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/strand.hpp>
#include <utility>

#include "dashboard/server/http/state.h"
#include "services/core/log.h"

namespace etude::http {
namespace {

using boost::system::error_code;
using net::ip::tcp;

constexpr const char* kTaken =
    "; another program has that port: choose one with --port (of etude up: --dashboard-port), 0 for any";

tl::unexpected<Error> CannotListen(const ServerOptions& options, const error_code& error) {
  const bool taken = error == net::error::address_in_use;
  return Fail(Code::kUnavailable, fmt::format("listen on {}:{}: {}{}", options.address, options.port, error.message(),
                                              taken ? kTaken : ""));
}

void Repeat(net::steady_timer& timer, std::chrono::milliseconds period, const std::function<void()>& work) {
  timer.expires_after(period);
  timer.async_wait([&timer, period, work](const error_code& error) {
    if (error) return;
    work();
    Repeat(timer, period, work);
  });
}

}  // namespace

void Server::State::Accept() {
  acceptor.async_accept(network, [this](const error_code& error, tcp::socket socket) {
    if (error == net::error::operation_aborted) return;
    if (!error && open_connections < options.connections) {
      error_code ignored;
      // small messages must not wait for acknowledgements of the ones before them
      socket.set_option(tcp::no_delay(true), ignored);
      StartConnection(*this, beast::tcp_stream(std::move(socket)));
    }
    // one too many is closed here; no descriptors left (EMFILE): a busy loop would not free any
    if (error) {
      auto pause = std::make_shared<net::steady_timer>(network, std::chrono::milliseconds(100));
      pause->async_wait([this, pause](const error_code& stopped) {
        if (!stopped) Accept();
      });
      return;
    }
    Accept();
  });
}

void Server::State::Post(Lane lane, std::function<void()> work) {
  const auto post = [&work](auto& place) {
    net::post(place, [work = std::move(work)] {
      try {
        work();
      } catch (const std::exception& error) {
        Log().error("work for the pages failed: {}", error.what());
      }
    });
  };
  switch (lane) {
    case Lane::kFiles:
      return post(files);
    case Lane::kEpisodes:
      return post(episodes);
    case Lane::kBus:
      return post(bus);
    case Lane::kPlay:
      return post(play);
    case Lane::kAtOnce:
      return post(network);
  }
}

Result<std::unique_ptr<Server>> Server::Open(const ServerOptions& options, const Service& service,
                                             SocketFactory sockets) {
  error_code error;
  const auto address = net::ip::make_address(options.address, error);
  if (error) {
    return Fail(Code::kInvalidArgument,
                fmt::format("--bind {}: not an IP address, such as 127.0.0.1 or 0.0.0.0", options.address));
  }
  auto state = std::make_unique<State>(options, service, std::move(sockets));
  auto& acceptor = state->acceptor;
  const tcp::endpoint endpoint(address, options.port);
  acceptor.open(endpoint.protocol(), error);
  if (!error) acceptor.set_option(net::socket_base::reuse_address(true), error);
  // "::" is every address, also where the system would keep IPv4 out of it
  if (!error && address.is_v6() && address.is_unspecified()) acceptor.set_option(net::ip::v6_only(false), error);
  if (!error) acceptor.bind(endpoint, error);
  if (!error) acceptor.listen(net::socket_base::max_listen_connections, error);
  if (error) return CannotListen(options, error);
  state->Accept();
  return std::unique_ptr<Server>(new Server(std::move(state)));
}

Server::Server(std::unique_ptr<State> state) : state_(std::move(state)) {}

Server::~Server() {
  Stop();
  // handlers at work refer to connections, and those to the network
  state_->files.join();
  state_->episodes.join();
  state_->bus.join();
  state_->play.join();
}

std::uint16_t Server::port() const {
  error_code error;
  return state_->acceptor.local_endpoint(error).port();
}

void Server::Run() {
  for (;;) {
    try {
      state_->network.run();
      return;
    } catch (const std::exception& error) {
      // a bug in one connection's callback must not take the others with it
      Log().error("a connection failed: {}", error.what());
    }
  }
}

void Server::Stop() {
  state_->network.stop();
  state_->files.stop();
  state_->episodes.stop();
  state_->bus.stop();
  state_->play.stop();
}

void Server::InLane(Lane lane, std::function<void()> work) { state_->Post(lane, std::move(work)); }

void Server::Every(std::chrono::milliseconds period, std::function<void()> work) {
  auto& timer = state_->timers.emplace_back(state_->network);
  Repeat(timer, period, work);
}

}  // namespace etude::http
