// SPDX-License-Identifier: Apache-2.0
// GET /home: the Overview, and whether the gateway is well.
#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <optional>
#include <utility>

#include "dashboard/server/api/context.h"
#include "dashboard/server/api/overview.h"
#include "services/core/command.h"
#include "services/episode/bounded_json.h"
#include "services/monitor/sentence.h"

namespace etude::api {
namespace {

using monitor::CollectionFacts;
using monitor::EvaluationFacts;
using monitor::Facts;
using monitor::PolicyFacts;
using monitor::TrainingFacts;
using sources::Found;
using sources::Kind;
using sources::PartOf;
using sources::TimeJson;

constexpr std::size_t kMostSources = 200;

OrderedJson SourceJson(const std::string& kind, const Found& found, const std::string& name, const std::string& state,
                       double updated, bool live) {
  const bool dataset = found.kind == Kind::kDataset && (!found.folder.empty() || !found.eval.empty());
  return {{"id", found.id},
          {"kind", kind},
          {"name", name},
          {"state", state},
          {"updated", TimeJson(updated)},
          {"age_ms", AgeOf(updated)},
          {"live", live},
          {"folder", sources::TextOrNull(found.shown)},
          {"path", sources::TextOrNull(found.folder.string())},
          {"role", dataset ? OrderedJson(found.eval.empty() ? "demonstrations" : "rollouts") : OrderedJson()}};
}

OrderedJson SourcesJson(const Overview& all) {
  std::vector<std::pair<Standing, OrderedJson>> rows;
  for (const auto& item : all.datasets)
    rows.emplace_back(StandingOf(item), SourceJson(item.view ? "dataset" : "campaign", item.found, item.name,
                                                   item.state.state, item.state.updated, item.state.live));
  for (const auto& item : all.runs)
    rows.emplace_back(StandingOf(item),
                      SourceJson("run", item.found, item.name, item.state.state, item.state.updated, item.state.live));
  for (const auto& item : all.evals)
    rows.emplace_back(StandingOf(item),
                      SourceJson("eval", item.found, item.name, item.state, item.view->updated, false));
  std::ranges::stable_sort(rows, std::less<>(), [](const auto& row) { return row.first; });
  if (rows.size() > kMostSources) rows.resize(kMostSources);
  // a run whose files are elsewhere has no checkpoints and no series here: pages begin with one that has
  std::stable_partition(rows.begin(), rows.end(),
                        [](const auto& row) { return row.second["kind"] != "run" || !row.second["folder"].is_null(); });
  OrderedJson json = OrderedJson::array();
  for (auto& [standing, row] : rows) json.push_back(std::move(row));
  return json;
}

Facts FactsOf(Context& context, const Overview& all) {
  Facts facts;
  if (const auto* item = NewestDataset(all))
    facts.collection = CollectionFacts{item->name,
                                       item->state.control.empty() ? item->state.state : item->state.control,
                                       item->state.committed,
                                       item->state.total,
                                       item->state.given_up,
                                       item->state.eta_s};
  if (const auto* item = NewestRun(all))
    facts.training = TrainingFacts{item->state.state, item->state.stage_name, item->state.stage,    item->state.stages,
                                   item->state.step,  item->state.eta_s,      item->state.elapsed_s};
  if (!all.live->policies.empty()) {
    const auto servers = ServersOf(*all.live);
    facts.policy = servers.size() == 1 ? monitor::FactsOf(servers.front()->status)
                                       : PolicyFacts{std::nullopt, all.live->policies.size(), std::nullopt, true};
  }
  if (const auto* item = NewestEval(all)) {
    const auto& success = PartOf(PartOf(item->view->report, "overall"), "success");
    facts.evaluation = EvaluationFacts{item->state, sources::NumberOf(success, "share").value_or(0),
                                       item->view->rows.size(), WantedRollouts(*item->view)};
  }
  std::string places;
  for (const auto& root : context.sources.catalog().roots()) places += (places.empty() ? "" : ", ") + root.string();
  if (context.domain >= 0) places += fmt::format("{}domain {}", places.empty() ? "" : " and on ", context.domain);
  facts.looked_in = places.empty() ? "no folder and on no bus" : places;
  return facts;
}

// of the most telling part
std::string StateOfAll(const Overview& all) {
  std::vector<std::string> states;
  if (const auto* item = NewestDataset(all)) states.push_back(item->state.state);
  if (const auto* item = NewestRun(all)) states.push_back(item->state.state);
  if (const auto* item = NewestEval(all)) states.push_back(item->state);
  for (const char* state : {"failed", "running", "silent", "stopped", "finished"})
    if (std::ranges::find(states, state) != states.end()) return state;
  return "unknown";
}

// What `etude up` says of itself in a folder that was given: OUT/up.json. Without its word on the bus it is silent: it
// may have been killed.
OrderedJson UpJson(const live::LiveView& live, const Path& root, const OrderedJson& said) {
  const auto ended = sources::NumberOf(said, "ended");
  const bool heard = std::ranges::any_of(live.processes, [&](const auto& item) {
    const auto& status = item.second.message;
    std::error_code error;  // it says how it was started: with links, or a slash at the end
    return status.role == "etude up" && std::filesystem::equivalent(status.folder, root, error);
  });
  const auto exit = sources::UnsignedOf(said, "exit");
  return {{"folder", root.string()},
          {"state", ended   ? (exit == 0u ? "finished" : "failed")
                    : heard ? "running"
                            : "silent"},
          {"phase", sources::TextOrNull(sources::TextOf(said, "phase").substr(0, 100))},
          {"goal", sources::TextOrNull(sources::TextOf(said, "goal").substr(0, 300))},
          {"started", TimeJson(sources::NumberOf(said, "started"))},
          {"ended", TimeJson(ended)},
          {"exit", sources::Maybe(exit)}};
}

OrderedJson UpsJson(Context& context, const live::LiveView& live) {
  constexpr std::uint64_t kMostBytes = 64 * 1024;
  OrderedJson ups = OrderedJson::array();
  for (const auto& root : context.sources.catalog().roots()) {
    const auto open = sources::OpenBelow(root, "up.json");
    if (!open || open->stamp.size > kMostBytes) continue;
    std::string text(open->stamp.size, '\0');
    const auto got =
        ReadAt(open->file.get(), root / "up.json", 0, {reinterpret_cast<std::uint8_t*>(text.data()), text.size()});
    const auto said = got ? ParseBoundedJson(text.substr(0, *got), 8) : std::nullopt;
    if (said && said->is_object()) ups.push_back(UpJson(live, root, *said));
  }
  return ups;
}

}  // namespace

OrderedJson HomeJson(Context& context) {
  const Overview all = LookOver(context);
  OrderedJson dirs = OrderedJson::array();
  for (const auto& root : context.sources.catalog().roots()) dirs.push_back(root.string());
  return {{"sentence", monitor::Sentence(FactsOf(context, all))},
          {"state", StateOfAll(all)},
          {"time", sources::Rfc3339(WallSeconds())},
          {"version", Version()},
          {"dirs", dirs},
          {"domain", context.domain >= 0 ? OrderedJson(context.domain) : OrderedJson()},
          {"actions", context.security.enabled()},
          {"sources", SourcesJson(all)},
          {"ups", UpsJson(context, *all.live)},
          {"warnings", WarningsJson(context, all)},
          {"tiles", http::ForBrowsers(TilesJson(all))}};
}

void AddHomeRoutes(http::Router& router, Context& context) {
  router.Add("GET", kPrefix + "/home", http::Lane::kFiles,
             [&context](const http::Request&) -> Result<http::Answer> { return http::JsonAnswer(HomeJson(context)); });
  router.Add(
      "GET", "/healthz", http::Lane::kAtOnce,  // a probe waits behind nobody
      [](const http::Request&) -> Result<http::Answer> { return http::BytesAnswer("ok\n", "text/plain"); },
      http::Access::kPublic);
  router.Add(
      "GET", "/readyz", http::Lane::kFiles,
      [&context](const http::Request&) -> Result<http::Answer> {
        const auto live = context.live();
        const bool bus = context.domain >= 0 && live->error.empty();
        const bool ready = context.domain < 0 || bus;
        // a probe comes without a token: it learns no names
        OrderedJson json{{"ready", ready},
                         {"sentence", ready ? "ready" : "the bus is not read"},
                         {"sources", context.sources.catalog().List()->size()},
                         {"bus", bus}};
        return http::JsonAnswer(json, ready ? 200 : 503);
      },
      http::Access::kPublic);
}

}  // namespace etude::api
