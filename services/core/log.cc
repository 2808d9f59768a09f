// SPDX-License-Identifier: Apache-2.0
#include "services/core/log.h"

#include <spdlog/sinks/stdout_color_sinks.h>

#include <memory>

namespace etude {

void InitLog(const std::string& name, const std::string& level) {
  auto logger = std::make_shared<spdlog::logger>(name, std::make_shared<spdlog::sinks::stderr_color_sink_mt>());
  logger->set_pattern("%H:%M:%S %^%l%$ %n: %v");
  logger->set_level(spdlog::level::from_str(level));
  logger->flush_on(spdlog::level::info);
  spdlog::set_default_logger(std::move(logger));
}

spdlog::logger& Log() { return *spdlog::default_logger_raw(); }

}  // namespace etude
