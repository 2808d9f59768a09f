// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/api/context.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>

#include "dashboard/server/sources/files.h"
#include "services/core/log.h"
#include "services/core/without_throwing.h"
#include "services/episode/bounded_json.h"

namespace etude::api {
namespace {

constexpr double kFresh_s = 30;  // files that changed within it are being written
constexpr std::int64_t kSilent_ms = 10'000;

// What a clock that is ahead has written is not fresh until this one has come there.
bool IsFresh(double updated) { return std::abs(WallSeconds() - updated) < kFresh_s; }

// Of the folder where it is here: a process that is started again goes on with what was begun.
double BegunOf(std::uint64_t folder_since, const bus::Presence* presence) {
  if (folder_since == 0 && presence) return static_cast<double>(presence->since);
  return static_cast<double>(folder_since);
}

}  // namespace

bool AnnouncesRollouts(const live::LiveCampaign& campaign) {
  const OrderedJson spec = ParseBoundedJson(campaign.spec_json).value_or(OrderedJson());
  return sources::TextOf(spec, "mode") == "rollout";
}

// Step by step, each at the end of the lane's queue, so that requests come in between; until `step` says that there
// is no more to do. One at a time by `key`.
void Context::InBackground(http::Lane lane, const std::string& key, std::function<bool()> step) {
  {
    const MutexLock lock(mutex_);
    if (!under_way_.insert(key).second) return;
  }
  later(lane, [this, lane, key, step = std::move(step)] {
    bool more = false;
    const Status done = WithoutThrowing([&]() -> Status {
      more = step();
      return {};
    });
    {
      const MutexLock lock(mutex_);
      under_way_.erase(key);
    }
    if (!done) Log().error("read {}: {}", key, done.error().message);
    if (done && more) InBackground(lane, key, step);
  });
}

void Context::ReadInBackground(std::shared_ptr<sources::DatasetSource> dataset) {
  const std::string key = "dataset " + dataset->found().id;
  InBackground(http::Lane::kEpisodes, key, [dataset = std::move(dataset)] { return dataset->ReadNext(); });
}

void Context::HashInBackground(std::shared_ptr<sources::RunSource> run) {
  const std::string key = "run " + run->found().id;
  InBackground(http::Lane::kFiles, key, [run = std::move(run)] { return run->HashNext(); });
}

http::Router MakeRouter(Context& context) {
  http::Router router;
  AddHomeRoutes(router, context);
  AddFleetRoutes(router, context);
  AddCampaignRoutes(router, context);
  AddDatasetRoutes(router, context);
  AddEpisodeRoutes(router, context);
  AddReplayRoutes(router, context);
  AddRunRoutes(router, context);
  AddEvalRoutes(router, context);
  AddLogRoutes(router, context);
  AddTopicRoutes(router, context);
  AddInsightRoutes(router, context);
  AddActionRoutes(router, context);
  AddPlayRoutes(router, context);
  AddMetricsRoutes(router, context);
  router.Add("GET", kPrefix + "/openapi.json", http::Lane::kFiles,
             [&context](const http::Request&) -> Result<http::Answer> {
               return http::BytesAnswer(context.openapi, "application/json");
             });
  return router;
}

namespace {

// What to say of a source that no folder has: it may be known by name alone.
template <class Owners>
Error NotHere(const Owners& owners, const std::string& id, Error error) {
  const bool on_bus = std::ranges::any_of(owners, [&](const auto& item) { return BusId(item.second.presence) == id; });
  if (on_bus && error.code == Code::kNotFound)
    error.message = fmt::format(
        "'{:.100}' is on the bus alone: its files are not below this gateway's folders; name "
        "its folder with --dir, or open a dashboard on the host that has it",
        id);
  return error;
}

}  // namespace

Result<OpenedDataset> OpenDataset(Context& context, const std::string& id) {
  auto opened = OpenSource(context.sources.Dataset(id));
  if (!opened) return Fail(NotHere(context.live()->campaigns, id, opened.error()));
  return opened;
}

Result<OpenedRun> OpenRun(Context& context, const std::string& id) {
  auto opened = OpenSource(context.sources.Run(id));
  if (!opened) return Fail(NotHere(context.live()->runs, id, opened.error()));
  return opened;
}

std::string BusId(const bus::Presence& presence) { return presence.name + "@" + presence.id; }

OrderedJson AgeOf(double seconds) {
  if (seconds <= 0) return nullptr;
  return static_cast<std::int64_t>(std::max(0.0, (WallSeconds() - seconds) * 1000));
}

const live::LiveCampaign* LiveOf(const live::LiveView& live, const sources::DatasetView& view) {
  const auto found = live.campaigns.find(view.info.identity);
  return found == live.campaigns.end() ? nullptr : &found->second;
}

const live::LiveRun* LiveOf(const live::LiveView& live, const sources::RunView& view) {
  const auto found = live.runs.find(view.identity);
  return found == live.runs.end() ? nullptr : &found->second;
}

// What was written decides whether it is finished; being heard only tells running from silent.
CampaignState StateOf(const sources::DatasetView* view, const live::LiveCampaign* heard) {
  CampaignState state;
  if (view) {
    state.committed = view->rows.size();
    state.total = view->info.derived ? view->rows.size() : sources::WantedOf(view->info);
    state.given_up = view->info.derived ? 0 : view->GivenUp();
    state.failed = view->failures.size();
    state.updated = view->info.updated;
  }
  state.begun = BegunOf(view ? view->info.since : 0, heard ? &heard->presence : nullptr);
  if (heard && heard->status) {
    const auto& status = *heard->status;
    state.committed = std::max(state.committed, status.committed);
    state.total = status.total;
    state.given_up = std::max(state.given_up, status.given_up);
    state.failed = std::max(state.failed, status.attempts - std::min(status.attempts, status.committed));
  }
  state.live = heard && heard->present && live::AgeMs(heard->heard) < kSilent_ms;
  if (state.live) {
    state.updated = WallSeconds();
    if (heard->status) {
      state.workers = heard->status->workers;
      state.per_minute = heard->status->episodes_per_minute;
      if (heard->status->eta_s > 0) state.eta_s = heard->status->eta_s;
      state.error = heard->status->error;
      const auto& said = heard->status->state;
      if (said == "paused" || said == "draining" || said == "stopping") state.control = said;
    }
  }
  if (state.total > 0 && state.committed + state.given_up >= state.total)
    state.state = "finished";
  else if (!state.error.empty())
    state.state = "failed";
  else if (!state.live &&
           ((view && view->info.stopped) || (heard && heard->status && heard->status->state == "stopping")))
    state.state = "stopped";  // written, or the last that its collector said before it went
  else
    state.state = state.live || IsFresh(state.updated) ? "running" : "silent";
  return state;
}

OrderedJson StatusJson(const CampaignState& state) {
  return {{"committed", state.committed},
          {"total", state.total},
          {"attempts", state.committed + state.failed},
          {"given_up", state.given_up},
          {"workers", state.workers},
          {"per_min", sources::Maybe(state.per_minute)},
          {"eta_s", sources::Maybe(state.eta_s)},
          {"error", state.error},
          {"control", state.control},
          {"live", state.live},
          {"age_ms", AgeOf(state.updated)}};
}

namespace {

void FromFiles(const sources::RunView& view, RunState& state) {
  const auto& metrics = view.metrics;
  state.step = metrics.step();
  state.updated = view.updated;
  state.loss = metrics.Last("train/loss");
  state.samples_per_s = metrics.Last("train/samples_per_second");
  state.data_wait = metrics.Last("train/data_wait");
  if (const auto stage = metrics.Last("train/stage")) state.stage = static_cast<std::uint64_t>(*stage);
  if (const auto episodes = metrics.Last("train/episodes")) state.episodes = static_cast<std::uint64_t>(*episodes);
  if (const auto found = metrics.series().find("train/loss");
      found != metrics.series().end() && !found->second.elapsed.empty())
    state.elapsed_s = found->second.elapsed.back();
  if (const auto steps = sources::UnsignedOf(view.config, "steps"); steps && *steps > 0) state.steps = steps;
  if (!view.curriculum.empty()) {
    state.stage = std::max(state.stage, sources::UnsignedOf(view.curriculum.back(), "to").value_or(0));
    state.stage_name = sources::TextOf(view.curriculum.back(), "name");
  }
  for (const auto& header : view.checkpoints) {
    const auto text = [&](const char* key) {
      const auto found = header.metadata.find(key);
      return found == header.metadata.end() ? std::string() : found->second;
    };
    if (!header.error.empty()) continue;
    const auto number = [&](const char* key) { return std::strtoull(text(key).c_str(), nullptr, 10); };
    state.checkpoint_step = number("step");
    state.stages = number("stages");
    if (state.stage_name.empty()) state.stage_name = text("stage_name");
    break;
  }
}

void FromBus(const bus::TrainStatus& status, RunState& state) {
  state.step = std::max(state.step, status.step);
  state.stage = status.stage;
  state.stages = status.stages;
  state.stage_name = status.stage_name;
  if (status.step > 0) {
    state.loss = status.loss;
    state.samples_per_s = status.samples_per_second;
    state.data_wait = status.data_wait;
  }
  state.episodes = status.episodes;
  if (status.eta_s > 0) state.eta_s = status.eta_s;
  if (status.checkpoint_step > 0) state.checkpoint_step = status.checkpoint_step;
}

}  // namespace

RunState StateOf(const sources::RunView* view, const live::LiveRun* heard) {
  RunState state;
  if (view) FromFiles(*view, state);
  state.live = heard && heard->present && live::AgeMs(heard->heard) < kSilent_ms;
  const auto* end = view && view->metrics.end() ? &*view->metrics.end() : nullptr;
  // its files say how it ended the last time until it writes again
  const bool again = end && end->t && state.live && static_cast<double>(heard->presence.since) >= std::floor(*end->t);
  if (again) end = nullptr;
  const bus::TrainStatus* const status = heard && heard->status ? &*heard->status : nullptr;
  if (status && (state.live || !end)) FromBus(*status, state);
  if (state.live) state.updated = WallSeconds();
  state.begun = BegunOf(view ? view->since : 0, heard ? &heard->presence : nullptr);
  state.stages = std::max(state.stages, state.stage);
  if (end)
    state.state = end->cause;
  else if ((status && status->finished) || (!again && state.steps && state.step >= *state.steps))
    state.state = "finished";  // one that goes on may be for more steps than config.yaml says yet
  else
    state.state = state.live || IsFresh(state.updated) ? "running" : "silent";
  if (state.state != "finished" && state.state != "stopped" && state.state != "failed" && state.state != "running")
    state.state = "silent";
  if (state.state != "running") state.eta_s.reset();  // nobody brings the end any nearer
  return state;
}

OrderedJson ProgressJson(const RunState& state) {
  return {{"step", state.step},
          {"stage", state.stage},
          {"stages", state.stages},
          {"stage_name", state.stage_name},
          {"loss", sources::Maybe(state.loss)},
          {"samples_per_s", sources::Maybe(state.samples_per_s)},
          {"data_wait", sources::Maybe(state.data_wait)},
          {"eta_s", sources::Maybe(state.eta_s)},
          {"checkpoint_step", sources::Maybe(state.checkpoint_step)}};
}

std::vector<const live::LiveServer*> ServersOf(const live::LiveView& live, const std::string& run_id) {
  std::vector<const live::LiveServer*> servers;
  for (const auto& [name, server] : live.servers)
    if (run_id.empty() || server.status.run_id == run_id) servers.push_back(&server);
  return servers;
}

namespace {

tl::unexpected<Error> NotLive(const char* what, const std::string& id) {
  return Fail(Code::kNotFound, fmt::format("no {} of '{:.100}' is on the bus now", what, id));
}

}  // namespace

Result<std::string> BusNameOfCampaign(Context& context, const std::string& id) {
  const auto live = context.live();
  const auto dataset = OpenDataset(context, id);
  for (const auto& [identity, campaign] : live->campaigns) {
    const std::string name = BusId(campaign.presence);
    if (campaign.present && (name == id || (dataset && dataset->view->info.identity == identity))) return name;
  }
  return NotLive("campaign", id);
}

Result<std::string> BusNameOfPolicy(Context& context, const std::string& id) {
  const auto live = context.live();
  const auto run = OpenRun(context, id);
  for (const auto& policy : live->policies) {
    const std::string name = BusId(policy.presence);
    if (name == id || (run && run->view->identity == policy.presence.id)) return name;
  }
  return NotLive("policy server", id);
}

Result<OrderedJson> JsonBody(const http::Request& request) {
  // a form of another page cannot send this type without being asked for first (CORS)
  if (!request.content_type.starts_with("application/json"))
    return Fail(Code::kInvalidArgument, "Content-Type must be application/json");
  auto json = ParseBoundedJson(request.body, 8);
  if (!json || !json->is_object()) return Fail(Code::kInvalidArgument, "the body is not a JSON object");
  return std::move(*json);
}

Result<std::optional<std::uint64_t>> SeedIn(const OrderedJson& body) {
  if (!body.contains("seed")) return std::optional<std::uint64_t>();
  const std::string text = sources::TextOf(body, "seed");
  std::uint64_t seed = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), seed);
  if (error != std::errc() || end != text.data() + text.size())
    return Fail(Code::kInvalidArgument, "seed: a whole number below 2^64, as text");
  return std::optional(seed);
}

