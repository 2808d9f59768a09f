// SPDX-License-Identifier: Apache-2.0
// Logging. Include from .cc files only. Constant text first, then fields: Log(...)->info("committed
// episode={} attempt={}", ...). Levels: error = an operator must act, warn = degraded and counted,
// info = lifecycle, debug = the rest. Everything goes to stderr; stdout is for results.
#pragma once

#include <spdlog/spdlog.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "services/core/log_format.h"

namespace etude {

/// Sets up the process's logger once, in main: `name` stands in front of each line.
/// `level`: error | warn | info | debug.
void InitLog(const std::string& name, const std::string& level);

/// The process's logger. Thread-safe.
spdlog::logger& Log();

/// What a message is about, for programs: the words of its constant text, up to its first value or colon.
/// "refused a checkpoint run=a@b: too old" -> "refused_a_checkpoint". At most 64 bytes; "message" where there is no
/// word.
std::string CodeOf(std::string_view text);

struct LogRecord {
  std::uint64_t time_ms = 0;  ///< since 1970
  std::string level;          ///< warn | error
  std::string code, text;
};

/// Hears what is logged at warn and above, for as long as it lives, after InitLog. `hear` is called from whichever
/// thread logs, one call at a time: it must be quick and must not log.
class LogListener {
 public:
  explicit LogListener(std::function<void(const LogRecord&)> hear);
  ~LogListener();
  LogListener(const LogListener&) = delete;
  LogListener& operator=(const LogListener&) = delete;

 private:
  std::uint64_t id_ = 0;
};

}  // namespace etude
