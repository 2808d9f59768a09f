// SPDX-License-Identifier: Apache-2.0
// GET /logs: the ends of log files, by offsets; never a whole file.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdio>
#include <ctime>
#include <iterator>
#include <map>
#include <optional>
#include <ranges>
#include <string_view>

#include "dashboard/server/api/context.h"
#include "dashboard/server/sources/files.h"
#include "services/episode/bounded_json.h"

namespace etude::api {
namespace {

constexpr std::uint64_t kWindow = 512 * 1024;  // bytes that one answer looks at, of each file
constexpr std::size_t kLongestLine = 4000;
constexpr std::size_t kMostMerged = 12;  // files, newest first, where none is chosen
constexpr std::array<const char*, 4> kLevels{"debug", "info", "warn", "error"};

struct Line {
  std::string source, time, level, text;
  std::optional<double> at;  // seconds since 1970, where it says a time; until Date, where it says the day, too
  double order = 0;          // seconds since 1970 that it is sorted by
  int rank = 1;              // of its level, or of the one that it belongs to
  std::uint64_t offset = 0, end = 0;
};

int RankOf(const std::string& level) {
  const auto found = std::ranges::find(kLevels, level);
  return found == kLevels.end() ? -1 : static_cast<int>(found - kLevels.begin());
}

// A line of --log json: {"time", "level", "source", "text", ...}. @returns false: it is none
bool UnderstandJson(Line& line) {
  if (!line.text.starts_with('{')) return false;
  const OrderedJson json = ParseBoundedJson(line.text, 4).value_or(OrderedJson());
  const std::string level = sources::TextOf(json, "level"), text = sources::TextOf(json, "text");
  line.at = sources::ParseTime(sources::TextOf(json, "time"));
  if (RankOf(level) < 0 || !line.at || text.empty()) {
    line.at.reset();
    return false;
  }
  const auto whole = static_cast<std::time_t>(*line.at);
  std::tm parts{};
  ::localtime_r(&whole, &parts);
  line.time = fmt::format("{:02}:{:02}:{:02}", parts.tm_hour, parts.tm_min, parts.tm_sec);
  line.level = level;
  line.text = sources::TextOf(json, "source") + ": " + text;
  return true;
}

// "17:22:57 info etude-worker: text"; other lines are text alone
void Understand(Line& line) {
  if (UnderstandJson(line)) return;
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
// @param latest  of the last line: the file's last change, or what the page before said
void Date(std::vector<Line>& lines, double latest) {
  for (Line& line : std::views::reverse(lines)) {
    if (!line.at) line.at = LastTimeAt(line.time, latest);
    latest = line.at.value_or(latest);
  }
  double order = latest;  // the first time that there is: lines before it have none
  for (Line& line : lines) line.order = order = std::max(order, line.at.value_or(order));
}

// A line without a level is of the one before it, as the rest of an error is; of none at the begin of a window, and
// when so many follow each other that they are another program's output.
void Rank(std::vector<Line>& lines) {
  constexpr std::size_t kLongestRest = 50;
  constexpr int kInfo = 1;
  int rank = kInfo;
  std::size_t rest = 0;
  for (Line& line : lines) {
    rest = line.level.empty() ? rest + 1 : 0;
    if (rest == 0) rank = RankOf(line.level);
    line.rank = rest > kLongestRest ? kInfo : rank;
  }
}

struct Window {
  std::vector<Line> lines;
  bool more = false;  // older ones in the file
  std::uint64_t begin = 0;
  double oldest = 0;  // order of its first line
};

// Where in a file a page ends, and when what stands there was written, which dates the lines before it: the file may
// have changed since. nullopt: its last change.
struct Place {
  std::uint64_t before = UINT64_MAX;
  std::optional<double> time;  // seconds since 1970
};
using Cursor = std::map<std::string, Place>;  // by file

struct Chosen {
  sources::Catalog::LogFile log;
  Place place;
};

// Whole lines that end before the place, of at most kWindow bytes.
Result<Window> ReadWindow(const Chosen& chosen) {
  const auto& log = chosen.log;
  ETUDE_ASSIGN_OR_RETURN(const auto open, sources::OpenBelow(log.folder, log.file));
  const double latest = chosen.place.time.value_or(open.stamp.modified_s());
  const std::uint64_t end = std::min(chosen.place.before, open.stamp.size), begin = end > kWindow ? end - kWindow : 0;
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
    line.offset = begin + at, line.end = begin + newline + 1;
    // a progress line that was written over itself: what stands last counts
    if (const auto over = line.text.rfind('\r'); over != std::string::npos && over + 1 < line.text.size())
      line.text.erase(0, over + 1);
    Understand(line);
    if (!line.text.empty()) window.lines.push_back(std::move(line));
    at = newline + 1;
  }
  Date(window.lines, latest);
  Rank(window.lines);
  window.oldest = window.lines.empty() ? latest : window.lines.front().order;
  return window;
}

template <class Number>
bool ParseWhole(std::string_view text, Number& number) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  return error == std::errc() && end == text.data() + text.size();
}

// "OFFSET" or "OFFSET@SECONDS". nullopt: neither
std::optional<Place> PlaceIn(std::string_view text) {
  constexpr double kLatest_s = 253'402'300'799;  // the year 9999
  Place place;
  const auto at = text.find('@');
  if (!ParseWhole(text.substr(0, at), place.before)) return std::nullopt;
  if (at == std::string_view::npos) return place;
  double time = 0;
  if (!ParseWhole(text.substr(at + 1), time) || !(time >= 0 && time <= kLatest_s)) return std::nullopt;
  place.time = time;
  return place;
}

// OFFSET@SECONDS in one file, ID@OFFSET@SECONDS,... in several: those not named have no more. Where SECONDS are left
// out, the file's last change stands for them. @error kInvalidArgument
Result<Cursor> CursorIn(const http::Query& query, const std::string& source) {
  Cursor cursor;
  const std::string text = query.Get("before").value_or("");
  for (std::size_t begin = 0; begin < text.size();) {
    const auto comma = std::min(text.find(',', begin), text.size());
    const std::string_view part = std::string_view(text).substr(begin, comma - begin);
    const auto at = source.empty() ? part.find('@') : std::string_view::npos;
    const bool named = at != std::string_view::npos;
    const auto place = PlaceIn(named ? part.substr(at + 1) : part);
    if (!place || named != source.empty() || cursor.size() > kMostMerged)
      return Fail(Code::kInvalidArgument, fmt::format("before={:.40}: not what next of the page before said", text));
    cursor[named ? std::string(part.substr(0, at)) : source] = *place;
    begin = comma + 1;
  }
  return cursor;
}

OrderedJson CursorJson(const Cursor& cursor, const std::string& source) {
  std::string text;
  for (const auto& [id, place] : cursor) {
    if (source.empty()) text += fmt::format("{}{}@", text.empty() ? "" : ",", id);
    text += fmt::format("{}@{:.3f}", place.before, std::max(0.0, place.time.value_or(0)));
  }
  return sources::TextOrNull(text);
}

struct Page {
  std::vector<Line> lines;
  Cursor next;         // where older lines end
  double back_to = 0;  // seconds since 1970; 0: to the begin of every file
};

// The newest lines of all that fit. Where a file has more than its window, others wait for it: what is older than its
// oldest line is of a later page, so that pages are in order of time. @param fits  of a line
template <class Fits>
Page Merge(const std::vector<Chosen>& chosen, std::size_t limit, Fits&& fits) {
  Page page;
  std::vector<Line> fitting;
  for (const auto& one : chosen) {
    auto window = ReadWindow(one);
    if (!window) continue;  // it went away
    if (window->more) {
      page.next[one.log.id] = {window->begin, window->oldest};
      page.back_to = std::max(page.back_to, window->oldest);
    }
    for (auto& line : window->lines)
      if (fits(line)) fitting.push_back(std::move(line));
  }
  std::ranges::stable_sort(fitting, {}, &Line::order);
  std::size_t first = fitting.size() > limit ? fitting.size() - limit : 0;
  while (first < fitting.size() && fitting[first].order < page.back_to) ++first;
  for (std::size_t i = 0; i < first; ++i) {
    const auto [next, fresh] = page.next.try_emplace(fitting[i].source, Place{0, {}});
    if (fitting[i].end > next->second.before) next->second = {fitting[i].end, fitting[i].order};
  }
  if (first > 0) page.back_to = std::max(page.back_to, fitting[first - 1].order);
  page.lines.assign(std::make_move_iterator(fitting.begin() + static_cast<std::ptrdiff_t>(first)),
                    std::make_move_iterator(fitting.end()));
  return page;
}

OrderedJson LineJson(const Line& line) {
  return {{"source", line.source},
          {"n", line.offset},
          {"t", sources::TextOrNull(line.time)},
          {"at", sources::TimeJson(line.at)},
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
  const std::string source = query.Get("source").value_or(""), text = query.Get("q").value_or("");
  ETUDE_ASSIGN_OR_RETURN(const auto cursor, CursorIn(query, source));
  const std::string level = query.Get("level").value_or("debug");
  const int rank = RankOf(level);
  if (rank < 0)
    return Fail(Code::kInvalidArgument, "level: " + NotKnown(level.substr(0, 40), {kLevels.begin(), kLevels.end()}));
  const auto logs = context.sources.catalog().Logs();
  std::vector<Chosen> chosen;
  // the files of the pages before are no matter of which ones are the newest now
  for (const auto& log : source.empty() && cursor.empty() ? Newest(*logs) : *logs) {
    const auto place = cursor.find(log.id);
    if (!source.empty() ? log.id == source : cursor.empty() || place != cursor.end())
      chosen.push_back({log, place == cursor.end() ? Place{} : place->second});
  }
  if (!source.empty() && chosen.empty()) return Fail(Code::kNotFound, fmt::format("there is no log '{:.100}'", source));
  const Page page = Merge(chosen, static_cast<std::size_t>(limit), [&](const Line& line) {
    return line.rank >= rank && (text.empty() || line.text.find(text) != std::string::npos);
  });
  OrderedJson rows = OrderedJson::array();
  for (const auto& line : page.lines) rows.push_back(LineJson(line));
  return OrderedJson{{"sources", SourcesJson(*logs)},
                     {"lines", rows},
                     {"next", CursorJson(page.next, source)},
                     {"searched", chosen.size()},
                     {"back_to", page.back_to > 0 ? OrderedJson(sources::Rfc3339(page.back_to)) : OrderedJson()}};
}

void AddLogRoutes(http::Router& router, Context& context) {
  router.Add("GET", kPrefix + "/logs", http::Lane::kFiles,
             [&context](const http::Request& request) -> Result<http::Answer> {
               ETUDE_ASSIGN_OR_RETURN(const OrderedJson json, LogsJson(context, request.query));
               return http::JsonAnswer(json);
             });
}

}  // namespace etude::api
