// SPDX-License-Identifier: Apache-2.0
// OUT/up.json: that `etude up` is at work there, or how it ended.
#pragma once

#include <sys/types.h>

#include <map>
#include <optional>
#include <string>

#include "services/core/config.h"
#include "services/core/file.h"
#include "services/core/result.h"

namespace etude::cli {

/// {"pids": {"up", "trainer", "policy", "dashboard"}, "domain", "folders": {"dataset", "run", "eval", "logs"},
/// "address", "phase", "goal", "started", "ended", "exit"}: phase is begin | collect and train | roll out | serve |
/// drain | ended, goal what that ends with, in words; times in seconds since 1970; "ended" and "exit" are null while it
/// runs. Where its process is gone and "ended" is null, it was killed. Written by rename; not thread-safe.
class UpRecord {
 public:
  /// @param address  of the dashboard; "": none   @error of the disk
  static Result<UpRecord> Begin(const Path& out, std::uint32_t domain, const std::map<std::string, Path>& folders,
                                const std::string& address);
  /// The children that are there now; written when they are others than before. What cannot be written is logged.
  void SetChildren(const std::map<std::string, pid_t>& children);
  void SetAddress(const std::string& address);
  void SetPhase(const std::string& phase, const std::string& goal = "");
  void End(int exit_code);

 private:
  Status Write() const;
  void WriteOrWarn() const;

  Path file_;
  std::map<std::string, pid_t> children_;
  OrderedJson json_;
};

}  // namespace etude::cli
