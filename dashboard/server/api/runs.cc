// SPDX-License-Identifier: Apache-2.0
// A training run: state, curriculum, graph, and the routes of all that is below /runs.
#include "dashboard/server/api/checkpoints.h"
#include "dashboard/server/api/context.h"
#include "dashboard/server/api/curriculum.h"
#include "dashboard/server/api/differences.h"
#include "dashboard/server/api/graph.h"
#include "dashboard/server/api/run_figures.h"
#include "dashboard/server/api/series.h"

namespace etude::api {
namespace {

using sources::Maybe;
using sources::TextOrNull;

// ---- /runs/{id} ---------------------------------------------------------------------------------

// @param id  as it was asked for   @param found  its folder empty: on the bus alone
OrderedJson RunJson(const std::string& id, const sources::Found& found, const sources::RunView& view,
                    const RunState& state) {
  OrderedJson lives = OrderedJson::array();
  for (const auto& life : view.metrics.lives())
    lives.push_back({{"from_step", life.from_step}, {"t", sources::TimeJson(life.t)}});
  OrderedJson end;
  if (const auto& said = view.metrics.end())
    end = {{"cause", said->cause}, {"step", Maybe(said->step)}, {"t", sources::TimeJson(said->t)}};
  OrderedJson json{{"id", id},
                   {"name", found.name},
                   {"folder", TextOrNull(found.shown)},
                   {"path", TextOrNull(found.folder.string())},
                   {"identity", TextOrNull(view.identity)},
                   {"state", state.state},
                   {"updated", sources::TimeJson(state.updated)},
                   {"age_ms", AgeOf(state.updated)},
                   {"live", state.live}};
  json.update(ProgressJson(state));
  json.update(OrderedJson{{"steps", Maybe(state.steps)},
                          {"elapsed_s", Maybe(state.elapsed_s)},
                          {"episodes", Maybe(state.episodes)},
                          {"modules", Modules(view.config)},
                          {"goals", GoalsJson(view)},
                          {"keys", KeysJson(view.metrics)},
                          {"nulls", NullsJson(view.metrics)},
                          {"nulls_total", CountOfNulls(view.metrics)},
                          {"lives", lives},
                          {"end", end},
                          {"dataset", nullptr},
                          {"config", view.config.is_null() ? OrderedJson() : http::ForBrowsers(view.config)},
                          {"torn", view.torn}});
  return json;
}

// What is heard of a run under its name on the bus; null: nothing.
const live::LiveRun* OnBus(const live::LiveView& live, const std::string& id) {
  for (const auto& [identity, run] : live.runs)
    if (BusId(run.presence) == id) return &run;
  return nullptr;
}

Result<http::Answer> Run(Context& context, const http::Request& request) {
  const std::string id = request.Parameter("id");
  const auto live = context.live();
  const auto opened = OpenRun(context, id);
  if (opened) {
    const auto state = StateOf(opened->view.get(), LiveOf(*live, *opened->view));
    return http::JsonAnswer(RunJson(id, opened->source->found(), *opened->view, state));
  }
  const auto* const heard = OnBus(*live, id);
  if (!heard) return Fail(opened.error());
  sources::Found nowhere;
  nowhere.kind = sources::Kind::kRun, nowhere.name = heard->presence.name;
  return http::JsonAnswer(RunJson(id, nowhere, {}, StateOf(nullptr, heard)));
}

// ---- curriculum, graph --------------------------------------------------------------------------

Result<http::Answer> Curriculum(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const OpenedRun opened, OpenRun(context, request.Parameter("id")));
  const auto state = StateOf(opened.view.get(), LiveOf(*context.live(), *opened.view));
  OrderedJson advances = OrderedJson::array();
  for (const auto& line : opened.view->curriculum) advances.push_back(http::ForBrowsers(line));
  return http::JsonAnswer({{"stages", StagesJson(*opened.view, state)}, {"advances", advances}});
}

Result<http::Answer> Graph(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const OpenedRun opened, OpenRun(context, request.Parameter("id")));
  ETUDE_ASSIGN_OR_RETURN(const OrderedJson json, GraphJson(*opened.view));
  return http::JsonAnswer(json);
}

}  // namespace

Result<OrderedJson> TrainNews(Context& context, const std::string& id, std::uint64_t since) {
  constexpr std::size_t kMost = 20;
  const auto live = context.live();
  const auto opened = OpenRun(context, id);
  const auto* const view = opened ? opened->view.get() : nullptr;
  const auto* const heard = view ? LiveOf(*live, *view) : OnBus(*live, id);
  if (!view && !heard) return Fail(opened.error());
  const RunState state = StateOf(view, heard);
  OrderedJson lines = OrderedJson::array();
  if (view)
    for (const auto& line : view->metrics.LinesAfter(since, kMost)) lines.push_back(http::ForBrowsers(line));
  OrderedJson json{{"run", id}, {"state", state.state}};
  json.update(ProgressJson(state));
  json["lines"] = std::move(lines);
  return json;
}

void AddRunRoutes(http::Router& router, Context& context) {
  const auto add = [&](const std::string& path, auto handler) {
    router.Add("GET", kPrefix + path, http::Lane::kFiles,
               [&context, handler](const http::Request& request) { return handler(context, request); });
  };
  add("/runs/{id}", Run);
  add("/runs/{id}/series", SeriesAnswer);
  add("/runs/{id}/series.csv", SeriesCsv);
  add("/runs/{id}/curriculum", Curriculum);
  add("/runs/{id}/graph", Graph);
  add("/runs/{id}/checkpoints", Checkpoints);
  add("/runs/{id}/checkpoints/{file}", CheckpointFile);
  add("/diff", Diff);
}

}  // namespace etude::api
