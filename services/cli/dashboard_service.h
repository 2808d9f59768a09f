// SPDX-License-Identifier: Apache-2.0
// The web pages over what a command makes, as its supervised child.
#pragma once

#include <cstdint>
#include <string>

#include "services/cli/command_line.h"
#include "services/cli/service.h"

namespace etude::cli {

struct DashboardOptions {
  Path out;                   ///< what it shows; its log is out/logs/dashboard.log
  std::uint16_t port = 8080;  ///< 0: any free one
  BusArguments bus;
  std::string program = "etude-gateway";  ///< beside this program, or a path
};

/// Not thread-safe; Start, Supervise and Stop on one thread.
class DashboardService {
 public:
  /// @error kUnavailable: there is no etude-gateway beside this program; of Service::Start
  static Result<DashboardService> Start(const DashboardOptions& options);
  /// Call a few times a second. @error when it ended: the port is taken, or it died too often
  Status Supervise();
  /// "http://127.0.0.1:8080"; "": it does not listen yet.
  const std::string& address() const { return address_; }
  std::optional<pid_t> pid() const { return service_.pid(); }
  void Stop(std::chrono::milliseconds patience) { service_.Stop(patience); }

 private:
  DashboardService(Service service, Path log, std::uint64_t begin)
      : service_(std::move(service)), log_(std::move(log)), read_(begin) {}

  Service service_;
  Path log_;
  std::uint64_t read_ = 0;  // bytes of the log that an earlier one wrote
  std::string address_;
};

}  // namespace etude::cli
