// SPDX-License-Identifier: Apache-2.0
// Logging. Include from .cc files only. Constant text first, then fields: Log(...)->info("committed
// episode={} attempt={}", ...). Levels: error = an operator must act, warn = degraded and counted,
// info = lifecycle, debug = the rest. Everything goes to stderr; stdout is for results.
#pragma once

#include <spdlog/spdlog.h>

#include <string>

namespace etude {

/// Sets up the process's logger once, in main: `name` stands in front of each line.
/// `level`: error | warn | info | debug.
void InitLog(const std::string& name, const std::string& level);

/// The process's logger. Thread-safe.
spdlog::logger& Log();

}  // namespace etude
