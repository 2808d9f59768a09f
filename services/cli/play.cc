// SPDX-License-Identifier: Apache-2.0
// `etude play open|list|say|stop|nudge|hide|show|scene|reset|close`: talking to a policy in a scene that a worker
// keeps.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <optional>
#include <sstream>

#include "services/campaign/process.h"
#include "services/cli/command_line.h"
#include "services/cli/service.h"
#include "services/cli/training_words.h"
#include "services/core/command.h"
#include "services/core/identity.h"
#include "services/core/printable.h"
#include "services/core/run_name.h"
#include "services/core/stop.h"
#include "services/episode/bounded_json.h"
#include "services/language/meaning.h"
#include "services/play/arguments.h"
#include "services/play/client.h"

namespace etude::cli {
namespace {

using namespace std::chrono_literals;

constexpr auto kAppears = 3s;   // a session that is there is heard within this
constexpr auto kOpens = 120s;   // a scene is compiled and drawn
constexpr auto kLine = 1000ms;  // between two lines of a sentence that is obeyed

struct PlayArguments {
  std::string session;
  play::SayArguments say;
  bool stay = false, as_json = false;
  play::NudgeArguments nudge;
  std::uint64_t index = 0;
  std::optional<std::uint64_t> other_scene;
  std::vector<std::string> places;
  // open
  std::string spec, run, checkpoint;
  double speed = 1, idle_s = 900;
  std::vector<std::string> sentences, overrides;
  BusArguments bus;
};

OrderedJson Parsed(const std::string& text) {
  auto json = ParseBoundedJson(text, 12);
  return json && json->is_object() ? std::move(*json) : OrderedJson::object();
}

std::vector<std::string> TextsOf(const OrderedJson& json, const char* key) {
  std::vector<std::string> texts;
  if (json.is_object() && json.contains(key) && json[key].is_array())
    for (const auto& item : json[key])
      if (item.is_string()) texts.push_back(item.get<std::string>());
  return texts;
}

std::string WordOfState(const OrderedJson& json, const char* key) {
  return json.is_object() && json.contains(key) && json[key].is_string() ? json[key].get<std::string>() : "";
}

// The objects that stand in a session's scene.
std::vector<std::string> OnTable(const OrderedJson& scene) {
  std::vector<std::string> names;
  if (!scene.is_object() || !scene.contains("objects") || !scene["objects"].is_array()) return names;
  for (const auto& object : scene["objects"])
    if (object.is_object() && !(object.contains("hidden") && object["hidden"] == true))
      names.push_back(WordOfState(object, "name"));
  return names;
}

// What a sentence means in a session, as the person has it: the options first, else the grammar.
Result<language::Meaning> MeaningIn(const bus::PlayState& state, const std::string& sentence) {
  const OrderedJson scene = Parsed(state.scene_json);
  ETUDE_ASSIGN_OR_RETURN(const auto parser,
                         language::MeaningParser::Load(TextsOf(scene, "tasks"), TextsOf(scene, "campaign_objects")));
  return parser.Parse(sentence, OnTable(scene));
}

// Of the policy's training, where its checkpoint says them; else of what the session's campaign would say.
void PrintWords(const language::Meaning& meaning, bool of_training) {
  const auto unseen = meaning.unseen();
  const char* who = of_training ? "training" : "a training on this campaign";
  fmt::print("  words   {}\n", unseen.empty() ? fmt::format("{} says all of them", who)
                                              : fmt::format("never seen in {}: {}", who, fmt::join(unseen, ", ")));
}

void PrintMeaning(const language::Meaning& meaning, const play::SayArguments& say) {
  fmt::print("\"{}\"\n", say.sentence);
  if (say.task.empty())
    fmt::print("  means   not known ({}): not judged; --task and --target say what it means\n", meaning.why);
  else
    fmt::print("  means   {} {}{}\n", say.task, say.target, say.reference.empty() ? "" : ", " + say.reference);
}

// What others say on the bus moves no cursor.
void Print(const std::string& line) { fmt::print("{}\n", Printable(line)); }

void PrintLine(const bus::PlayState& state) {
  const OrderedJson judge = Parsed(state.judge_json);
  Print(fmt::format("  step {:4} of {}  {}  policy {:.0f} ms (checkpoint {})  {:.1f}x  {}", state.step, state.max_steps,
                    WordOfState(judge, "doing"), state.policy_ms, state.checkpoint_step, state.speed,
                    WordOfState(judge, "words")));
  std::fflush(stdout);
}

// The state in which the sentence has ended; lines meanwhile, but not as JSON. @error kUnavailable: the session is
// gone; kTimeout: a stop was requested, which the session is told
Result<bus::PlayState> Follow(play::Client& client, const std::string& session, const PlayArguments& arguments) {
  MonotonicClock::time_point printed = MonotonicClock::now();
  while (!StopRequested()) {
    const auto& sessions = client.Listen(500ms);
    const auto found = sessions.find(session);
    if (found == sessions.end())
      return Fail(Code::kUnavailable, fmt::format("play session '{}' has ended, or is silent", session));
    const bus::PlayState& state = found->second.state;
    if (state.phase != "moving") return state;
    if (arguments.as_json || MonotonicClock::now() - printed < kLine) continue;
    PrintLine(state);
    printed = MonotonicClock::now();
  }
  (void)client.Command(session, bus::PlayAction::kStop, OrderedJson::object(), 2s);
  return Fail(Code::kTimeout, "stopped");
}

// What a sentence means, before it is obeyed.
OrderedJson MeaningJson(const language::Meaning& meaning, const play::SayArguments& say, bool of_training) {
  OrderedJson json{{"sentence", say.sentence}, {"means", nullptr}, {"why_not", nullptr}};
  if (say.task.empty())
    json["why_not"] = meaning.why;
  else
    json["means"] = {{"task", say.task}, {"target", say.target}, {"reference", say.reference}};
  json["unseen"] = meaning.unseen();
  json["unseen_by"] = of_training ? "training" : "campaign";
  return json;
}

// @param said  gets what `--json` prints. @error as Follow; kInternal: it was not done
Status SayIn(const bus::Participant& participant, play::Client& client, const PlayArguments& arguments,
             OrderedJson& said) {
  const std::string& session = arguments.session;
  ETUDE_ASSIGN_OR_RETURN(const bus::PlayState state, client.Find(session, kAppears));
  play::SayArguments say = arguments.say;
  say.home = !arguments.stay;
  ETUDE_ASSIGN_OR_RETURN(language::Meaning meaning, MeaningIn(state, say.sentence));
  const auto words = TrainingWords(participant, state.run);
  if (words) language::MarkSeen(meaning, *words);
  if (say.task.empty() && meaning.command) {
    say.task = meaning.task();
    if (say.target.empty()) say.target = meaning.command->target;
    if (say.reference.empty()) say.reference = meaning.command->reference;
  }
  said = MeaningJson(meaning, say, words.has_value());
  if (!arguments.as_json) {
    PrintMeaning(meaning, say);
    PrintWords(meaning, words.has_value());
    std::fflush(stdout);
  }
  ETUDE_ASSIGN_OR_RETURN(const bus::PlayState taken, client.Command(session, bus::PlayAction::kSay, ToJson(say)));
  (void)taken;
  ETUDE_ASSIGN_OR_RETURN(const bus::PlayState ended, Follow(client, session, arguments));
  const std::string& outcome = ended.outcome;
  said["outcome"] = outcome;
  said["reason"] = ended.reason;
  said["steps"] = ended.step;
  said["checkpoint_step"] = ended.checkpoint_step;
  if (!arguments.as_json)
    Print(fmt::format("  {} after {} steps{}{}", outcome, ended.step, ended.reason.empty() ? "" : ": ", ended.reason));
  std::fflush(stdout);
  if (outcome == "success" || outcome == "unjudged" || outcome == "stopped") return {};
  return Fail(Code::kInternal, fmt::format("\"{}\": {}", ended.sentence, outcome));
}

Status ListSessions(const PlayArguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open({security::Role::kGateway}));
  ETUDE_ASSIGN_OR_RETURN(auto client, play::Client::Open(participant));
  const auto until = MonotonicClock::now() + kAppears;
  while (MonotonicClock::now() < until && !StopRequested()) client.Listen(200ms);
  OrderedJson all = OrderedJson::array();
  for (const auto& [name, heard] : client.Listen(0ns)) {
    const bus::PlayState& state = heard.state;
    const OrderedJson scene = Parsed(state.scene_json);
    all.push_back({{"session", name},
                   {"host", state.host},
                   {"run", state.run},
                   {"phase", state.phase},
                   {"scene", scene},
                   {"sentence", state.sentence},
                   {"outcome", state.outcome},
                   {"attempts", state.attempts},
                   {"successes", state.successes}});
    if (arguments.as_json) continue;
    const bool numbered = scene.contains("index") && scene["index"].is_number_unsigned();
    Print(fmt::format("{}  {}  policy {}  {} scene {}  {} of {} sentences done  host {}", name, state.phase, state.run,
                      WordOfState(scene, "campaign"), numbered ? scene["index"].get<std::uint64_t>() : 0,
                      state.successes, state.attempts, state.host));
  }
  if (arguments.as_json)
    fmt::print("{}\n", JsonText(all, 1));
  else if (all.empty())
    fmt::print("no play session is live on domain {}; open one with: etude play open SPEC --run RUN\n",
               participant.domain());
  return {};
}

Status Say(const PlayArguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open({security::Role::kGateway}));
  ETUDE_ASSIGN_OR_RETURN(auto client, play::Client::Open(participant));
  OrderedJson said;
  const Status done = SayIn(participant, client, arguments, said);
  // also of a sentence that was not done, and of one that never began as far as it is known
  if (arguments.as_json && said.is_object()) {
    said["session"] = arguments.session;
    fmt::print("{}\n", JsonText(said, 1));
  }
  return done;
}

