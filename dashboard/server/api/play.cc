// SPDX-License-Identifier: Apache-2.0
// Play: sessions in which people talk to a policy, and pictures of scenes to begin with.
#include "dashboard/server/api/play.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <mutex>
#include <optional>
#include <set>

#include "dashboard/server/api/context.h"
#include "dashboard/server/api/jobs.h"
#include "dashboard/server/live/play_watch.h"
#include "services/campaign/process.h"
#include "services/core/command.h"
#include "services/core/hash.h"
#include "services/core/identity.h"
#include "services/core/share.h"
#include "services/core/thread_annotations.h"
#include "services/episode/action.h"
#include "services/episode/bounded_json.h"
#include "services/language/held_out.h"
#include "services/language/meaning.h"
#include "services/play/client.h"

namespace etude::api {
namespace {

using sources::TextOf;
using namespace std::chrono_literals;

constexpr std::size_t kScenesKept = 500;
constexpr auto kRenders = 9s;  // within what a request may take
constexpr std::uint64_t kMostIndex = 1'000'000'000;

OrderedJson Parsed(const std::string& text) {
  return http::ForBrowsers(ParseBoundedJson(text, 12).value_or(OrderedJson::object()));
}

OrderedJson JsonOf(const live::PlayWatch::Session& session) {
  const bus::PlayState& state = session.state;
  OrderedJson waypoints = OrderedJson::array();
  for (std::size_t i = 0; i + kWaypointSize <= state.waypoints.size(); i += kWaypointSize)
    waypoints.push_back(std::vector<float>(state.waypoints.begin() + static_cast<std::ptrdiff_t>(i),
                                           state.waypoints.begin() + static_cast<std::ptrdiff_t>(i + kWaypointSize)));
  return {{"session", state.session},
          {"host", state.host},
          {"run", state.run},
          {"phase", state.phase},
          {"age_ms", session.age_ms},
          {"frame", session.frame},
          {"scene", Parsed(state.scene_json)},
          {"sentence", state.sentence},
          {"meaning", state.meaning_json.empty() ? OrderedJson() : Parsed(state.meaning_json)},
          {"step", state.step},
          {"max_steps", state.max_steps},
          {"judge", Parsed(state.judge_json)},
          {"outcome", state.outcome},
          {"reason", state.reason},
          {"joints", state.joints},
          {"waypoints", std::move(waypoints)},
          {"modules", Parsed(state.modules_json)},
          {"checkpoint_step", state.checkpoint_step},
          {"policy_ms", state.policy_ms},
          {"speed", state.speed},
          {"attempts", state.attempts},
          {"successes", state.successes}};
}

Result<live::PlayWatch*> WatchOf(Context& context) {
  if (context.play) return context.play;
  return Fail(Code::kUnavailable, "play: this gateway reads no bus (--no-bus)");
}

// A dataset that was found, or a campaign that comes along: never a path of the request's.
Result<Path> SpecOf(Context& context, const std::string& id) {
  if (auto shipped = ShippedCampaign(id)) return shipped;
  ETUDE_ASSIGN_OR_RETURN(const auto dataset, context.sources.Dataset(id));
  return dataset->found().folder;
}

Result<http::Answer> List(Context& context, const http::Request&) {
  OrderedJson sessions = OrderedJson::array(), policies = OrderedJson::array();
  if (context.play) {
    ETUDE_ASSIGN_OR_RETURN(const auto all, context.play->Sessions());
    for (const auto& session : all) sessions.push_back(JsonOf(session));
  }
  const auto live = context.live();
  for (const auto& policy : live->policies) policies.push_back(BusId(policy.presence));
  return http::JsonAnswer({{"enabled", context.play != nullptr},
                           {"sessions", std::move(sessions)},
                           {"policies", std::move(policies)},
                           {"campaigns", ShippedCampaigns()}});
}

// The worker that keeps the scene; whoever copies the command gets a session of its own name.
Result<std::vector<std::string>> WorkerOf(Context& context, const OrderedJson& body, const std::string& session) {
  ETUDE_ASSIGN_OR_RETURN(const auto watch, WatchOf(context));
  (void)watch;
  ETUDE_ASSIGN_OR_RETURN(const Path spec, SpecOf(context, TextOf(body, "spec")));
  ETUDE_ASSIGN_OR_RETURN(const Selector run, ParseSelector(TextOf(body, "run"), "run"));
  ETUDE_ASSIGN_OR_RETURN(const auto number, WholeIn(body, "index"));
  const auto index = number.value_or(0);
  if (index > kMostIndex) return Fail(Code::kInvalidArgument, "index: too large");
  ETUDE_ASSIGN_OR_RETURN(const auto seed, SeedIn(body));
  std::vector<std::string> arguments{"worker", "play", spec.string(), "--run", run.text()};
  if (!session.empty()) arguments.insert(arguments.end(), {"--session", session});
  arguments.insert(arguments.end(), {"--index", std::to_string(index)});
  if (seed) arguments.insert(arguments.end(), {"--seed", std::to_string(*seed)});
  const auto flags = context.bus_flags(security::Role::kWorker);
  arguments.insert(arguments.end(), flags.begin(), flags.end());
  return arguments;
}

// Starts the worker as a job, or says the command alone.
Result<http::Answer> OpenSession(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const OrderedJson body, JsonBody(request));
  const bool dry_run = sources::FlagOf(body, "dry_run");
  if (!dry_run && !request.authorized)
    return TokenNeeded(context, "ask with dry_run for the command to copy, or sign in");
  const std::string session = dry_run ? "" : "play-" + NewId().substr(0, 8);
  ETUDE_ASSIGN_OR_RETURN(const auto arguments, WorkerOf(context, body, session));
  std::vector<std::string> words{"etude"};
  words.insert(words.end(), arguments.begin(), arguments.end());
  const std::string command = CommandText(words);
  if (dry_run) return http::JsonAnswer({{"command", command}});
  ETUDE_ASSIGN_OR_RETURN(const std::string job, context.jobs.Add({"play", arguments, Weight::kLasting}));
  return http::JsonAnswer({{"session", session}, {"job", job}, {"command", command}}, 202);
}

Result<http::Answer> Show(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const OrderedJson json, PlayJson(context, request.Parameter("id")));
  return http::JsonAnswer(json);
}

