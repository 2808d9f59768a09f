// SPDX-License-Identifier: Apache-2.0
// The process behind the dashboard: folders and the bus on one side, HTTP and WebSockets on the other.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "services/bus/arguments.h"
#include "services/core/file.h"
#include "services/core/result.h"

namespace etude::dashboard {

struct GatewayOptions {
  std::vector<Path> dirs;             ///< datasets, runs and evaluations lie below them
  std::string address = "127.0.0.1";  ///< another one needs a token
  std::uint16_t port = 8080;          ///< 0: any free one
  std::vector<std::string> hosts;     ///< names that it is opened by, beside localhost and the address
  Path token_file;                    ///< empty: no actions. Made, with a random token, when it is not there
  bool use_bus = true;
  bus::Arguments bus;
  Path web;    ///< folder of the built pages; empty: beside the program
  Path cache;  ///< for videos, replays and logs of jobs; empty: $XDG_CACHE_HOME/etude/dashboard, or
               ///< ~/.cache/etude/dashboard
};

/// It has no state of its own beyond bounded caches: started again it shows the same.
class Gateway {
 public:
  /// Listens from here on. @error kInvalidArgument: an address of other machines without a token, a token that is too
  /// short; kUnavailable: the port cannot be had
  static Result<std::unique_ptr<Gateway>> Open(const GatewayOptions& options);
  ~Gateway();

  std::uint16_t port() const;
  std::string url() const;  ///< "http://127.0.0.1:8080"
  /// Serves until a stop is requested (SIGINT, SIGTERM) or Stop.
  void Run();
  void Stop();  ///< from any thread

 private:
  struct Parts;
  explicit Gateway(std::unique_ptr<Parts> parts);
  std::unique_ptr<Parts> parts_;
};

/// openapi.json.
const char* OpenApiText();

}  // namespace etude::dashboard
