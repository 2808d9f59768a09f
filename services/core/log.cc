// SPDX-License-Identifier: Apache-2.0
#include "services/core/log.h"

#include <fmt/chrono.h>
#include <spdlog/formatter.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cctype>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>

#include "services/core/progress.h"
#include "services/core/thread_annotations.h"

namespace etude {
namespace {

constexpr std::size_t kLongestCode = 64;

std::atomic<LogFormat> log_format{LogFormat::kText};

struct Listeners {
  Mutex mutex;
  std::uint64_t last ETUDE_GUARDED_BY(mutex) = 0;
  std::map<std::uint64_t, std::function<void(const LogRecord&)>> by_id ETUDE_GUARDED_BY(mutex);
};

Listeners& GetListeners() {
  static auto* const listeners = new Listeners;  // outlives whoever logs at the end, on purpose
  return *listeners;
}

std::uint64_t Milliseconds(spdlog::log_clock::time_point time) {
  return static_cast<std::uint64_t>(
      std::chrono::duration_cast<std::chrono::milliseconds>(time.time_since_epoch()).count());
}

std::string LevelOf(spdlog::level::level_enum level) {
  const auto name = spdlog::level::to_string_view(level);
  return level == spdlog::level::warn ? "warn" : std::string(name.data(), name.size());
}

class JsonFormatter : public spdlog::formatter {
 public:
  void format(const spdlog::details::log_msg& message, spdlog::memory_buf_t& to) override {
    const std::string text(message.payload.data(), message.payload.size());
    const std::uint64_t time_ms = Milliseconds(message.time);
    const auto seconds = static_cast<std::time_t>(time_ms / 1000);
    const nlohmann::ordered_json line{
        {"time", fmt::format("{:%Y-%m-%dT%H:%M:%S}.{:03}Z", fmt::gmtime(seconds), time_ms % 1000)},
        {"level", LevelOf(message.level)},
        {"source", std::string(message.logger_name.data(), message.logger_name.size())},
        {"pid", ::getpid()},
        {"code", CodeOf(text)},
        {"text", text}};
    const std::string json = line.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
    to.append(json.data(), json.data() + json.size());
  }
  std::unique_ptr<spdlog::formatter> clone() const override { return std::make_unique<JsonFormatter>(); }
};

// Hands on what listeners hear.
class ListenerSink : public spdlog::sinks::base_sink<std::mutex> {
 protected:
  void sink_it_(const spdlog::details::log_msg& message) override {
    LogRecord record{Milliseconds(message.time), LevelOf(message.level), "",
                     std::string(message.payload.data(), message.payload.size())};
    record.code = CodeOf(record.text);
    auto& listeners = GetListeners();
    const MutexLock lock(listeners.mutex);
    for (const auto& [id, hear] : listeners.by_id) hear(record);
  }
  void flush_() override {}
};

// Before each line that is shown: what is logged stands below no half line of progress.
class ProgressSink : public spdlog::sinks::base_sink<std::mutex> {
 protected:
  void sink_it_(const spdlog::details::log_msg&) override { internal::ClearProgress(); }
  void flush_() override {}
};

// Of a word as users write it; none for what is no level.
std::optional<spdlog::level::level_enum> LevelNamed(const std::string& word) {
  for (const auto level : {spdlog::level::err, spdlog::level::warn, spdlog::level::info, spdlog::level::debug})
    if (word == LevelOf(level) || spdlog::level::from_str(word) == level) return level;
  return std::nullopt;
}

}  // namespace

void SetLogFormat(LogFormat format) { log_format = format; }
LogFormat GetLogFormat() { return log_format; }

void InitLog(const std::string& name, const std::string& level) {
  auto shown = std::make_shared<spdlog::sinks::stderr_color_sink_mt>();
  auto heard = std::make_shared<ListenerSink>();
  heard->set_level(spdlog::level::warn);
  auto progress = std::make_shared<ProgressSink>();
  auto logger = std::make_shared<spdlog::logger>(name, spdlog::sinks_init_list{progress, shown, heard});
  if (log_format == LogFormat::kJson)
    shown->set_formatter(std::make_unique<JsonFormatter>());
  else
    shown->set_pattern("%H:%M:%S %^%l%$ %n: %v");
  const auto known = LevelNamed(level);
  shown->set_level(known.value_or(spdlog::level::info));
  progress->set_level(shown->level());
  logger->set_level(std::min(shown->level(), heard->level()));  // listeners hear warnings whatever is shown
  logger->flush_on(spdlog::level::info);
  spdlog::set_default_logger(std::move(logger));
  // not silence, which spdlog takes an unknown word for
  if (!known && !level.empty()) Log().warn("log level '{}' is none of error, warn, info, debug: info is taken", level);
}

spdlog::logger& Log() { return *spdlog::default_logger_raw(); }

std::string CodeOf(std::string_view text) {
  std::string code;
  while (!text.empty()) {
    const auto end = text.find(' ');
    std::string_view word = text.substr(0, end);
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
    const bool last = word.ends_with(':') || word.ends_with(',') || word.ends_with(';');
    if (last) word.remove_suffix(1);
    // a value: what follows it differs from message to message, too
    const bool plain = !word.empty() && std::all_of(word.begin(), word.end(), [](unsigned char c) {
      return std::isalpha(c) != 0 || c == '-' || c == '\'';
    });
    if (!plain && !word.empty()) break;
    if (code.size() + 1 + word.size() > kLongestCode) break;
    if (!code.empty() && !word.empty()) code += '_';
    for (const char c : word)
      if (std::isalpha(static_cast<unsigned char>(c)) != 0)
        code += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    if (last) break;
  }
  return code.empty() ? "message" : code;
}

LogListener::LogListener(std::function<void(const LogRecord&)> hear) {
  auto& listeners = GetListeners();
  const MutexLock lock(listeners.mutex);
  id_ = ++listeners.last;
  listeners.by_id[id_] = std::move(hear);
}

LogListener::~LogListener() {
  auto& listeners = GetListeners();
  const MutexLock lock(listeners.mutex);
  listeners.by_id.erase(id_);
}

}  // namespace etude
