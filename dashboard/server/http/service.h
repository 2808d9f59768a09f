// SPDX-License-Identifier: Apache-2.0
// From a request to its finished answer, without a socket: security, route, handler, tag and compression.
#pragma once

#include "dashboard/server/http/message.h"
#include "dashboard/server/http/router.h"
#include "dashboard/server/http/security.h"

namespace etude::http {

/// Thread safety: const methods concurrent, as far as its handlers are.
class Service {
 public:
  /// @param pages  answers GETs that no route of `router` knows: the web pages
  Service(Router router, Security security, Handler pages)
      : router_(std::move(router)), security_(std::move(security)), pages_(std::move(pages)) {}

  /// Where Handle is to run.
  Lane LaneOf(Request& request) const;
  /// Never throws: what a handler throws becomes a 500.
  Answer Handle(Request& request) const;
  /// nullopt: the request may open a WebSocket.
  std::optional<Answer> CheckSocket(Request& request) const;

  const Router& router() const { return router_; }
  const Security& security() const { return security_; }

 private:
  Answer Route(Request& request) const;

  Router router_;
  Security security_;
  Handler pages_;
};

}  // namespace etude::http