Result<http::Answer> Command(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const auto watch, WatchOf(context));
  ETUDE_ASSIGN_OR_RETURN(const OrderedJson body, JsonBody(request));
  ETUDE_ASSIGN_OR_RETURN(const auto action, play::ActionOf(TextOf(body, "action")));
  OrderedJson arguments = sources::PartOf(body, "arguments");
  if (arguments.is_null()) arguments = OrderedJson::object();
  const auto state = watch->Command(request.Parameter("id"), action, arguments);
  if (state) return http::JsonAnswer({{"accepted", true}, {"refusal", ""}});
  // what the session refuses is its answer
  if (state.error().code != Code::kInvalidArgument) return Fail(state.error());
  return http::JsonAnswer({{"accepted", false}, {"refusal", state.error().message}});
}

Result<http::Answer> Picture(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const auto watch, WatchOf(context));
  ETUDE_ASSIGN_OR_RETURN(const bus::PlayFrame frame, watch->Frame(request.Parameter("id")));
  if (frame.format != "jpeg") return Fail(Code::kCorrupt, "the picture is no JPEG");
  return http::BytesAnswer(std::string(frame.image.begin(), frame.image.end()), "image/jpeg", http::Caching::kNever);
}

// What its policy sees; asked for again and again by a page that shows it.
Result<http::Answer> LookInto(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const auto watch, WatchOf(context));
  ETUDE_ASSIGN_OR_RETURN(const auto looked, watch->LookInto(request.Parameter("id")));
  const std::string heads = request.query.Get("heads").value_or("mean");
  if (heads != "mean" && heads != "each")
    return Fail(Code::kInvalidArgument, "heads: " + NotKnown(heads.substr(0, 40), {"mean", "each"}));
  const policy::Insight insight = looked.newest.value_or(policy::Insight{});
  return http::JsonAnswer({{"number", looked.number},
                           {"checkpoint_step", insight.checkpoint_step},
                           {"modules", http::ForBrowsers(insight.modules)},
                           {"attention", AttentionJson(insight, heads == "each" ? Heads::kEach : Heads::kMean)},
                           {"view", ViewJson(insight)}});
}

// Of a few campaigns: WordNet is read for each.
class Parsers {
 public:
  Result<std::shared_ptr<const language::MeaningParser>> For(const OrderedJson& scene) {
    constexpr std::size_t kMost = 8;
    const auto texts = [&](const char* key) {
      std::vector<std::string> list;
      if (const OrderedJson& part = sources::PartOf(scene, key); part.is_array())
        for (const auto& item : part)
          if (item.is_string()) list.push_back(item.get<std::string>());
      return list;
    };
    const std::string key = sources::PartOf(scene, "tasks").dump() + sources::PartOf(scene, "campaign_objects").dump();
    MutexLock lock(mutex_);
    auto& parser = parsers_[key];
    if (!parser) {
      auto loaded = language::MeaningParser::Load(texts("tasks"), texts("campaign_objects"));
      if (!loaded) {
        parsers_.erase(key);
        return Fail(loaded.error());
      }
      parser = std::make_shared<const language::MeaningParser>(std::move(*loaded));
    }
    const auto result = parser;
    if (parsers_.size() > kMost) parsers_.clear();
    return result;
  }

