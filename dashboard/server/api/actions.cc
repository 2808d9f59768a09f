// SPDX-License-Identifier: Apache-2.0
// What changes something: each action is an etude command, shown for copying and, with the token, run as a child.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <set>

#include "dashboard/server/api/context.h"
#include "dashboard/server/api/jobs.h"
#include "dashboard/server/api/play.h"
#include "dashboard/server/api/replays.h"
#include "services/campaign/eval_report.h"
#include "services/campaign/spec_file.h"
#include "services/core/identity.h"
#include "services/core/log.h"
#include "services/episode/bounded_json.h"
#include "services/store/filter_keys.h"

namespace etude::api {
namespace {

using sources::TextOf;

struct ArgumentHelp {
  const char* name;
  bool required;
  const char* description;
};
struct ActionHelp {
  const char* action;
  const char* description;
  std::vector<ArgumentHelp> arguments;
};

const std::vector<ActionHelp>& Known() {
  static const std::vector<ActionHelp> known{
      {"evaluate",
       "roll a checkpoint out on fresh scenes",
       {{"run", true, "run id"},
        {"file", true, "checkpoint"},
        {"scenes", false,
         "campaign that comes along (GET /play/sessions lists them), whose robot, tasks, objects and camera to use, or "
         "default: pick, push and put_down with the UR5; left out: those of the run's dataset, else default"},
        {"episodes", false, "rollouts, 1 to 10,000; 40"},
        {"seed", false, "of the scenes, as text; 9001"}}},
      {"replay",
       "make an attempt again, to see how it went",
       {{"dataset", true, "dataset id"}, {"index", true, "episode"}, {"attempt", false, "attempt at it; 0"}}},
      {"mask",
       "give episodes of a dataset a filter key; while a collector has the dataset, that writes the key",
       {{"dataset", true, "dataset id"},
        {"key", true, "name of the filter key: a-z, 0-9, _ and -"},
        {"indices", true, "its episodes, as text: 0-3,7"}}},
      {"verify", "read every byte of a dataset and report damaged files", {{"dataset", true, "dataset id"}}},
      {"pause",
       "lease nothing new to a campaign's workers; what is leased is finished and committed",
       {{"campaign", true, "dataset id, or NAME@ID on the bus"}}},
      {"drain",
       "as pause, and wait until nothing is leased any more",
       {{"campaign", true, "dataset id, or NAME@ID on the bus"}}},
      {"resume", "lease again", {{"campaign", true, "dataset id, or NAME@ID on the bus"}}},
      {"stop",
       "end a campaign's collector; started again, it resumes",
       {{"campaign", true, "dataset id, or NAME@ID on the bus"}}},
      {"promote", "make a checkpoint a run's best", {{"run", true, "run id"}, {"file", true, "checkpoint"}}},
      {"serve",
       "start a policy server for a checkpoint, or for what a run publishes; it serves until the job is stopped",
       {{"run", true, "run id"},
        {"file", false, "checkpoint; default: those that the run publishes while it is trained, else its newest"}}}};
  return known;
}

struct ActionCommand {
  std::vector<std::string> arguments;
  Weight weight = Weight::kLight;
  std::vector<std::string> shown = {};  ///< for who copies it; empty: as it is run
  std::string once = {};                ///< as Jobs::Request has them
  std::function<void(bool)> finish = nullptr;
  bool there = false;       ///< what it would make
  std::string scenes = {};  ///< of rollouts: Scenes::name; "": there are none