Status SendCommand(const PlayArguments& arguments, bus::PlayAction action, const OrderedJson& json) {
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open({security::Role::kGateway}));
  ETUDE_ASSIGN_OR_RETURN(auto client, play::Client::Open(participant));
  ETUDE_ASSIGN_OR_RETURN(const bus::PlayState found, client.Find(arguments.session, kAppears));
  ETUDE_ASSIGN_OR_RETURN(const bus::PlayState state, client.Command(found.session, action, json));
  Print(fmt::format("{}: {}", state.session, action == bus::PlayAction::kClose ? "ending" : state.phase));
  return {};
}

// "coke=0.1,0.45" or "coke=0.1,0.45,0.3": m, m, rad
Result<play::ObjectPlace> PlaceOf(const std::string& text) {
  play::ObjectPlace place;
  const auto equals = text.find('=');
  std::istringstream numbers(equals == std::string::npos ? "" : text.substr(equals + 1));
  char comma = ',';
  place.name = text.substr(0, equals);
  bool read = static_cast<bool>(numbers >> place.x >> comma >> place.y) && comma == ',';
  if (read && numbers.peek() == ',') read = static_cast<bool>(numbers >> comma >> place.yaw);
  numbers >> std::ws;
  if (read && numbers.eof()) return place;
  return Fail(Code::kInvalidArgument, fmt::format("--place '{}': write OBJECT=X,Y or OBJECT=X,Y,YAW (m, rad)", text));
}