 private:
  Mutex mutex_;
  std::map<std::string, std::shared_ptr<const language::MeaningParser>> parsers_ ETUDE_GUARDED_BY(mutex_);
};

// What the training of a checkpoint said that a server serves: of a run below this gateway's folders, from the headers
// of its checkpoints. Nothing: none is found, or only its hash could tell, which is then made.
std::optional<std::set<std::string>> WordsServed(Context& context, const bus::PolicyStatus& served) {
  constexpr std::size_t kMostRuns = 1000, kMostLooked = 40;
  auto runs = context.sources.catalog().NewestOf(sources::Kind::kRun, kMostRuns).found;
  // the run itself, where it is here; else, by their hashes, those that changed last
  const auto own = std::ranges::find_if(runs, [&](const auto& found) {
    return !served.run_id.empty() && context.sources.identities().Of(found.folder) == served.run_id;
  });
  const bool is_here = own != runs.end();
  if (is_here) std::iter_swap(runs.begin(), own);
  runs.resize(is_here ? 1 : std::min(runs.size(), kMostLooked));
  for (const auto& found : runs) {
    const auto opened = OpenRun(context, found.id);
    if (!opened) continue;
    for (const auto& checkpoint : opened->view->checkpoints) {
      const auto words = checkpoint.metadata.find("words"), step = checkpoint.metadata.find("step");
      if (words == checkpoint.metadata.end() || step == checkpoint.metadata.end()) continue;
      const bool is_served = !served.sha256.empty() && checkpoint.sha256 == served.sha256;
      if (is_served || opened->view->identity == served.run_id) return language::WordsIn(words->second);
      if (checkpoint.sha256.empty() && step->second == std::to_string(served.step))
        context.HashInBackground(opened->source);
    }
  }
  return std::nullopt;
}

// Of the policy that a session asks.
std::optional<std::set<std::string>> TrainingWords(Context& context, const std::string& run) {
  const auto selector = ParseSelector(run, "run");
  if (!selector) return std::nullopt;
  const auto live = context.live();
  for (const auto& [name, server] : live->servers) {
    const bus::PolicyStatus& status = server.status;
    if (status.run == selector->name && status.run_id.starts_with(selector->id)) return WordsServed(context, status);
  }
  return std::nullopt;
}

Result<http::Answer> Meaning(Context& context, Parsers& parsers, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const OrderedJson state, PlayJson(context, request.Parameter("id")));
  const OrderedJson& scene = sources::PartOf(state, "scene");
  ETUDE_ASSIGN_OR_RETURN(const auto parser, parsers.For(scene));
  std::vector<std::string> on_table;
  for (const auto& object : sources::PartOf(scene, "objects"))
    if (!sources::FlagOf(object, "hidden")) on_table.push_back(TextOf(object, "name"));
  language::Meaning meaning = parser->Parse(request.query.Get("sentence").value_or(""), on_table);
  const auto said = TrainingWords(context, TextOf(state, "run"));
  if (said) language::MarkSeen(meaning, *said);
  OrderedJson json = language::ToJson(meaning);
  json["words_of"] = said ? "training" : "campaign";
  return http::JsonAnswer(json);
}

// ---- scenes ---------------------------------------------------------------------------------------

void TrimScenes(const Path& folder) {
  std::vector<std::pair<std::filesystem::file_time_type, Path>> files;
  std::error_code error;
  for (std::filesystem::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    std::error_code ignored;
    if (it->path().extension() == ".png") files.emplace_back(it->last_write_time(ignored), it->path());
  }
  std::ranges::sort(files);
  for (std::size_t i = 0; i + kScenesKept < files.size(); ++i) std::filesystem::remove(files[i].second, error);
}