  void AddFlags(const std::vector<std::string>& flags) {
    arguments.insert(arguments.end(), flags.begin(), flags.end());
  }
};

// A checkpoint that the run has, looked up and never joined from what was asked.
Result<Path> CheckpointOf(Context& context, const OrderedJson& body) {
  ETUDE_ASSIGN_OR_RETURN(const OpenedRun run, OpenRun(context, TextOf(body, "run")));
  const std::string file = TextOf(body, "file");
  const auto& headers = run.view->checkpoints;
  const auto header = std::ranges::find(headers, file, &sources::CheckpointHeader::file);
  if (header == headers.end())
    return Fail(Code::kNotFound, fmt::format("file: the run has no checkpoint '{:.100}'", file));
  return run.source->found().folder / "checkpoints" / header->file;
}

// What a run published last. @error kNotFound: nothing yet
Result<Path> NewestCheckpoint(const OpenedRun& run) {
  const auto& headers = run.view->checkpoints;
  const auto newest = std::ranges::find_if(headers, [](const auto& header) {
    return std::ranges::find(header.channels, "latest") != header.channels.end();
  });
  if (newest == headers.end())
    return Fail(Code::kNotFound, "serve: the run has no checkpoint yet, and nobody trains it now");
  return run.source->found().folder / "checkpoints" / newest->file;
}

// Whether a folder is one of those that the gateway was given, or lies below one.
bool IsGiven(Context& context, const Path& folder) {
  return std::ranges::any_of(context.sources.catalog().roots(), [&](const Path& root) {
    const auto [end, rest] = std::mismatch(root.begin(), root.end(), folder.begin(), folder.end());
    return end == root.end();
  });
}

// A run that was made anew in its folder has checkpoints of the same names, and what lies there is of the one before.
Path EvaluationFolder(const Path& out, const Path& run) {
  const auto identity = ReadIdentity(run);
  const auto is_anothers = [&](const Path& folder) {
    const std::string of = campaign::SubjectOf(campaign::ReadReport(folder)).run_id;
    return identity && !of.empty() && of != identity->id;
  };
  Path folder = out;
  for (int n = 2; is_anothers(folder); ++n) folder = fmt::format("{}-{}", out.string(), n);
  return folder;
}

// What of a checkpoint's robot and camera no scene of `spec` has; "": it fits, as far as the checkpoint says.
std::string Misfit(const sources::CheckpointHeader& checkpoint, const CampaignSpec& spec) {
  constexpr double kDegrees = 180 / std::numbers::pi, kTolerance = 0.1;
  const auto said = checkpoint.metadata.find("embodiment");
  if (said == checkpoint.metadata.end()) return "";
  const OrderedJson fits = ParseBoundedJson(said->second).value_or(OrderedJson());
  const std::string robot = TextOf(fits, "robot");
  if (!robot.empty() && std::ranges::find(spec.robots, robot) == spec.robots.end())
    return fmt::format("it is of robot {:.40}, they have {}", robot, fmt::join(spec.robots, ", "));
  const double fovy = kDegrees * sources::NumberOf(fits, "fovy").value_or(0);
  if (fovy > 0 && std::abs(fovy - spec.camera.fovy_deg) > kTolerance)
    return fmt::format("its camera sees {:.1f} degrees, theirs {:.1f}", fovy, spec.camera.fovy_deg);
  return "";
}

constexpr const char* kDefaultScenes = "default";

// What rollouts are made in.
struct Scenes {
  Path file;                          ///< a campaign's, or a dataset's folder; "": those of `etude eval` without one
  std::string name = kDefaultScenes;  ///< the campaign's, or the folder's
};

// Those of the dataset that a run was trained on, which the hash of its spec in the run's state tells
// (trainer/learn/run_state.h). nullopt: it was several, or one that lies below none of the folders given.
std::optional<Scenes> ScenesOfTraining(Context& context, const Path& run) {
  constexpr std::size_t kMostLooked = 40;
  const auto state = sources::ReadCheckpointHeader(run, "training_state.safetensors");
  if (!state || !state->metadata.contains("run")) return std::nullopt;
  const OrderedJson said = ParseBoundedJson(state->metadata.at("run")).value_or(OrderedJson());
  std::set<std::string> hashes;  // the shards of one campaign have the same
  for (const auto& hash : sources::PartOf(said, "datasets"))
    if (hash.is_string()) hashes.insert(hash.get<std::string>());
  if (hashes.size() != 1) return std::nullopt;
  for (const auto& found : context.sources.catalog().Demonstrations(kMostLooked)) {
    const auto dataset = OpenDataset(context, found.id);
    if (dataset && hashes.contains(dataset->view->info.spec_sha256)) return Scenes{found.folder, found.name};
  }
  return std::nullopt;
}

// Those that are asked for, else those of the training, else those that `etude eval` has without any. The policy would
// refuse every question in scenes of another robot or camera: that is said now, and not after an hour.
Result<Scenes> ScenesFor(Context& context, const Path& checkpoint, const OrderedJson& body) {
  const bool asked = body.contains("scenes");
  if (!asked)
    if (auto own = ScenesOfTraining(context, checkpoint.parent_path().parent_path())) return std::move(*own);
  Scenes scenes;
  CampaignSpec spec;
  if (const std::string name = TextOf(body, "scenes"); asked && name != kDefaultScenes) {
    auto shipped = ShippedCampaign(name);
    if (!shipped) return Fail(Code::kInvalidArgument, "scenes: " + shipped.error().message);
    scenes = {std::move(*shipped), name};
    ETUDE_ASSIGN_OR_RETURN(spec, campaign::LoadSpec({scenes.file.string(), {}, {}, {}}));
  }
  ETUDE_ASSIGN_OR_RETURN(const auto header,
                         sources::ReadCheckpointHeader(checkpoint.parent_path(), checkpoint.filename().string()));
  const std::string misfit = Misfit(header, spec);
  if (misfit.empty()) return scenes;
  return Fail(Code::kInvalidArgument,
              fmt::format("scenes: the checkpoint does not fit {}: {}; give scenes of its kind, one of {}, or on the "
                          "command line etude eval --scenes FILE",
                          scenes.file.empty() ? "those of etude eval without any" : scenes.name, misfit,
                          fmt::join(ShippedCampaigns(), ", ")));
}

Result<ActionCommand> Evaluate(Context& context, const OrderedJson& body) {
  ETUDE_ASSIGN_OR_RETURN(const Path checkpoint, CheckpointOf(context, body));
  ETUDE_ASSIGN_OR_RETURN(const auto asked, WholeIn(body, "episodes"));
  const auto episodes = asked.value_or(40);
  ETUDE_ASSIGN_OR_RETURN(const auto chosen, SeedIn(body));
  const std::string seed = std::to_string(chosen.value_or(9001));
  if (episodes < 1 || episodes > 10'000) return Fail(Code::kInvalidArgument, "evaluate: episodes must be 1 to 10,000");
  ETUDE_ASSIGN_OR_RETURN(const Scenes scenes, ScenesFor(context, checkpoint, body));
  const Path folder = checkpoint.parent_path().parent_path();
  const std::string name =
      fmt::format("eval-{}-{}{}", checkpoint.stem().string(), seed, scenes.file.empty() ? "" : "-" + scenes.name);
  // beside the run, unless that is out of the folders that this gateway was given
  const Path out = IsGiven(context, folder.parent_path())
                       ? folder.parent_path() / fmt::format("{}-{}", folder.filename().string(), name)
                       : folder / name;
  ActionCommand command{{"eval", "--checkpoint", checkpoint.string(), "--episodes", std::to_string(episodes), "--seed",
                         seed, "--out", EvaluationFolder(out, folder).string()},
                        Weight::kHeavy};
  if (!scenes.file.empty()) command.AddFlags({"--scenes", scenes.file.string()});
  command.scenes = scenes.name;
  command.AddFlags(context.bus_flags(security::Role::kCollector));
  return command;
}

// Its collector does it: it answers on the bus.
Result<ActionCommand> Control(Context& context, const std::string& action, const OrderedJson& body) {
  ETUDE_ASSIGN_OR_RETURN(const std::string name, BusNameOfCampaign(context, TextOf(body, "campaign")));
  ActionCommand command{{"campaign", action, name}, Weight::kBrief};
  command.AddFlags(context.bus_flags(security::Role::kGateway));
  return command;
}

Result<ActionCommand> Promote(Context& context, const OrderedJson& body) {
  ETUDE_ASSIGN_OR_RETURN(const Path checkpoint, CheckpointOf(context, body));
  const Path run = checkpoint.parent_path().parent_path();
  return ActionCommand{.arguments = {"checkpoint", "promote", run.string(), checkpoint.filename().string()}};
}

Result<ActionCommand> Serve(Context& context, const OrderedJson& body) {
  if (context.domain < 0) return Fail(Code::kInvalidArgument, "serve: this gateway is on no bus (--no-bus)");
  ETUDE_ASSIGN_OR_RETURN(const OpenedRun run, OpenRun(context, TextOf(body, "run")));
  ActionCommand command{{"policy"}, Weight::kLasting};
  const auto live = context.live();
  const auto* const heard = LiveOf(*live, *run.view);
  if (TextOf(body, "file").empty() && heard && heard->present) {
    command.AddFlags({"--subscribe", BusId(heard->presence)});
  } else {
    ETUDE_ASSIGN_OR_RETURN(const Path checkpoint,
                           TextOf(body, "file").empty() ? NewestCheckpoint(run) : CheckpointOf(context, body));
    command.AddFlags({"--checkpoint", checkpoint.string()});
    // Under the run's own id, by which pages look for who serves it; but beside another server of it, a robot that asks
    // for the run would be answered by either: then under an id of its own
    const std::string& id = run.view->identity;
    if (!id.empty() && !(heard && heard->present) && ServersOf(*live, id).empty())
      command.AddFlags({"--run", run.source->found().folder.string()});
  }
  command.AddFlags(context.bus_flags(security::Role::kPolicy));
  // asked twice before the first is heard, it is the first
  command.once = fmt::format("serve {}", fmt::join(command.arguments, " "));
  return command;
}

// Into the gateway's own cache, wherever the dataset lies: nothing that is looked at is written to.
Result<ActionCommand> Replay(Context& context, const OrderedJson& body) {
  constexpr std::uint64_t kMostAttempts = 1'000'000;
  ETUDE_ASSIGN_OR_RETURN(const auto index, WholeIn(body, "index"));
  ETUDE_ASSIGN_OR_RETURN(const auto number, WholeIn(body, "attempt"));
  const auto attempt = number.value_or(0);
  if (!index || attempt > kMostAttempts)
    return Fail(Code::kInvalidArgument,
                fmt::format("replay: index must be given, and attempt be at most {}", kMostAttempts));
  ETUDE_ASSIGN_OR_RETURN(const auto wish,
                         FindAttempt(context, TextOf(body, "dataset"), *index, static_cast<std::uint32_t>(attempt)));
  const auto& replays = context.sources.replays();
  const Path place = replays.NewPlace(wish.key);
  ActionCommand command;
  const auto written_to = [&](const std::string& out) {
    return std::vector<std::string>{"attempt",
                                    "replay",
                                    wish.folder.string(),
                                    "--index",
                                    std::to_string(*index),
                                    "--attempt",
                                    std::to_string(attempt),
                                    "--out",
                                    out};
  };
  command.arguments = written_to(place.string());
  command.shown = written_to(fmt::format("attempt-{}-{}", *index, attempt));
  command.once = sources::Replays::IdOf(wish.key);
  command.there = replays.Find(wish.key).has_value();
  command.finish = [&context, &replays, place, key = wish.key](bool well) {
    if (!well) return sources::Replays::Discard(place);
    if (const Status kept = replays.Keep(place, key); !kept) Log().warn("{}", kept.error().message);
    context.later(http::Lane::kFiles, [&replays, key] { replays.Trim(key); });
  };
  return command;
}

// "0-3,7" -> {"0-3", "7"}
std::vector<std::string> SpansOf(const std::string& text) {
  std::vector<std::string> spans;
  for (std::size_t begin = 0; begin < text.size();) {
    const auto comma = std::min(text.find(',', begin), text.size());
    spans.push_back(text.substr(begin, comma - begin));
    begin = comma + 1;
  }
  return spans;
}

Result<ActionCommand> Mask(Context& context, const OrderedJson& body) {
  constexpr std::uint64_t kMostEpisodes = 10'000;
  constexpr std::size_t kMostSpans = 1'000;  // each is an argument of the command
  ETUDE_ASSIGN_OR_RETURN(const auto dataset, context.sources.Dataset(TextOf(body, "dataset")));
  const std::string key = TextOf(body, "key");
  // with '-' in front it would be an option
  if (!IsPlainName(key) || key.starts_with('-'))
    return Fail(Code::kInvalidArgument, "mask: key: a name has only a-z, 0-9, _ and -, at most 64 of them");
  ETUDE_ASSIGN_OR_RETURN(const auto indices, store::ParseIndices(TextOf(body, "indices"), kMostEpisodes));
  const auto spans = SpansOf(store::IndicesText(indices));
  if (spans.empty() || spans.size() > kMostSpans)
    return Fail(Code::kInvalidArgument, fmt::format("mask: indices: 1 to {} spans of episodes, 0-3,7", kMostSpans));
  ActionCommand command{{"dataset", "filter", dataset->found().folder.string(), "--index"}, Weight::kLight};
  command.AddFlags(spans);
  command.AddFlags({"--as", key});
  command.AddFlags(context.bus_flags(security::Role::kGateway));
  return command;
}

Result<ActionCommand> Verify(Context& context, const OrderedJson& body) {
  ETUDE_ASSIGN_OR_RETURN(const auto dataset, context.sources.Dataset(TextOf(body, "dataset")));
  return ActionCommand{.arguments = {"dataset", "verify", dataset->found().folder.string(), "--keep"},
                       .weight = Weight::kHeavy};
}

Result<ActionCommand> CommandFor(Context& context, const OrderedJson& body) {
  const std::string action = TextOf(body, "action");
  if (action == "evaluate") return Evaluate(context, body);
  if (action == "replay") return Replay(context, body);
  if (action == "verify") return Verify(context, body);
  if (action == "mask") return Mask(context, body);
  if (action == "promote") return Promote(context, body);
  if (action == "serve") return Serve(context, body);
  if (action == "pause" || action == "drain" || action == "resume" || action == "stop")
    return Control(context, action, body);
  std::vector<std::string> names;
  for (const auto& known : Known()) names.emplace_back(known.action);
  return Fail(Code::kInvalidArgument, "action: " + NotKnown(action.substr(0, 40), names));
}

Result<http::Answer> Act(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const OrderedJson body, JsonBody(request));
  ETUDE_ASSIGN_OR_RETURN(const ActionCommand command, CommandFor(context, body));
  std::vector<std::string> words{"etude"};
  words.insert(words.end(), command.arguments.begin(), command.arguments.end());
  std::vector<std::string> shown = words;
  if (!command.shown.empty()) {
    shown.resize(1);
    shown.insert(shown.end(), command.shown.begin(), command.shown.end());
  }
  const auto answer = [&command](OrderedJson json, int status) {
    if (!command.scenes.empty()) json["scenes"] = command.scenes;
    return http::JsonAnswer(json, status);
  };
  if (sources::FlagOf(body, "dry_run") || command.there) return answer({{"command", CommandText(shown)}}, 200);
  if (!request.authorized) return TokenNeeded(context, "copy the command, or sign in: " + CommandText(shown));
  ETUDE_ASSIGN_OR_RETURN(const std::string id, context.jobs.Add({TextOf(body, "action"), command.arguments,
                                                                 command.weight, command.once, command.finish}));
  return answer({{"job", id}, {"command", CommandText(words)}}, 202);
}

Result<http::Answer> Actions(Context& context, const http::Request& request) {
  OrderedJson rows = OrderedJson::array();
  for (const auto& known : Known()) {
    OrderedJson arguments = OrderedJson::array();
    for (const auto& argument : known.arguments)
      arguments.push_back(
          {{"name", argument.name}, {"required", argument.required}, {"description", argument.description}});
    const std::string why_not = context.security.enabled() ? "" : "the gateway was started without a token";
    rows.push_back({{"action", known.action},
                    {"description", known.description},
                    {"arguments", arguments},
                    {"available", why_not.empty()},
                    {"why_not", sources::TextOrNull(why_not)}});
  }
  return http::JsonAnswer(
      {{"enabled", context.security.enabled()}, {"authorized", request.authorized}, {"actions", rows}});
}

http::Answer Empty() {
  http::Answer answer;
  answer.status = 204;
  answer.content_type.clear();
  answer.caching = http::Caching::kNever;
  return answer;
}

Result<http::Answer> SignIn(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const OrderedJson body, JsonBody(request));
  if (!context.security.TokenMatches(TextOf(body, "token")))
    return http::Problem(context.security.enabled() ? 401 : 403, "Not the token", "that is not this gateway's token");
  http::Answer answer = Empty();
  answer.headers.emplace_back("Set-Cookie", context.security.CookieHeader());
  return answer;
}

}  // namespace