Status SetScene(const PlayArguments& arguments) {
  if (!arguments.other_scene && arguments.places.empty())
    return Fail(Code::kInvalidArgument, "set a scene: give --index, --place or both");
  play::SceneArguments scene{.index = arguments.other_scene.value_or(0), .objects = {}, .keep = !arguments.other_scene};
  for (const auto& text : arguments.places) {
    ETUDE_ASSIGN_OR_RETURN(auto place, PlaceOf(text));
    scene.objects.push_back(std::move(place));
  }
  return SendCommand(arguments, bus::PlayAction::kScene, ToJson(scene));
}

// ---- open -----------------------------------------------------------------------------------------

struct Children {
  std::optional<Service> policy;
  std::optional<campaign::Process> worker;

  ~Children() {
    if (worker) worker->Stop(5s);
    if (policy) policy->Stop(5s);
  }
};

Status StartPolicy(const PlayArguments& arguments, std::string& run, Children& children) {
  if (arguments.checkpoint.empty()) return {};
  const std::string id = NewId();
  run = "play-" + id.substr(0, 6) + "@" + id;
  ServiceOptions options;
  options.program = "etude-policy";
  options.arguments = {"--checkpoint", arguments.checkpoint, "--run", run};
  const auto flags = arguments.bus.Flags(security::Role::kPolicy);
  options.arguments.insert(options.arguments.end(), flags.begin(), flags.end());
  options.environment = arguments.bus.Environment();
  ETUDE_ASSIGN_OR_RETURN(auto policy, Service::Start(options));
  children.policy.emplace(std::move(policy));
  return {};
}

