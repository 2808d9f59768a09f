// SPDX-License-Identifier: Apache-2.0
// A campaign: its spec and status, its attempts, and a cell for each of its episodes.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <map>

#include "dashboard/server/api/arrays.h"
#include "dashboard/server/api/context.h"
#include "dashboard/server/api/replays.h"
#include "services/core/statistics.h"
#include "services/episode/bounded_json.h"
#include "services/spec/episode_plan.h"

namespace etude::api {
namespace {

using sources::Maybe;
using sources::TextOrNull;

// What is known of a campaign: a dataset's view, what is heard, or both.
struct OpenedCampaign {
  std::string id, name, dataset;
  std::shared_ptr<sources::DatasetSource> source;    // null: on the bus only
  std::shared_ptr<const sources::DatasetView> view;  // null: the same
  std::shared_ptr<const live::LiveView> live;
  const live::LiveCampaign* heard = nullptr;  // in `live`
};

// From its folder, also where a page still asks for its name on the bus.
Result<OpenedCampaign> Open(Context& context, const std::string& id) {
  OpenedCampaign opened;
  opened.id = id;
  opened.live = context.live();
  auto folder = OpenSource(context.sources.Dataset(id));
  if (folder) {
    opened.source = std::move(folder->source), opened.view = std::move(folder->view);
    opened.name = opened.view->info.spec.name;
    opened.dataset = opened.source->found().id;
    opened.heard = LiveOf(*opened.live, *opened.view);
    return opened;
  }
  for (const auto& [identity, campaign] : opened.live->campaigns)
    if (BusId(campaign.presence) == id) opened.heard = &campaign, opened.name = campaign.presence.name;
  if (!opened.heard) return Fail(folder.error());
  return opened;
}

// ---- /campaigns/{id} ------------------------------------------------------------------------------

// By reason, stage, task and robot.
using FailureCounts = std::map<std::array<std::string, 4>, std::uint64_t>;

// Where there are more rows than are answered, the rare ones are added up without the parts that are not kept, so that
// the sum of all stays the number of failures. A reason that is not kept is "other".
void Coarsen(FailureCounts& counts, const std::array<bool, 4>& kept) {
  constexpr std::size_t kMost = 500, kWhole = 400;
  if (counts.size() <= kMost) return;
  std::vector<std::pair<std::array<std::string, 4>, std::uint64_t>> rows(counts.begin(), counts.end());
  std::ranges::stable_sort(rows, std::greater<>(), [](const auto& row) { return row.second; });
  counts = FailureCounts(rows.begin(), rows.begin() + kWhole);
  for (std::size_t i = kWhole; i < rows.size(); ++i) {
    auto key = rows[i].first;
    for (std::size_t part = 0; part < key.size(); ++part)
      if (!kept[part]) key[part] = part == 0 ? "other" : "";
    counts[key] += rows[i].second;
  }
}

OrderedJson FailuresBy(const sources::DatasetView& view) {
  FailureCounts counts;
  for (const auto& row : view.failures) ++counts[{row.outcome, row.stage, row.task, row.robot}];
  Coarsen(counts, {true, false, true, false});  // the table of reasons and tasks stays right
  Coarsen(counts, {true, false, false, false});
  Coarsen(counts, {false, false, false, false});
  OrderedJson json = OrderedJson::array();
  for (const auto& [key, count] : counts)
    json.push_back(
        {{"reason", key[0]}, {"stage", TextOrNull(key[1])}, {"task", key[2]}, {"robot", key[3]}, {"count", count}});
  return json;
}

// Where the time of attempts went: failed ones from attempts.jsonl, committed ones from the journal.
OrderedJson Timing(const sources::DatasetView& view) {
  constexpr std::size_t kBins = 12;
  std::vector<double> plans;
  double plan = 0, step = 0, render = 0, deflate = 0, send = 0;
  bool sent = false;
  std::uint64_t n = 0;
  const auto take = [&](const auto& row) {
    if (!row.plan_s) return;
    ++n;
    plans.push_back(*row.plan_s);
    plan += *row.plan_s, step += row.step_s.value_or(0);
    render += row.render_s.value_or(0), deflate += row.deflate_s.value_or(0);
  };
  for (const auto& row : view.failures) take(row);
  for (const auto& row : view.rows) {
    take(row);
    if (row.send_s) send += *row.send_s, sent = true;
  }
  if (n == 0) return nullptr;
  std::vector<double> edges{0};
  for (double edge = 0.01; edges.size() <= kBins; edge *= 2) edges.push_back(edge);
  std::vector<std::uint64_t> counts(kBins, 0);
  for (const double value : plans) {
    std::size_t bin = 0;
    while (bin + 1 < kBins && value >= edges[bin + 1]) ++bin;
    ++counts[bin];
  }
  return {{"attempts", n},
          {"plan_s", plan},
          {"step_s", step},
          {"render_s", render},
          {"deflate_s", deflate},
          {"send_s", sent ? OrderedJson(send) : OrderedJson()},
          {"plan_p50_s", Quantile(plans, 0.5)},
          {"plan_p95_s", Quantile(plans, 0.95)},
          {"plan_histogram", {{"edges_s", edges}, {"counts", counts}}}};
}

OrderedJson SpecOf(const OpenedCampaign& opened) {
  if (opened.view) return http::ForBrowsers(opened.view->info.spec_json);
  const auto json = ParseBoundedJson(opened.heard->spec_json);
  return json && json->is_object() ? http::ForBrowsers(*json) : OrderedJson();
}

OrderedJson TextsOf(const OrderedJson& spec, const char* key) {
  const auto& list = sources::PartOf(spec, key);
  return list.is_array() ? list : OrderedJson::array();
}

Result<http::Answer> Campaign(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const OpenedCampaign opened, Open(context, request.Parameter("id")));
  const auto state = StateOf(opened.view.get(), opened.heard);
  const OrderedJson spec = SpecOf(opened);
  OrderedJson failures = OrderedJson::object();
  if (opened.view) {
    std::map<std::string, std::uint64_t> counts;
    for (const auto& row : opened.view->failures) ++counts[row.outcome];
    failures = counts;
  } else if (opened.heard->status) {
    if (auto json = ParseBoundedJson(opened.heard->status->failures_json); json && json->is_object())
      failures = std::move(*json);
  }
  return http::JsonAnswer({{"id", opened.id},
                           {"name", opened.name},
                           {"state", state.state},
                           {"dataset", TextOrNull(opened.dataset)},
                           {"spec", spec},
                           {"spec_sha256", opened.view ? OrderedJson(opened.view->info.spec_sha256) : OrderedJson()},
                           {"status", StatusJson(state)},
                           {"failures", failures},
                           {"failures_by", opened.view ? FailuresBy(*opened.view) : OrderedJson::array()},
                           {"timing", opened.view ? Timing(*opened.view) : OrderedJson()},
                           {"tasks", TextsOf(spec, "tasks")},
                           {"robots", TextsOf(spec, "robots")}});
}

// ---- attempts -------------------------------------------------------------------------------------

// One row, before it is JSON.
struct Row {
  std::uint64_t index = 0, order = 0;
  std::uint32_t attempt = 0;
  std::optional<std::uint64_t> seed;
  std::string outcome, reason, stage, pair, task, target, robot, worker;
  std::optional<double> t, plan_s, step_s, render_s, deflate_s;
  bool has_pictures = false;
};

std::vector<Row> RowsOf(const OpenedCampaign& opened) {
  std::vector<Row> rows;
  if (!opened.view) {
    for (const auto& heard : opened.heard->attempts) {
      Row row;
      row.index = heard.report.index, row.attempt = heard.report.attempt;
      row.outcome = heard.report.outcome, row.worker = heard.report.worker;
      row.t = heard.t;
      if (const auto details = ParseBoundedJson(heard.report.details_json))
        row.reason = sources::TextOf(*details, "reason");
      rows.push_back(std::move(row));
    }
    return rows;
  }
  std::map<std::uint64_t, std::uint64_t> failed;
  for (const auto& failure : opened.view->failures) {
    ++failed[failure.index];
    rows.push_back({failure.index, 0, failure.attempt, failure.seed, failure.outcome, failure.reason, failure.stage,
                    failure.pair, failure.task, failure.target, failure.robot, failure.worker, failure.t,
                    failure.plan_s, failure.step_s, failure.render_s, failure.deflate_s, false});
  }
  for (const auto& row : opened.view->rows)
    rows.push_back({row.index, 0, row.known ? row.attempt : static_cast<std::uint32_t>(failed[row.index]), std::nullopt,
                    row.known ? row.outcome : "success", "", "", "", row.task, row.target, row.robot, row.worker, row.t,
                    row.plan_s, row.step_s, row.render_s, row.deflate_s, true});
  // by time where all have one, else by index, which is how leases go: between some times and some indices there is no
  // order
  const bool timed = std::ranges::all_of(rows, [](const Row& row) { return row.t.has_value(); });
  std::ranges::stable_sort(rows, [&](const Row& a, const Row& b) {
    if (timed && *a.t != *b.t) return *a.t > *b.t;
    return std::pair(a.index, a.attempt) > std::pair(b.index, b.attempt);
  });
  return rows;
}

OrderedJson RowJson(Context& context, const Row& row, const OpenedCampaign& opened) {
  const bool planned = opened.view && row.index < 10'000'000;
  const std::string seed = row.seed  ? std::to_string(*row.seed)
                           : planned ? std::to_string(EpisodeSeed(opened.view->info.spec, row.index, row.attempt))
                                     : "";
  const bool lost = opened.view && !row.has_pictures;
  const std::string replay =
      lost ? PicturedReplay(context, {opened.source, opened.view}, row.index, row.attempt) : std::string();
  return {{"index", row.index},
          {"attempt", row.attempt},
          {"seed", seed},
          {"outcome", row.outcome},
          {"reason", TextOrNull(row.reason)},
          {"stage", TextOrNull(row.stage)},
          {"pair", TextOrNull(row.pair)},
          {"robot", row.robot},
          {"task", row.task},
          {"target", row.target},
          {"worker", TextOrNull(row.worker)},
          {"t", sources::TimeJson(row.t)},
          {"plan_s", Maybe(row.plan_s)},
          {"step_s", Maybe(row.step_s)},
          {"render_s", Maybe(row.render_s)},
          {"deflate_s", Maybe(row.deflate_s)},
          {"has_pictures", row.has_pictures},
          {"replay", TextOrNull(replay)}};
}

Result<std::vector<Row>> Filtered(const OpenedCampaign& opened, const http::Query& query) {
  auto rows = RowsOf(opened);
  const auto keep = [&](const char* key, std::string Row::*member) {
    const auto wanted = query.All(key);
    if (!wanted.empty())
      std::erase_if(rows, [&](const Row& row) { return std::ranges::find(wanted, row.*member) == wanted.end(); });
  };
  keep("task", &Row::task);
  keep("robot", &Row::robot);
  keep("target", &Row::target);
  keep("reason", &Row::outcome);
  keep("worker", &Row::worker);
  keep("stage", &Row::stage);
  const std::string outcome = query.Get("outcome").value_or("all");
  if (outcome != "all" && outcome != "success" && outcome != "failed")
    return Fail(Code::kInvalidArgument, "outcome: " + NotKnown(outcome.substr(0, 40), {"all", "success", "failed"}));
  if (outcome != "all") std::erase_if(rows, [&](const Row& row) { return row.has_pictures != (outcome == "success"); });
  ETUDE_ASSIGN_OR_RETURN(const auto index, query.Integer("index", -1, -1, INT64_MAX));
  if (index >= 0) std::erase_if(rows, [&](const Row& row) { return row.index != static_cast<std::uint64_t>(index); });
  return rows;
}

Result<http::Answer> Attempts(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const OpenedCampaign opened, Open(context, request.Parameter("id")));
  ETUDE_ASSIGN_OR_RETURN(const auto limit, request.query.Integer("limit", 50, 1, 200));
  ETUDE_ASSIGN_OR_RETURN(const auto offset, request.query.Integer("before", 0, 0, 100'000'000));
  ETUDE_ASSIGN_OR_RETURN(const auto rows, Filtered(opened, request.query));
  const auto first = std::min(rows.size(), static_cast<std::size_t>(offset));
  const auto last = std::min(rows.size(), first + static_cast<std::size_t>(limit));
  OrderedJson page = OrderedJson::array();
  for (std::size_t i = first; i < last; ++i) page.push_back(RowJson(context, rows[i], opened));
  return http::JsonAnswer({{"campaign", opened.id},
                           {"total", rows.size()},
                           {"next", last < rows.size() ? OrderedJson(std::to_string(last)) : OrderedJson()},
                           {"rows", page}});
}

