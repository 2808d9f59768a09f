// SPDX-License-Identifier: Apache-2.0
// GET /datasets/{id}, its episode list and its distributions.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "dashboard/server/api/context.h"
#include "dashboard/server/api/episode_filter.h"

namespace etude::api {
namespace {

using sources::EpisodeRow;
using sources::Maybe;
using sources::TextOrNull;

// Also begins to read what is not known of its rows.
Result<OpenedDataset> OpenRequested(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(auto opened, OpenDataset(context, request.Parameter("id")));
  if (opened.view->known + opened.view->info.unreadable < opened.view->rows.size())
    context.ReadInBackground(opened.source);
  return opened;
}

Result<http::Answer> Dataset(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const OpenedDataset opened, OpenRequested(context, request));
  const auto& [source, view] = opened;
  const auto& info = view->info;
  const auto state = StateOf(view.get(), LiveOf(*context.live(), *view));
  std::map<std::string, std::uint64_t> failures;
  for (const auto& row : view->failures) ++failures[row.outcome];
  OrderedJson unreadable = OrderedJson::array();
  for (const auto& [index, reason] : info.unreadable_files)
    unreadable.push_back({{"index", index}, {"reason", reason}});
  std::vector<std::string> keys{"train", "valid", "test"};
  for (auto& key : source->Keys()) keys.push_back(std::move(key));
  std::uint64_t bytes = 0;
  for (const auto& row : view->rows) bytes += row.bytes;
  return http::JsonAnswer({{"id", source->found().id},
                           {"name", source->found().name},
                           {"folder", source->found().shown},
                           {"path", source->found().folder.string()},
                           {"role", source->found().eval.empty() ? "demonstrations" : "rollouts"},
                           {"eval", TextOrNull(source->found().eval)},
                           {"state", state.state},
                           {"updated", sources::TimeJson(state.updated)},
                           {"age_ms", AgeOf(state.updated)},
                           {"identity", TextOrNull(info.identity)},
                           {"schema_version", info.schema_version},
                           {"content", info.content},
                           {"spec", http::ForBrowsers(info.spec_json)},
                           {"spec_sha256", info.spec_sha256},
                           {"statistics", http::ForBrowsers(info.statistics)},
                           {"episodes", view->rows.size()},
                           {"known", view->known},
                           {"total", state.total},
                           {"failed_attempts", failures},
                           {"unreadable", info.unreadable},
                           {"unreadable_files", unreadable},
                           {"journal", info.journal},
                           {"keys", keys},
                           {"cameras", {"front"}},
                           {"bytes", bytes}});
}

// ---- the list -----------------------------------------------------------------------------------

double KeyOf(const EpisodeRow& row, const std::string& name) {
  if (name == "steps") return static_cast<double>(row.steps);
  if (name == "odd") return row.odd.value_or(-1);
  if (name == "t") return row.t.value_or(0);
  if (name == "draws") return static_cast<double>(row.draws);
  if (name == "bytes") return static_cast<double>(row.bytes);
  return static_cast<double>(row.index);
}

Result<void> Sort(std::vector<const EpisodeRow*>& rows, std::string order) {
  const bool descending = order.starts_with('-');
  if (descending) order.erase(0, 1);
  static const std::vector<std::string> known{"index", "steps", "odd", "t", "draws", "bytes"};
  if (std::ranges::find(known, order) == known.end())
    return Fail(Code::kInvalidArgument, "sort: " + NotKnown(order.substr(0, 40), known));
  std::ranges::stable_sort(rows, [&](const auto* a, const auto* b) {
    const double x = KeyOf(*a, order), y = KeyOf(*b, order);
    return descending ? x > y : x < y;
  });
  return {};
}

using Cell = std::function<OrderedJson(const EpisodeRow&)>;

// A table's columns by name; what is not known is null.
std::vector<std::pair<const char*, Cell>> EpisodeColumns() {
  const auto if_known = [](auto member) -> Cell {
    return [member](const EpisodeRow& row) { return row.known ? OrderedJson(row.*member) : OrderedJson(); };
  };
  const auto text = [](auto member) -> Cell {
    return [member](const EpisodeRow& row) {
      return row.known || !(row.*member).empty() ? OrderedJson(row.*member) : OrderedJson();
    };
  };
  const auto worker = [](auto member) -> Cell {
    return [member](const EpisodeRow& row) { return TextOrNull(row.*member); };
  };
  return {{"index", [](const EpisodeRow& row) { return OrderedJson(row.index); }},
          {"task", text(&EpisodeRow::task)},
          {"target", text(&EpisodeRow::target)},
          {"reference", text(&EpisodeRow::reference)},
          {"robot", text(&EpisodeRow::robot)},
          {"outcome", text(&EpisodeRow::outcome)},
          {"success",
           [](const EpisodeRow& row) { return row.known ? OrderedJson(row.outcome == "success") : OrderedJson(); }},
          {"split", [](const EpisodeRow& row) { return OrderedJson(row.split); }},
          {"worker", worker(&EpisodeRow::worker)},
          {"host", worker(&EpisodeRow::host)},
          {"instruction", text(&EpisodeRow::instruction)},
          {"attempt", if_known(&EpisodeRow::attempt)},
          {"steps", if_known(&EpisodeRow::steps)},
          {"frames", if_known(&EpisodeRow::frames)},
          {"bytes", if_known(&EpisodeRow::bytes)},
          {"draws", if_known(&EpisodeRow::draws)},
          {"odd", [](const EpisodeRow& row) { return Maybe(row.odd); }},
          {"t", [](const EpisodeRow& row) { return sources::TimeJson(row.t); }}};
}

OrderedJson Columns(const std::vector<const EpisodeRow*>& rows) {
  OrderedJson json = OrderedJson::object();
  for (const auto& [name, cell] : EpisodeColumns()) {
    OrderedJson column = OrderedJson::array();
    for (const auto* row : rows) column.push_back(cell(*row));
    json[name] = std::move(column);
  }
  return json;
}

Result<std::vector<const EpisodeRow*>> Filtered(const OpenedDataset& opened, const http::Query& query) {
  ETUDE_ASSIGN_OR_RETURN(const auto filter, EpisodeFilter::From(query, *opened.source));
  std::vector<const EpisodeRow*> rows;
  for (const auto& row : opened.view->rows)
    if (filter.Holds(row)) rows.push_back(&row);
  return rows;
}

Result<http::Answer> Episodes(Context& context, const http::Request& request) {
  constexpr std::int64_t kMost = 500, kUsual = 50, kFar = 100'000'000;
  ETUDE_ASSIGN_OR_RETURN(const OpenedDataset opened, OpenRequested(context, request));
  ETUDE_ASSIGN_OR_RETURN(const auto limit, request.query.Integer("limit", kUsual, 1, kMost));
  // opaque to clients: how many rows came before
  ETUDE_ASSIGN_OR_RETURN(const auto offset, request.query.Integer("before", 0, 0, kFar));
  ETUDE_ASSIGN_OR_RETURN(auto rows, Filtered(opened, request.query));
  ETUDE_RETURN_IF_ERROR(Sort(rows, request.query.Get("sort").value_or("-index")));
  const std::size_t total = rows.size();
  const auto first = std::min(total, static_cast<std::size_t>(offset));
  const auto last = std::min(total, first + static_cast<std::size_t>(limit));
  const std::vector<const EpisodeRow*> page(rows.begin() + static_cast<std::ptrdiff_t>(first),
                                            rows.begin() + static_cast<std::ptrdiff_t>(last));
  return http::JsonAnswer({{"total", total},
                           {"all", opened.view->rows.size()},
                           {"known", opened.view->known},
                           {"next", last < total ? OrderedJson(std::to_string(last)) : OrderedJson()},
                           {"columns", Columns(page)}});
}

// ---- distributions ------------------------------------------------------------------------------

using Rows = std::vector<const EpisodeRow*>;
using Counts = std::map<std::string, std::uint64_t>;

Counts CountBy(const Rows& rows, std::string EpisodeRow::*member) {
  Counts counts;
  for (const auto* row : rows)
    if (!(row->*member).empty()) ++counts[row->*member];
  return counts;
}

// What the spec's weights ask for of each task, its targets equally often.
std::map<std::pair<std::string, std::string>, double> Expected(const sources::DatasetInfo& info) {
  const CampaignSpec& spec = info.spec;
  std::map<std::pair<std::string, std::string>, double> expected;
  const bool weighted = spec.task_weights.size() == spec.tasks.size();
  double sum = 0;
  for (std::size_t i = 0; i < spec.tasks.size(); ++i) sum += weighted ? spec.task_weights[i] : 1;
  if (!(sum > 0) || spec.objects.empty() || !spec.rollout.sentences.empty()) return expected;
  for (std::size_t i = 0; i < spec.tasks.size(); ++i)
    for (const auto& object : spec.objects)
      expected[{spec.tasks[i], object}] = static_cast<double>(sources::WantedOf(info)) *
                                          (weighted ? spec.task_weights[i] : 1) / sum /
                                          static_cast<double>(spec.objects.size());
  return expected;
}

OrderedJson Matrix(const Rows& rows, const std::map<std::pair<std::string, std::string>, double>& expected) {
  std::map<std::pair<std::string, std::string>, std::uint64_t> counts;
  for (const auto& [cell, count] : expected) counts[cell];
  for (const auto* row : rows)
    if (!row->task.empty()) ++counts[{row->task, row->target}];
  OrderedJson json = OrderedJson::array();
  for (const auto& [cell, count] : counts) {
    const auto wanted = expected.find(cell);
    json.push_back({{"task", cell.first},
                    {"target", cell.second},
                    {"count", count},
                    {"expected", wanted == expected.end() ? OrderedJson() : OrderedJson(wanted->second)}});
  }
  return json;
}

OrderedJson Lengths(const Rows& rows) {
  constexpr std::size_t kBins = 24;
  std::uint64_t low = UINT64_MAX, high = 0;
  for (const auto* row : rows)
    if (row->known) low = std::min(low, row->steps), high = std::max(high, row->steps);
  if (high < low) return {{"edges_steps", OrderedJson::array()}, {"counts", OrderedJson::array()}};
  const double width = std::max(1.0, std::ceil(static_cast<double>(high - low + 1) / kBins));
  std::vector<double> edges;
  for (std::size_t i = 0; i <= kBins; ++i) edges.push_back(static_cast<double>(low) + width * static_cast<double>(i));
  std::vector<std::uint64_t> counts(kBins, 0);
  for (const auto* row : rows)
    if (row->known)
      ++counts[std::min(kBins - 1, static_cast<std::size_t>(static_cast<double>(row->steps - low) / width))];
  return {{"edges_steps", edges}, {"counts", counts}};
}

OrderedJson Words(const Rows& rows) {
  constexpr std::size_t kMost = 200;
  Counts counts;
  for (const auto* row : rows)
    for (auto& word : WordsOf(row->instruction)) ++counts[std::move(word)];
  std::vector<std::pair<std::string, std::uint64_t>> sorted(counts.begin(), counts.end());
  std::ranges::stable_sort(sorted, std::greater<>(), [](const auto& item) { return item.second; });
  OrderedJson json = OrderedJson::array();
  for (const auto& [word, count] : sorted)
    if (json.size() < kMost) json.push_back({{"word", word}, {"count", count}});
  return json;
}

OrderedJson Places(const Rows& rows) {
  constexpr std::size_t kMost = 2000;
  Rows placed;
  for (const auto* row : rows)
    if (row->place_m) placed.push_back(row);
  OrderedJson json{{"index", OrderedJson::array()},
                   {"x_m", OrderedJson::array()},
                   {"y_m", OrderedJson::array()},
                   {"task", OrderedJson::array()},
                   {"target", OrderedJson::array()}};
  const std::size_t n = std::min(kMost, placed.size());
  for (std::size_t i = 0; i < n; ++i) {
    const auto& row = *placed[i * placed.size() / n];
    json["index"].push_back(row.index);
    json["x_m"].push_back((*row.place_m)[0]);
    json["y_m"].push_back((*row.place_m)[1]);
    json["task"].push_back(row.task);
    json["target"].push_back(row.target);
  }
  return json;
}

OrderedJson Odd(Rows rows) {
  constexpr std::size_t kMost = 50;
  std::erase_if(rows, [](const auto* row) { return !row->odd; });
  std::ranges::stable_sort(rows, std::greater<>(), [](const auto* row) { return *row->odd; });
  OrderedJson json = OrderedJson::array();
  for (const auto* row : rows)
    if (json.size() < kMost)
      json.push_back({{"index", row->index}, {"odd", *row->odd}, {"what", row->odd_what}, {"task", row->task}});
  return json;
}

Result<http::Answer> Summary(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const OpenedDataset opened, OpenRequested(context, request));
  ETUDE_ASSIGN_OR_RETURN(const auto filter, EpisodeFilter::From(request.query, *opened.source));
  ETUDE_ASSIGN_OR_RETURN(const auto rows, Filtered(opened, request.query));
  const auto known =
      static_cast<std::uint64_t>(std::ranges::count_if(rows, [](const auto* row) { return row->known; }));
  Counts draws;
  for (const auto* row : rows)
    if (row->draws > 0) ++draws[std::to_string(row->draws)];
  const auto expected = filter.empty() && !opened.view->info.derived
                            ? Expected(opened.view->info)
                            : std::map<std::pair<std::string, std::string>, double>{};
  return http::JsonAnswer({{"total", rows.size()},
                           {"known", known},
                           {"tasks", CountBy(rows, &EpisodeRow::task)},
                           {"targets", CountBy(rows, &EpisodeRow::target)},
                           {"robots", CountBy(rows, &EpisodeRow::robot)},
                           {"outcomes", CountBy(rows, &EpisodeRow::outcome)},
                           {"splits", CountBy(rows, &EpisodeRow::split)},
                           {"workers", CountBy(rows, &EpisodeRow::worker)},
                           {"matrix", Matrix(rows, expected)},
                           {"lengths", Lengths(rows)},
                           {"draws", draws},
                           {"words", Words(rows)},
                           {"places", Places(rows)},
                           {"odd", Odd(rows)}});
}

}  // namespace

void AddDatasetRoutes(http::Router& router, Context& context) {
  const auto add = [&](const std::string& path, auto handler) {
    router.Add("GET", kPrefix + path, http::Lane::kFiles,
               [&context, handler](const http::Request& request) { return handler(context, request); });
  };
  add("/datasets/{id}", Dataset);
  add("/datasets/{id}/episodes", Episodes);
  add("/datasets/{id}/summary", Summary);
}

}  // namespace etude::api