Status StartWorker(const PlayArguments& arguments, const std::string& run, Children& children) {
  ETUDE_ASSIGN_OR_RETURN(const Path program, campaign::FindSibling("etude-worker"));
  campaign::ProcessOptions options;
  options.argv = {program.string(),
                  "play",
                  arguments.spec,
                  "--run",
                  run,
                  "--session",
                  arguments.session,
                  "--index",
                  std::to_string(arguments.index),
                  "--speed",
                  fmt::format("{}", arguments.speed),
                  "--idle",
                  fmt::format("{}", arguments.idle_s)};
  for (const auto& text : arguments.overrides) options.argv.insert(options.argv.end(), {"--set", text});
  const auto flags = arguments.bus.Flags(security::Role::kWorker);
  options.argv.insert(options.argv.end(), flags.begin(), flags.end());
  options.environment = arguments.bus.Environment();
  if (arguments.as_json) options.output = STDERR_FILENO;  // it says its name, which is no JSON
  ETUDE_ASSIGN_OR_RETURN(auto worker, campaign::Process::Start(options));
  children.worker.emplace(std::move(worker));
  return {};
}

Status AwaitSession(play::Client& client, const PlayArguments& arguments, Children& children) {
  const auto deadline = MonotonicClock::now() + kOpens;
  while (MonotonicClock::now() < deadline && !StopRequested()) {
    if (client.Listen(200ms).contains(arguments.session)) return {};
    if (children.policy) ETUDE_RETURN_IF_ERROR(children.policy->Supervise());
    // the worker has said what is wrong
    if (const auto code = children.worker->Poll())
      return Fail(CodeForExit(*code),
                  fmt::format("open a play session: etude-worker ended with {}", campaign::HowItEnded(*code)));
  }
  if (StopRequested()) return Fail(Code::kTimeout, "stopped");
  return Fail(
      Code::kTimeout,
      "open a play session: it does not appear; with a profile without multicast this host has to be one of its "
      "hubs (etude doctor net --write-profile)");
}

// One after another; the first error is that of all.
Status SayAll(const bus::Participant& participant, play::Client& client, PlayArguments arguments, OrderedJson& all) {
  Status first;
  for (const auto& sentence : arguments.sentences) {
    arguments.say = {
        .sentence = sentence, .task = "", .target = "", .reference = "", .max_steps = arguments.say.max_steps};
    OrderedJson one;
    const Status said = SayIn(participant, client, arguments, one);
    if (one.is_object()) all.push_back(std::move(one));
    if (first && !said) first = said;
    if (StopRequested() || (!said && said.error().code == Code::kUnavailable)) break;
  }
  return first;
}

