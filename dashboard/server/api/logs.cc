// SPDX-License-Identifier: Apache-2.0
// GET /logs: the ends of log files, by offset; never a whole file.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <ctime>
#include <optional>

#include "dashboard/server/api/context.h"

namespace etude::api {
namespace {

constexpr std::uint64_t kWindow = 512 * 1024;  // bytes that one answer looks at, of each file
constexpr std::size_t kLongestLine = 4000;
constexpr std::size_t kMostMerged = 12;  // files, newest first, where none is chosen
constexpr std::array<const char*, 4> kLevels{"debug", "info", "warn", "error"};

struct Line {
  std::string source, time, level, text;
  double order = 0;  // seconds since 1970 that it is sorted by
  std::uint64_t offset = 0;
};

int RankOf(const std::string& level) {
  const auto found = std::ranges::find(kLevels, level);
  return found == kLevels.end() ? -1 : static_cast<int>(found - kLevels.begin());
}

// "17:22:57 info etude-worker: text"; other lines are text alone
void Understand(Line& line) {
  const auto first = line.text.find(' ');
  if (first == std::string::npos || first < 5 || first > 32 || line.text[2] != ':') return;
  const auto second = line.text.find(' ', first + 1);
  if (second == std::string::npos) return;
  const std::string level = line.text.substr(first + 1, second - first - 1);
  if (RankOf(level) < 0) return;
  line.time = line.text.substr(0, first);
  line.level = level;
}

// Seconds since 1970 of a time of day, "17:22:57" or "17:22:57.250", which is before `latest`, or a little after it:
// several processes write one file, not quite in order, and clocks are set back in autumn. nullopt: no time of day.
std::optional<double> LastTimeAt(const std::string& time_of_day, double latest) {
  constexpr double kSlack_s = 2 * 3600, kSlackOverMidnight_s = 10;
  int hour = 0, minute = 0;
  double second = 0;
  if (std::sscanf(time_of_day.c_str(), "%2d:%2d:%lf", &hour, &minute, &second) < 2) return std::nullopt;
  if (hour < 0 || hour > 23 || minute < 0 || minute > 59 || !(second >= 0 && second < 61)) return std::nullopt;
  const auto whole = static_cast<std::time_t>(latest);
  const auto on = [&](int days_before) {
    std::tm parts{};
    ::localtime_r(&whole, &parts);
    parts.tm_mday -= days_before, parts.tm_hour = hour, parts.tm_min = minute, parts.tm_sec = 0;
    parts.tm_isdst = -1;
    return static_cast<double>(std::mktime(&parts)) + second;
  };
  if (const double next_day = on(-1); next_day <= latest + kSlackOverMidnight_s) return next_day;
  if (const double same_day = on(0); same_day <= latest + kSlack_s) return same_day;
  return on(1);
}

// Lines have a time of day alone: the day of the last one is that of the file's last change, and one whose time of day
// is after that of the line behind it is of the day before. A line without a time, or with an earlier one, stays behind
// the one before it; a file that has no times counts as of its last change.
void Date(std::vector<Line>& lines, double file_changed) {
  std::vector<std::optional<double>> times(lines.size());
  double latest = file_changed;
  for (std::size_t i = lines.size(); i-- > 0;)
    if (!lines[i].time.empty() && (times[i] = LastTimeAt(lines[i].time, latest))) latest = *times[i];
  double order = latest;  // the first time that there is: lines before it have none
  for (std::size_t i = 0; i < lines.size(); ++i) lines[i].order = order = std::max(order, times[i].value_or(order));
}

struct Window {
  std::vector<Line> lines;
  bool more = false;  // older ones in the file
  std::uint64_t begin = 0;
};

// Whole lines that end before `before` bytes, of at most kWindow bytes.
Result<Window> ReadWindow(const sources::Catalog::LogFile& log, std::uint64_t before) {
  ETUDE_ASSIGN_OR_RETURN(const auto open, sources::OpenBelow(log.folder, log.file));
  const std::uint64_t end = std::min(before, open.stamp.size), begin = end > kWindow ? end - kWindow : 0;
  std::string text(end - begin, '\0');
  ETUDE_ASSIGN_OR_RETURN(const std::size_t got, ReadAt(open.file.get(), log.file, begin,
                                                       {reinterpret_cast<std::uint8_t*>(text.data()), text.size()}));
  text.resize(got);
  std::size_t at = 0;
  if (begin > 0) at = std::min(text.find('\n') + 1, text.size());  // npos + 1 is 0: one line as long as the window
  // all of it is the end of one line: shown as it is, else the page before would be this one again
  if (at == text.size()) at = 0;
  Window window;
  window.begin = begin + at;
  window.more = window.begin > 0;
  while (at < text.size()) {
    const auto newline = std::min(text.find('\n', at), text.size());
    Line line;
    line.source = log.id, line.text = text.substr(at, std::min(newline - at, kLongestLine));
    line.offset = begin + at;
    // a progress line that was written over itself: what stands last counts
    if (const auto over = line.text.rfind('\r'); over != std::string::npos && over + 1 < line.text.size())
      line.text.erase(0, over + 1);
    Understand(line);
    if (!line.text.empty()) window.lines.push_back(std::move(line));
    at = newline + 1;
  }
  Date(window.lines, open.stamp.modified_s());
  return window;
}

bool Fits(const Line& line, int rank, const std::string& text) {
  // a line without a level belongs to the one before it, and is shown with everything
  if (rank > 0 && RankOf(line.level) < rank) return false;
  return text.empty() || line.text.find(text) != std::string::npos;
}

OrderedJson LineJson(const Line& line) {
  return {{"source", line.source},
          {"n", line.offset},
          {"t", sources::TextOrNull(line.time)},
          {"level", sources::TextOrNull(line.level)},
          {"text", line.text}};
}

std::vector<sources::Catalog::LogFile> Newest(const std::vector<sources::Catalog::LogFile>& logs) {
  std::vector<std::pair<double, const sources::Catalog::LogFile*>> dated;
  for (const auto& log : logs) dated.emplace_back(sources::StampOf(log.folder / log.file).modified_s(), &log);
  std::ranges::stable_sort(dated, std::greater<>(), [](const auto& item) { return item.first; });
  std::vector<sources::Catalog::LogFile> newest;
  for (const auto& [time, log] : dated)
    if (newest.size() < kMostMerged) newest.push_back(*log);
  return newest;
}

OrderedJson SourcesJson(const std::vector<sources::Catalog::LogFile>& logs) {
  OrderedJson json = OrderedJson::array();
  for (const auto& log : logs) {
    const auto stamp = sources::StampOf(log.folder / log.file);
    if (stamp.exists() && json.size() < 500)
      json.push_back({{"id", log.id},
                      {"name", log.file.string()},
                      {"bytes", stamp.size},
                      {"updated", sources::Rfc3339(stamp.modified_s())}});
  }
  return json;
}

}  // namespace

Result<OrderedJson> LogsJson(Context& context, const http::Query& query) {
  ETUDE_ASSIGN_OR_RETURN(const auto limit, query.Integer("limit", 200, 1, 500));
  ETUDE_ASSIGN_OR_RETURN(const auto before, query.Integer("before", INT64_MAX, 0, INT64_MAX));
  const std::string source = query.Get("source").value_or(""), text = query.Get("q").value_or("");
  const std::string level = query.Get("level").value_or("debug");
  if (RankOf(level) < 0)
    return Fail(Code::kInvalidArgument, "level: " + NotKnown(level.substr(0, 40), {kLevels.begin(), kLevels.end()}));
  const auto logs = context.sources.catalog().Logs();
  std::vector<sources::Catalog::LogFile> chosen;
  for (const auto& log : *logs)
    if (log.id == source) chosen.push_back(log);
  if (!source.empty() && chosen.empty()) return Fail(Code::kNotFound, fmt::format("there is no log '{:.100}'", source));
  if (source.empty()) chosen = Newest(*logs);
  std::vector<Line> lines;
  bool more = false;
  std::uint64_t begin = 0;
  for (const auto& log : chosen) {
    auto window = ReadWindow(log, static_cast<std::uint64_t>(before));
    if (!window) continue;  // it went away
    more = window->more, begin = window->begin;
    for (auto& line : window->lines)
      if (Fits(line, RankOf(level), text)) lines.push_back(std::move(line));
  }
  std::ranges::stable_sort(lines, {}, &Line::order);
  if (lines.size() > static_cast<std::size_t>(limit)) {
    lines.erase(lines.begin(), lines.end() - limit);
    more = true, begin = lines.front().offset;
  }
  OrderedJson rows = OrderedJson::array();
  for (const auto& line : lines) rows.push_back(LineJson(line));
  return OrderedJson{{"sources", SourcesJson(*logs)},
                     {"lines", rows},
                     {"next", more && chosen.size() == 1 ? OrderedJson(std::to_string(begin)) : OrderedJson()}};
}

void AddLogRoutes(http::Router& router, Context& context) {
  router.Add("GET", kPrefix + "/logs", http::Lane::kFiles,
             [&context](const http::Request& request) -> Result<http::Answer> {
               ETUDE_ASSIGN_OR_RETURN(const OrderedJson json, LogsJson(context, request.query));
               return http::JsonAnswer(json);
             });
}

}  // namespace etude::api
