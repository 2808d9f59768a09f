// SPDX-License-Identifier: Apache-2.0
// Which handler answers which address.
//
//   router.Add("GET", "/datasets/{id}/episodes/{n}/pictures/{camera}/{k}.rgb", Lane::kEpisodes, handler);
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "dashboard/server/http/message.h"

namespace etude::http {

using Handler = std::function<Result<Answer>(const Request&)>;

/// Who runs a handler. HDF5 takes one reader at a time: whoever reads episodes queues in a lane of its own, so that
/// pages that need none never wait behind it; so does whoever waits for another process, which may not answer. Who
/// talks to a robot (kPlay) does not wait behind those who render or look (kBus). What needs no file and nobody is
/// answered at once, on the network's own thread.
enum class Lane : std::uint8_t { kFiles, kEpisodes, kBus, kPlay, kAtOnce };

/// Who may ask.
enum class Access : std::uint8_t {
  kRead,    ///< whoever the gateway is open to; the token where it is bound to more than this machine
  kAction,  ///< the token, always
  kSignIn,  ///< whoever reaches it under a known name: to show the token
  kPublic,  ///< anyone who reaches it, under whatever name: probes of a supervisor
};

struct Route {
  std::string method;
  std::string pattern;  ///< as it was added
  Lane lane = Lane::kFiles;
  Handler handler;
  Access access = Access::kRead;
};

/// Thread safety: const methods concurrent.
class Router {
 public:
  /// A segment may hold one {name} with text before and after it; routes that were added first win.
  void Add(std::string method, std::string pattern, Lane lane, Handler handler, Access access = Access::kRead);

  /// The route for `request`, whose parameters are filled in. nullptr: none; then `allowed` has the methods that the
  /// address knows, if any.
  const Route* Find(Request& request, std::vector<std::string>& allowed) const;

  const std::vector<Route>& routes() const { return routes_; }

 private:
  struct Segment {
    std::string prefix, name, suffix;  // name "": prefix is all of it
  };
  static bool Match(const std::vector<Segment>& segments, Request& request);

  std::vector<Route> routes_;
  std::vector<std::vector<Segment>> segments_;  // of routes_
};

}  // namespace etude::http