// ---- cells ----------------------------------------------------------------------------------------

Result<http::Answer> Cells(Context& context, const http::Request& request) {
  constexpr std::uint64_t kMost = 1'000'000;  // the answer's bound
  enum : std::uint8_t { kOpen, kCommitted, kRetried, kGivenUp, kFailed };
  ETUDE_ASSIGN_OR_RETURN(const OpenedCampaign opened, Open(context, request.Parameter("id")));
  const auto state = StateOf(opened.view.get(), opened.heard);
  // without its files nothing is known of single episodes: no cells, rather than all of them open
  std::uint64_t size = opened.view ? state.total : 0;
  // of one made of others' episodes, which may keep their indices: to the last
  if (opened.view && opened.view->info.derived)
    size = opened.view->rows.empty() ? 0 : opened.view->rows.back().index + 1;
  std::vector<std::uint8_t> cells(std::min(size, kMost), kOpen);
  // of a shard its own alone, as they follow each other
  const Shard shard = opened.view && !opened.view->info.derived ? opened.view->info.shard : Shard();
  const auto cell_of = [&](std::uint64_t index) -> std::uint8_t* {
    const std::uint64_t at = index / shard.count;
    return shard.Has(index) && at < cells.size() ? &cells[at] : nullptr;
  };
  if (opened.view) {
    const auto& view = *opened.view;
    for (const auto& row : view.failures)
      if (auto* cell = cell_of(row.index)) *cell = kFailed;
    for (const std::uint64_t index : view.UsedUp())
      if (auto* cell = cell_of(index)) *cell = kGivenUp;
    for (const auto& row : view.rows)
      if (auto* cell = cell_of(row.index)) *cell = *cell == kOpen ? kCommitted : kRetried;
  }
  store::Safetensors content;
  content.tensors["cells"] = TensorOf(store::DType::kU8, cells);
  content.metadata = {{"total", std::to_string(state.total)},
                      {"first", std::to_string(shard.number - 1)},
                      {"step", std::to_string(shard.count)}};
  return ArraysAnswer(content);
}

}  // namespace

Result<OrderedJson> LatestAttempts(Context& context, const std::string& campaign) {
  constexpr std::size_t kMost = 20;
  ETUDE_ASSIGN_OR_RETURN(const OpenedCampaign opened, Open(context, campaign));
  const auto rows = RowsOf(opened);
  OrderedJson newest = OrderedJson::array();
  for (const auto& row : rows)
    if (newest.size() < kMost) newest.push_back(RowJson(context, row, opened));
  return OrderedJson{{"campaign", campaign},
                     {"status", StatusJson(StateOf(opened.view.get(), opened.heard))},
                     {"total", rows.size()},
                     {"rows", newest}};
}

void AddCampaignRoutes(http::Router& router, Context& context) {
  const auto add = [&](const std::string& path, auto handler) {
    router.Add("GET", kPrefix + path, http::Lane::kFiles,
               [&context, handler](const http::Request& request) { return handler(context, request); });
  };
  add("/campaigns/{id}", Campaign);
  add("/campaigns/{id}/attempts", Attempts);
  add("/campaigns/{id}/cells", Cells);
}

}  // namespace etude::api