// A second session of one name would hear the first one's commands, and be taken for it.
Status CheckFree(play::Client& client, const PlayArguments& arguments) {
  const auto found = client.Find(arguments.session, kAppears);
  if (!found) return {};
  return Fail(Code::kInvalidArgument,
              fmt::format("--session '{}': it is open already, on {}; talk to it with `etude play "
                          "say {}{} ...`, or give another name",
                          arguments.session, found->host, arguments.session, arguments.bus.Words()));
}

Status Open(PlayArguments arguments) {
  const bool named = !arguments.session.empty();
  if (!named) arguments.session = "play-" + NewId().substr(0, 6);
  if (arguments.run.empty() == arguments.checkpoint.empty())
    return Fail(Code::kInvalidArgument, "open a play session: give either --run or --checkpoint");
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open({security::Role::kGateway}));
  ETUDE_ASSIGN_OR_RETURN(auto client, play::Client::Open(participant));
  if (named) ETUDE_RETURN_IF_ERROR(CheckFree(client, arguments));
  Children children;
  std::string run = arguments.run;
  ETUDE_RETURN_IF_ERROR(StartPolicy(arguments, run, children));
  ETUDE_RETURN_IF_ERROR(StartWorker(arguments, run, children));
  ETUDE_RETURN_IF_ERROR(AwaitSession(client, arguments, children));
  OrderedJson opened{{"session", arguments.session},
                     {"domain", participant.domain()},
                     {"run", run},
                     {"sentences", OrderedJson::array()}};
  if (arguments.sentences.empty() && arguments.as_json) {
    fmt::print("{}\n", JsonText(opened, 1));
    std::fflush(stdout);
  } else if (arguments.sentences.empty()) {
    fmt::print("talk to it with: etude play say {}{} 'push the red can'\n", arguments.session, arguments.bus.Words());
    std::fflush(stdout);
  }
  const Status done = SayAll(participant, client, arguments, opened["sentences"]);
  if (!arguments.sentences.empty() && arguments.as_json) fmt::print("{}\n", JsonText(opened, 1));
  while (arguments.sentences.empty() && children.worker->running() && !StopRequested()) {
    if (children.policy) ETUDE_RETURN_IF_ERROR(children.policy->Supervise());
    children.worker->Wait(250ms);
  }
  if (const int code = children.worker->Poll().value_or(0); code != 0 && !StopRequested() && done)
    return Fail(CodeForExit(code), fmt::format("play session {}: its worker ended with {}", arguments.session,
                                               campaign::HowItEnded(code)));
  return done;
}

// ---- declarations ---------------------------------------------------------------------------------

using Shared = std::shared_ptr<PlayArguments>;

void AddOpen(CLI::App& command, const Shared& arguments, Body& body) {
  auto* open = command.add_subcommand("open", "a scene, kept by a worker until it is closed; with --say for as long");
  open->add_option("spec", arguments->spec, "campaign file, or the folder of a dataset")->required();
  open->add_option("--run", arguments->run, "policy to ask: the run whose checkpoints are served, NAME or NAME@ID");
  open->add_option("--checkpoint", arguments->checkpoint,
                   "a .safetensors file, or a run's folder, to serve it meanwhile")
      ->transform(CheckpointFile);
  open->add_option("--index", arguments->index, "episode whose scene it begins with")->capture_default_str();
  open->add_option("--session", arguments->session, "name (default: one of its own)");
  open->add_option("--say", arguments->sentences, "sentence; several are said one after another, in the same scene")
      ->allow_extra_args(false);
  open->add_option("--max-steps", arguments->say.max_steps, "control steps of a sentence; 0: the campaign's");
  open->add_flag("--stay", arguments->stay, "the arm does not come home between two sentences");
  open->add_flag("--json", arguments->as_json, "one JSON object: when it is open, or with --say when all is said");
  open->add_option("--speed", arguments->speed, "of the simulation against the clock; 0: as fast as it goes")
      ->capture_default_str();
  open->add_option("--idle", arguments->idle_s, "s without a command after which it ends; 0: never")
      ->capture_default_str();
  AddOverrides(*open, arguments->overrides, "camera.width=448");
  arguments->bus.Add(*open);
  open->callback([=, &body] { body = [=] { return Open(*arguments); }; });
}

