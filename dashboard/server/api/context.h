// SPDX-License-Identifier: Apache-2.0
// What every resource of the API answers from, and the resources' routes, a file each.
#pragma once

#include <functional>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "dashboard/server/http/answers.h"
#include "dashboard/server/http/router.h"
#include "dashboard/server/http/security.h"
#include "dashboard/server/live/bus_watch.h"
#include "dashboard/server/live/play_watch.h"
#include "dashboard/server/sources/sources.h"
#include "services/core/thread_annotations.h"
#include "services/policy/insight.h"
#include "services/policy/policy_types.h"
#include "services/security/role.h"

namespace etude::api {

class Jobs;

inline const std::string kPrefix = "/api/v1";

/// Thread-safe; outlives the server.
struct Context {
  sources::Sources& sources;
  /// What is on the bus; an empty view without one.
  std::function<std::shared_ptr<const live::LiveView>()> live;
  /// Runs work later, on a thread for files or episodes.
  std::function<void(http::Lane, std::function<void()>)> later;
  const http::Security& security;
  Jobs& jobs;
  Path videos;          ///< cache of episodes as mp4
  std::string openapi;  ///< text of openapi.json
  int domain = -1;      ///< -1: no bus
  /// --domain, --profile and --security, as a role, of commands that this gateway shows and runs; none without a bus.
  std::function<std::vector<std::string>(security::Role)> bus_flags = [](security::Role) {
    return std::vector<std::string>();
  };
  /// Newest messages of a topic; not set: no bus. @error as live::BusWatch::Newest
  std::function<Result<std::vector<live::Sample>>(const std::string& topic)> newest;
  /// Asks a policy server what it sees and says; not set: no bus. @error as live::PolicyLooker::Look
  std::function<Result<policy::Insight>(const std::string& run, const policy::Question&, const std::string& what_if)>
      look;
  live::PlayWatch* play = nullptr;  ///< null: no bus

  /// Begins to read what of a dataset's rows is not known, an episode at a time, unless it is under way.
  void ReadInBackground(std::shared_ptr<sources::DatasetSource> dataset);
  void HashInBackground(std::shared_ptr<sources::RunSource> run);

 private:
  void InBackground(http::Lane lane, const std::string& key, std::function<bool()> step) ETUDE_EXCLUDES(mutex_);
  Mutex mutex_;
  std::set<std::string> under_way_ ETUDE_GUARDED_BY(mutex_);