Result<std::optional<std::uint64_t>> WholeIn(const OrderedJson& body, const char* key) {
  const auto number = sources::UnsignedOf(body, key);
  if (number || !body.contains(key)) return number;
  return Fail(Code::kInvalidArgument, fmt::format("{}: a whole number, not below 0", key));
}

http::Answer TokenNeeded(const Context& context, const std::string& hint) {
  return http::Problem(context.security.enabled() ? 401 : 403, "The token is needed",
                       "an action needs the gateway's token", hint);
}

std::uint64_t WantedRollouts(const sources::EvalView& view) {
  const auto asked = sources::UnsignedOf(view.report, "episodes").value_or(0);
  const auto invalid = sources::UnsignedOf(sources::PartOf(view.report, "scenes"), "invalid").value_or(0);
  return asked - std::min(asked, invalid);
}

// An index whose attempts are used up has no row, and between two rollouts nothing is written for minutes: what their
// collector left and says is looked at, too.
std::string EvalState(Context& context, const sources::Found& found, const sources::EvalView& view) {
  const auto asked = sources::UnsignedOf(view.report, "episodes").value_or(0);
  const auto wanted = WantedRollouts(view);
  if (asked > 0 && view.rows.size() >= wanted) return "finished";  // as most are: no other file is looked at
  CampaignState collected;
  if (const auto rollouts = OpenSource(context.sources.Dataset(RolloutsOf(context, found.id))))
    collected = StateOf(rollouts->view.get(), LiveOf(*context.live(), *rollouts->view));
  // those that the expert cannot do (WantedRollouts) are used up, too
  const auto without = std::max(collected.given_up, asked - wanted);
  if (asked > 0 && view.rows.size() + without >= asked) return "finished";
  return collected.live || IsFresh(std::max(view.updated, collected.updated)) ? "running" : "silent";
}

}  // namespace etude::api