void AddActionRoutes(http::Router& router, Context& context) {
  const auto add = [&](const char* method, const std::string& path, http::Access access, auto handler) {
    router.Add(
        method, kPrefix + path, http::Lane::kFiles,
        [&context, handler](const http::Request& request) -> Result<http::Answer> { return handler(context, request); },
        access);
  };
  using http::Access;
  add("GET", "/actions", Access::kRead, Actions);
  add("POST", "/actions", Access::kRead, Act);  // it looks at the token itself: a dry run needs none
  add("GET", "/session", Access::kSignIn, [](Context& of, const http::Request& request) -> Result<http::Answer> {
    return http::JsonAnswer({{"enabled", of.security.enabled()}, {"authorized", request.authorized}});
  });
  add("POST", "/session", Access::kSignIn, SignIn);
  add("DELETE", "/session", Access::kSignIn, [](Context& of, const http::Request&) -> Result<http::Answer> {
    http::Answer answer = Empty();
    answer.headers.emplace_back("Set-Cookie", of.security.ExpiredCookieHeader());
    return answer;
  });
  add("GET", "/jobs", Access::kRead, [](Context& of, const http::Request&) -> Result<http::Answer> {
    return http::JsonAnswer({{"jobs", of.jobs.All()}});
  });
  add("GET", "/jobs/{id}", Access::kRead, [](Context& of, const http::Request& request) -> Result<http::Answer> {
    ETUDE_ASSIGN_OR_RETURN(const OrderedJson json, of.jobs.Json(request.Parameter("id")));
    return http::JsonAnswer(json);
  });
  add("DELETE", "/jobs/{id}", Access::kAction, [](Context& of, const http::Request& request) -> Result<http::Answer> {
    ETUDE_RETURN_IF_ERROR(of.jobs.Stop(request.Parameter("id")));
    return Empty();
  });
}

}  // namespace etude::api