 public:
  Context(sources::Sources& all, std::function<std::shared_ptr<const live::LiveView>()> view,
          std::function<void(http::Lane, std::function<void()>)> run_later, const http::Security& secured, Jobs& runner)
      : sources(all), live(std::move(view)), later(std::move(run_later)), security(secured), jobs(runner) {}
};

/// Whether it is an evaluation's: a policy drives.
bool AnnouncesRollouts(const live::LiveCampaign& campaign);

void AddHomeRoutes(http::Router& router, Context& context);
void AddFleetRoutes(http::Router& router, Context& context);
void AddCampaignRoutes(http::Router& router, Context& context);
void AddDatasetRoutes(http::Router& router, Context& context);
void AddEpisodeRoutes(http::Router& router, Context& context);
void AddReplayRoutes(http::Router& router, Context& context);
void AddRunRoutes(http::Router& router, Context& context);
void AddEvalRoutes(http::Router& router, Context& context);
void AddLogRoutes(http::Router& router, Context& context);
void AddTopicRoutes(http::Router& router, Context& context);
void AddInsightRoutes(http::Router& router, Context& context);
void AddActionRoutes(http::Router& router, Context& context);
void AddPlayRoutes(http::Router& router, Context& context);
void AddMetricsRoutes(http::Router& router, Context& context);
/// All of them, and openapi.json.
http::Router MakeRouter(Context& context);

// ---- what resources share ---------------------------------------------------------------------

/// What a request names, and how it is now.
template <class Source, class View>
struct Opened {
  std::shared_ptr<Source> source;
  std::shared_ptr<const View> view;
};
using OpenedDataset = Opened<sources::DatasetSource, sources::DatasetView>;
using OpenedRun = Opened<sources::RunSource, sources::RunView>;
using OpenedEval = Opened<sources::EvalSource, sources::EvalView>;

/// @error kNotFound; of the source
template <class Source>
auto OpenSource(Result<std::shared_ptr<Source>> source)
    -> Result<Opened<Source, std::remove_cvref_t<decltype(**source.value()->View())>>> {
  if (!source) return Fail(source.error());
  ETUDE_ASSIGN_OR_RETURN(auto view, (*source)->View());
  return {{std::move(*source), std::move(view)}};
}
/// @error as OpenSource; of one that is on the bus alone: that its files are not here
Result<OpenedDataset> OpenDataset(Context& context, const std::string& id);
Result<OpenedRun> OpenRun(Context& context, const std::string& id);
inline Result<OpenedEval> OpenEval(Context& context, const std::string& id) {
  return OpenSource(context.sources.Eval(id));
}
/// The body of a POST as a JSON object. @error kInvalidArgument
Result<OrderedJson> JsonBody(const http::Request& request);
/// Its "seed", a u64 as text; nothing where it has none. @error kInvalidArgument
Result<std::optional<std::uint64_t>> SeedIn(const OrderedJson& body);
/// A whole number of it; nothing where it has none. @error kInvalidArgument: it is of another kind, or negative
Result<std::optional<std::uint64_t>> WholeIn(const OrderedJson& body, const char* key);
/// The answer to who asks for an action without the token.
http::Answer TokenNeeded(const Context& context, const std::string& hint);

/// A campaign that is a dataset's, and what is heard of it.
struct CampaignState {
  std::string state;  ///< running | silent | finished | stopped | failed | unknown
  bool live = false;
  std::uint64_t committed = 0, total = 0, given_up = 0, failed = 0, workers = 0;
  std::optional<double> per_minute, eta_s;
  std::string error;
  std::string control;  ///< paused | draining | stopping, while its collector says so; "": at work
  double updated = 0;   ///< seconds since 1970
  double begun = 0;     ///< the same; 0: not known
};
const live::LiveCampaign* LiveOf(const live::LiveView& live, const sources::DatasetView& view);
CampaignState StateOf(const sources::DatasetView* view, const live::LiveCampaign* heard);
OrderedJson StatusJson(const CampaignState& state);

struct RunState {
  std::string state;
  bool live = false;
  std::uint64_t step = 0, stage = 0, stages = 0;
  std::optional<std::uint64_t> steps, checkpoint_step, episodes;
  std::string stage_name;
  std::optional<double> loss, samples_per_s, data_wait, eta_s, elapsed_s;
  double updated = 0;
  double begun = 0;  ///< seconds since 1970; 0: not known
};
/// @param view  null: seen on the bus only
const live::LiveRun* LiveOf(const live::LiveView& live, const sources::RunView& view);
RunState StateOf(const sources::RunView* view, const live::LiveRun* heard);
/// What the Training tile, /runs/{id} and the channel train all say of it.
OrderedJson ProgressJson(const RunState& state);
/// The servers that say how they do, of one run or, with "", of all.
std::vector<const live::LiveServer*> ServersOf(const live::LiveView& live, const std::string& run_id = "");
/// "NAME@ID" of a campaign or a run on the bus: `id` is its source, or that itself. @error kNotFound: not live
Result<std::string> BusNameOfCampaign(Context& context, const std::string& id);
Result<std::string> BusNameOfPolicy(Context& context, const std::string& id);
/// That an evaluation comes to: scenes that the expert cannot do (--first-draw) get none.
std::uint64_t WantedRollouts(const sources::EvalView& view);
/// finished | running | silent
std::string EvalState(Context& context, const sources::Found& found, const sources::EvalView& view);
/// The dataset of an evaluation's rollouts; "": there is none.
std::string RolloutsOf(Context& context, const std::string& eval);

/// "NAME@ID" of what is only on the bus.
std::string BusId(const bus::Presence& presence);
/// ms since a moment of the wall clock; null when it is not known.
OrderedJson AgeOf(double seconds_since_1970);

/// Whether attention is shown of each head, or their mean alone, which is a fraction of the bytes.
enum class Heads { kMean, kEach };
/// By module what it attends to, see ModuleAttention in openapi.json; and {u, v, width, height} of the picture.
OrderedJson AttentionJson(const policy::Insight& insight, Heads heads);
OrderedJson ViewJson(const policy::Insight& insight);

OrderedJson HomeJson(Context& context);
Result<OrderedJson> FleetJson(Context& context, const http::Query& query);
Result<OrderedJson> EvalJson(Context& context, const std::string& id);
Result<OrderedJson> LogsJson(Context& context, const http::Query& query);
Result<OrderedJson> EventsJson(Context& context, const http::Query& query);
OrderedJson TopicsJson(Context& context);
Result<OrderedJson> SampleJson(Context& context, const std::string& topic);
/// Channel play. @error kNotFound: no such session; kUnavailable: no bus
Result<OrderedJson> PlayJson(Context& context, const std::string& session);
/// Channels attempts and train of the WebSocket.
Result<OrderedJson> LatestAttempts(Context& context, const std::string& campaign);
Result<OrderedJson> TrainNews(Context& context, const std::string& run, std::uint64_t since);

}  // namespace etude::api