// The first picture of an episode, rendered once; named by what the spec's file says now.
Result<http::Answer> Scene(Context& context, std::mutex& rendering, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(Path spec, SpecOf(context, request.Parameter("id")));
  ETUDE_ASSIGN_OR_RETURN(const auto index, request.Index("index"));
  if (index > kMostIndex) return Fail(Code::kInvalidArgument, "index: too large");
  std::error_code error;
  if (std::filesystem::is_directory(spec, error))
    return Fail(Code::kInvalidArgument, "scenes: of a dataset the pictures themselves are there; name a campaign");
  OrderedJson asked = OrderedJson::object();
  if (const auto text = request.query.Get("seed"); text && !text->empty()) asked["seed"] = *text;
  ETUDE_ASSIGN_OR_RETURN(const auto seed, SeedIn(asked));
  const std::string key = fmt::format("{}{} {}{}", sources::StampOf(spec).tag(), spec.string(), index,
                                      seed ? fmt::format(" {}", *seed) : "");
  const Path folder = context.videos.parent_path() / "scenes";
  const Path file = folder / (Sha256Hex(key).substr(0, 32) + ".png");
  if (!std::filesystem::exists(file, error)) {
    // one at a time: whoever asks for many must not keep the others waiting
    const std::unique_lock one(rendering, std::try_to_lock);
    if (!one) return Fail(Code::kUnavailable, "render a scene: another one is being rendered; ask again");
    ETUDE_RETURN_IF_ERROR(MakeFolders(folder));
    const Path fresh = folder / fmt::format("{}.{}.png", file.stem().string(), NewId());
    ETUDE_ASSIGN_OR_RETURN(const Path worker, campaign::FindSibling("etude-worker"));
    ETUDE_RETURN_IF_ERROR(RenderScene(worker, {spec, index, seed}, fresh));
    std::filesystem::rename(fresh, file, error);
    if (error)
      return Fail(Code::kUnavailable, fmt::format("keep the picture '{}': {}", file.string(), error.message()));
    TrimScenes(folder);
  }
  ETUDE_ASSIGN_OR_RETURN(const auto bytes, ReadBinaryFile(file));
  return http::BytesAnswer(std::string(bytes.begin(), bytes.end()), "image/png");
}

}  // namespace

std::vector<std::string> ShippedCampaigns() {
  std::vector<std::string> names;
  const auto folder = FindShared("campaigns");
  std::error_code error;
  if (!folder) return names;
  for (std::filesystem::directory_iterator it(*folder, error), end; !error && it != end; it.increment(error))
    if (it->path().extension() == ".yaml") names.push_back(it->path().stem().string());
  std::ranges::sort(names);
  return names;
}

Result<Path> ShippedCampaign(const std::string& name) {
  const auto names = ShippedCampaigns();
  if (std::ranges::find(names, name) == names.end()) return Fail(Code::kNotFound, NotKnown(name.substr(0, 40), names));
  ETUDE_ASSIGN_OR_RETURN(const Path folder, FindShared("campaigns"));
  return folder / (name + ".yaml");
}

Status RenderScene(const Path& worker, const ScenePicture& picture, const Path& file) {
  const Path log = file.string() + ".log";
  std::vector<std::string> argv{
      worker.string(), "scene",      "render", picture.spec.string(), "--index", std::to_string(picture.index),
      "--out",         file.string()};
  if (picture.seed) argv.insert(argv.end(), {"--seed", std::to_string(*picture.seed)});
  ETUDE_ASSIGN_OR_RETURN(auto process, campaign::Process::Start({argv, log, {}}));
  const auto code = process.Wait(kRenders);
  std::error_code ignored;
  if (code == 0) {
    std::filesystem::remove(log, ignored);
    return {};
  }
  const auto said = ReadTextFile(log, 1 << 16);
  std::filesystem::remove(log, ignored);
  if (!code) return Fail(Code::kTimeout, "render a scene: it takes too long");
  const std::string why =
      said && !said->empty() ? said->substr(0, 500) : "etude-worker ended with " + campaign::HowItEnded(*code);
  return Fail(CodeForExit(*code), "render a scene: " + why);
}

Result<OrderedJson> PlayJson(Context& context, const std::string& session) {
  ETUDE_ASSIGN_OR_RETURN(const auto watch, WatchOf(context));
  ETUDE_ASSIGN_OR_RETURN(const auto looked, watch->Look(session));
  return JsonOf(looked);
}

void AddPlayRoutes(http::Router& router, Context& context) {
  using http::Access;
  const auto add = [&](const char* method, const std::string& path, Access access, auto handler,
                       http::Lane lane = http::Lane::kFiles) {
    router.Add(
        method, kPrefix + path, lane,
        [&context, handler](const http::Request& request) -> Result<http::Answer> { return handler(context, request); },
        access);
  };
  const auto parsers = std::make_shared<Parsers>();
  add("GET", "/play/sessions", Access::kRead, List);
  add("POST", "/play/sessions", Access::kRead, OpenSession);  // it looks at the token itself: a dry run needs none
  add("GET", "/play/sessions/{id}", Access::kRead, Show);
  add("POST", "/play/sessions/{id}/commands", Access::kAction, Command, http::Lane::kPlay);
  add("GET", "/play/sessions/{id}/frame.jpg", Access::kRead, Picture);
  add("GET", "/play/sessions/{id}/insight", Access::kRead, LookInto);
  add("GET", "/play/sessions/{id}/meaning", Access::kRead,
      [parsers](Context& of, const http::Request& request) { return Meaning(of, *parsers, request); });
  const auto rendering = std::make_shared<std::mutex>();
  add(
      "GET", "/scenes/{id}/{index}.png", Access::kRead,
      [rendering](Context& of, const http::Request& request) { return Scene(of, *rendering, request); },
      http::Lane::kBus);
}

}  // namespace etude::api