CLI::App* AddOne(CLI::App& command, const char* name, const char* description, const Shared& arguments) {
  auto* one = command.add_subcommand(name, description);
  one->add_option("session", arguments->session, "as `etude play list` shows it")->required();
  arguments->bus.Add(*one);
  return one;
}

void AddSay(CLI::App& command, const Shared& arguments, Body& body) {
  auto* say = AddOne(command, "say", "a sentence: what it means, then how it goes, until it is done or not", arguments);
  say->add_option("sentence", arguments->say.sentence, "for the policy")->required();
  say->add_option("--task", arguments->say.task, "that it means, for the judge (default: as the grammar has it)");
  say->add_option("--target", arguments->say.target, "object that it is about");
  say->add_option("--reference", arguments->say.reference, "object beside which");
  say->add_option("--max-steps", arguments->say.max_steps, "control steps; 0: the campaign's");
  say->add_flag("--stay", arguments->stay, "the arm does not come home first");
  say->add_flag("--json", arguments->as_json, "one JSON object, when it has ended");
  say->callback([=, &body] { body = [=] { return Say(*arguments); }; });
}

void AddMoves(CLI::App& command, const Shared& arguments, Body& body) {
  auto* nudge = AddOne(command, "nudge", "slides an object over the table", arguments);
  nudge->add_option("object", arguments->nudge.object, "as the scene calls it")->required();
  nudge->add_option("dx", arguments->nudge.dx, "m, world")->required();
  nudge->add_option("dy", arguments->nudge.dy, "m, world")->required();
  nudge->callback([=, &body] {
    body = [=] { return SendCommand(*arguments, bus::PlayAction::kNudge, ToJson(arguments->nudge)); };
  });
  for (const auto& [name, action, description] :
       {std::tuple{"hide", bus::PlayAction::kHide, "takes an object out of the picture"},
        {"show", bus::PlayAction::kShow, "puts a hidden object back"}}) {
    auto* one = AddOne(command, name, description, arguments);
    one->add_option("object", arguments->nudge.object, "as the scene calls it")->required();
    one->callback([=, &body, chosen = action] {
      body = [=] {
        const play::ObjectArguments object{arguments->nudge.object};
        return SendCommand(*arguments, chosen, ToJson(object));
      };
    });
  }
  auto* scene =
      AddOne(command, "scene", "sets another scene; without --index only moves the placed objects", arguments);
  scene->add_option("--index", arguments->other_scene,
                    "episode of the session's campaign (default: the scene that is there)");
  scene->add_option("--place", arguments->places, "OBJECT=X,Y or OBJECT=X,Y,YAW: m and rad, world; repeatable")
      ->allow_extra_args(false);
  scene->callback([=, &body] { body = [=] { return SetScene(*arguments); }; });
}

}  // namespace

void AddPlay(CLI::App& app, Body& body) {
  auto* command = AddGroup(app, "play", "talk to a policy in a scene of your own: open, say, nudge, hide, reset ...");
  auto arguments = std::make_shared<PlayArguments>();
  AddOpen(*command, arguments, body);
  auto* list = command->add_subcommand("list", "sessions that are live on this domain");
  list->add_flag("--json", arguments->as_json, "as JSON");
  arguments->bus.Add(*list);
  list->callback([=, &body] { body = [=] { return ListSessions(*arguments); }; });
  AddSay(*command, arguments, body);
  AddMoves(*command, arguments, body);
  for (const auto& [name, action, description] :
       {std::tuple{"stop", bus::PlayAction::kStop, "the policy stops driving; the scene stays"},
        {"reset", bus::PlayAction::kReset, "the scene as it was set"},
        {"close", bus::PlayAction::kClose, "ends the session"}}) {
    auto* one = AddOne(*command, name, description, arguments);
    one->callback(
        [=, &body, chosen = action] { body = [=] { return SendCommand(*arguments, chosen, OrderedJson::object()); }; });
  }
}

}  // namespace etude::cli
