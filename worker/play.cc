// SPDX-License-Identifier: Apache-2.0
#include "worker/play.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <deque>
#include <optional>
#include <thread>

#include "services/bus/process_reporter.h"
#include "services/bus/topic.h"
#include "services/core/clock.h"
#include "services/core/identity.h"
#include "services/core/log.h"
#include "services/core/stop.h"
#include "services/episode/bounded_json.h"
#include "services/play/arguments.h"
#include "services/play/client.h"
#include "services/policy/client.h"
#include "services/spec/object_names.h"
#include "worker/task/play_session.h"
#include "worker/view/frame.h"

namespace etude {
namespace {

using namespace std::chrono_literals;
using TimePoint = MonotonicClock::time_point;

constexpr auto kMoving = 100ms;  // between two states, and two pictures, while something moves
constexpr auto kResting = 500ms;
constexpr auto kBehind = 200ms;           // more than this is not caught up with
constexpr std::size_t kAnswersKept = 64;  // of commands, for those that are said again
// A try at the policy ends well before those who watch take the session for gone (play::kSilent).
constexpr policy::ClientOptions kTry{.answer = 2s, .patience = 2s};
constexpr auto kPatience = 10s;  // over all tries

// Simulated time against the clock's.
class Pace {
 public:
  explicit Pace(double speed) : speed_(speed) { Restart(); }
  void Restart() {
    due_ = started_ = MonotonicClock::now();
    steps_ = 0;
  }
  // Before every control step.
  void Step() {
    ++steps_;
    if (speed_ <= 0) return;
    const auto now = MonotonicClock::now();
    // what the policy, or this machine, was late for is not made up for by haste
    if (now - due_ > kBehind) due_ = now;
    if (due_ > now) std::this_thread::sleep_until(due_);
    due_ += std::chrono::nanoseconds(static_cast<std::int64_t>(1e9 / (kControlRate * speed_)));
  }
  // Since the last call.
  double Measured() {
    const auto now = MonotonicClock::now();
    const double seconds = std::chrono::duration<double>(now - started_).count();
    const double speed = seconds > 0 ? steps_ / kControlRate / seconds : 0;
    started_ = now;
    steps_ = 0;
    return speed;
  }

 private:
  double speed_;
  TimePoint due_{}, started_{};
  int steps_ = 0;
};

std::vector<float> NumbersOf(const std::vector<Waypoint>& waypoints) {
  std::vector<float> numbers;
  for (const auto& waypoint : waypoints)
    for (const float value : ToVector(waypoint)) numbers.push_back(value);
  return numbers;
}

// The session, and what the bus sees of it.
class PlayHost {
 public:
  static Result<PlayHost> Open(const PlayOptions& options, const CampaignSpec& spec,
                               const bus::Participant& participant, const sim::RendererConfig& renderer);
  // Until it is closed, idle or stopped.
  Status Run();

 private:
  struct Answer {
    std::string id, refusal;
  };

  PlayHost(const PlayOptions& options, CampaignSpec spec, std::unique_ptr<task::PlaySession> session,
           policy::Client policy, bus::Reader<bus::PlayCommand> commands, bus::Writer<bus::PlayState> states,
           bus::Writer<bus::PlayFrame> frames)
      : options_(options),
        spec_(std::move(spec)),
        session_(std::move(session)),
        policy_(std::move(policy)),
        commands_(std::move(commands)),
        states_(std::move(states)),
        frames_(std::move(frames)),
        pace_(options.speed) {
    state_.session = options.session;
    state_.host = HostName();
    state_.pid = static_cast<std::uint32_t>(::getpid());
    state_.run = options.run;
    state_.phase = "rest";
  }

  void TakeCommands();
  Status Obey(const bus::PlayCommand& command);
  Status Scene(const OrderedJson& arguments);
  void ForgetSentence();
  Status Accept(const OrderedJson& arguments);
  void Say();
  Result<policy::Answer> Ask(const policy::Question& question);
  Status Reset();
  bool BeforeStep();
  void Publish(bool with_picture);
  void PublishPicture();
  bool moving() const { return state_.phase == "moving"; }

  PlayOptions options_;
  CampaignSpec spec_;
  std::unique_ptr<task::PlaySession> session_;
  policy::Client policy_;
  bus::Reader<bus::PlayCommand> commands_;
  bus::Writer<bus::PlayState> states_;
  bus::Writer<bus::PlayFrame> frames_;
  Pace pace_;
  bus::PlayState state_;
  std::uint64_t frame_number_ = 0;
  std::deque<Answer> answers_;  // newest last
  std::optional<task::Sentence> said_;
  bool stop_ = false, reset_ = false, close_ = false;
  TimePoint published_{}, asked_ = MonotonicClock::now();
};

Result<PlayHost> PlayHost::Open(const PlayOptions& options, const CampaignSpec& spec,
                                const bus::Participant& participant, const sim::RendererConfig& renderer) {
  ETUDE_ASSIGN_OR_RETURN(auto session, task::PlaySession::Open(spec, options.index, renderer));
  ETUDE_ASSIGN_OR_RETURN(auto policy,
                         policy::Client::Open(participant, options.run, play::PolicySession(options.session), kTry));
  ETUDE_ASSIGN_OR_RETURN(auto commands, bus::Reader<bus::PlayCommand>::Open(participant, bus::kPlayPartition));
  ETUDE_ASSIGN_OR_RETURN(auto states, bus::Writer<bus::PlayState>::Open(participant, bus::kPlayPartition));
  ETUDE_ASSIGN_OR_RETURN(auto frames,
                         bus::Writer<bus::PlayFrame>::Open(participant, play::FramePartition(options.session)));
  return PlayHost(options, spec, std::move(session), std::move(policy), std::move(commands), std::move(states),
                  std::move(frames));
}

Status PlayHost::Run() {
  while (!StopRequested() && !close_) {
    TakeCommands();
    if (said_) Say();
    if (std::exchange(reset_, false)) {
      ETUDE_RETURN_IF_ERROR(Reset());
      published_ = {};
    }
    if (MonotonicClock::now() - published_ >= kResting) Publish(true);
    const double idle = std::chrono::duration<double>(MonotonicClock::now() - asked_).count();
    if (options_.idle_s > 0 && idle > options_.idle_s) {
      Log().info("session={}: nobody has asked for anything for {:.0f} s", state_.session, idle);
      break;
    }
    commands_.Wait(kMoving);
  }
  state_.phase = "ended";
  Publish(false);
  return {};
}

// ---- commands -------------------------------------------------------------------------------------

void PlayHost::TakeCommands() {
  for (const auto& command : commands_.Take()) {
    if (command.session != state_.session) continue;
    asked_ = MonotonicClock::now();
    const auto known = std::ranges::find(answers_, command.command_id, &Answer::id);
    if (known != answers_.end()) {
      state_.refusal = known->refusal;
    } else {
      const Status obeyed = Obey(command);
      state_.refusal = obeyed ? "" : obeyed.error().message;
      answers_.push_back({command.command_id, state_.refusal});
      if (answers_.size() > kAnswersKept) answers_.pop_front();
      Log().info("session={} action={} by {}@{}{}", state_.session, static_cast<int>(command.action), command.user,
                 command.host, obeyed ? "" : " refused: " + state_.refusal);
    }
    state_.command_id = command.command_id;
    Publish(true);
  }
}

Status PlayHost::Obey(const bus::PlayCommand& command) {
  const auto json = ParseBoundedJson(command.arguments_json.empty() ? "{}" : command.arguments_json, 8);
  if (!json) return Fail(Code::kInvalidArgument, "play command: its arguments are not JSON");
  using bus::PlayAction;
  switch (command.action) {
    case PlayAction::kScene:
      return Scene(*json);
    case PlayAction::kSay:
      return Accept(*json);
    case PlayAction::kStop:
      stop_ = moving();
      return {};
    case PlayAction::kNudge: {
      ETUDE_ASSIGN_OR_RETURN(const auto nudge, play::ReadArguments<play::NudgeArguments>(*json));
      return session_->Nudge(nudge.object, nudge.dx, nudge.dy);
    }
    case PlayAction::kHide:
    case PlayAction::kShow: {
      ETUDE_ASSIGN_OR_RETURN(const auto chosen, play::ReadArguments<play::ObjectArguments>(*json));
      return command.action == PlayAction::kHide ? session_->Hide(chosen.object) : session_->Show(chosen.object);
    }
    case PlayAction::kReset:
      if (!moving()) return Reset();  // at once: the answer shows it, and the next command finds it done
      stop_ = reset_ = true;
      return {};
    case PlayAction::kClose:
      stop_ = close_ = true;
      return {};
  }
  return Fail(Code::kInvalidArgument, "play command: an action that this program does not know");
}

Status PlayHost::Scene(const OrderedJson& arguments) {
  if (moving() || said_) return Fail(Code::kUnavailable, "the policy drives: stop it first");
  ETUDE_ASSIGN_OR_RETURN(const auto scene, play::ReadArguments<play::SceneArguments>(arguments));
  if (scene.keep) return session_->Place(scene.objects);
  ETUDE_RETURN_IF_ERROR(session_->SetScene(scene.index, scene.objects));
  ForgetSentence();
  return {};
}

Status PlayHost::Reset() {
  ETUDE_RETURN_IF_ERROR(session_->Reset());
  ForgetSentence();
  return {};
}

void PlayHost::ForgetSentence() {
  state_.outcome.clear();
  state_.reason.clear();
  state_.sentence.clear();
  state_.meaning_json.clear();
}

Status PlayHost::Accept(const OrderedJson& arguments) {
  if (moving() || said_) return Fail(Code::kUnavailable, "a sentence is being obeyed: stop it first");
  ETUDE_ASSIGN_OR_RETURN(const auto said, play::ReadArguments<play::SayArguments>(arguments));
  task::Sentence sentence{.text = said.sentence,
                          .task = said.task,
                          .target = said.target,
                          .reference = said.reference,
                          .max_steps = std::max(0, said.max_steps),
                          .home = said.home};
  ETUDE_RETURN_IF_ERROR(session_->Check(sentence));
  state_.sentence = sentence.text;
  state_.meaning_json =
      sentence.judged()
          ? JsonText({{"task", sentence.task}, {"target", sentence.target}, {"reference", sentence.reference}})
          : "";
  state_.outcome.clear();
  state_.reason.clear();
  state_.phase = "moving";  // whoever reads the answer sees that it goes on
  stop_ = false;            // a stop that comes with the sentence counts
  said_ = std::move(sentence);
  return {};
}

// ---- driving --------------------------------------------------------------------------------------

void PlayHost::Say() {
  const task::Sentence sentence = *std::exchange(said_, std::nullopt);
  pace_.Restart();
  auto verdict = session_->Say(
      sentence, [this](const policy::Question& question) { return Ask(question); }, [this] { return BeforeStep(); });
  if (verdict && verdict->outcome == task::AttemptOutcome::kPolicyError && stop_)
    verdict->outcome = task::AttemptOutcome::kStopped;
  state_.phase = "rest";
  asked_ = MonotonicClock::now();
  if (verdict) {
    const bool to_its_end = !sentence.judged() && verdict->outcome == task::AttemptOutcome::kTimeout;
    state_.outcome = to_its_end ? "unjudged" : std::string(task::ToString(verdict->outcome));
    state_.reason = to_its_end ? "" : verdict->reason;
    if (sentence.judged() && verdict->outcome != task::AttemptOutcome::kStopped) {
      ++state_.attempts;
      state_.successes += verdict->ok();
    }
  } else {
    state_.outcome = "refused";
    state_.reason = verdict.error().message;
  }
  Log().info("session={} sentence='{}': {} {}", state_.session, sentence.text, state_.outcome, state_.reason);
  Publish(true);
}

// In short tries: between two of them the session says that it is there, and can be stopped.
Result<policy::Answer> PlayHost::Ask(const policy::Question& question) {
  const auto deadline = MonotonicClock::now() + kPatience;
  while (true) {
    auto answer = policy_.Ask(question);
    const bool again = !answer && answer.error().code == Code::kUnavailable && MonotonicClock::now() < deadline;
    if (!again || StopRequested()) return answer;
    TakeCommands();
    if (stop_) return Fail(Code::kTimeout, "stopped while it waited for its policy");
    Publish(false);
  }
}

bool PlayHost::BeforeStep() {
  pace_.Step();
  TakeCommands();
  if (MonotonicClock::now() - published_ >= kMoving) Publish(true);
  return !stop_ && !StopRequested();
}

// ---- what is said ---------------------------------------------------------------------------------

void PlayHost::Publish(bool with_picture) {
  published_ = MonotonicClock::now();
  OrderedJson scene = session_->SceneJson();
  scene["campaign"] = spec_.name;
  scene["tasks"] = spec_.tasks;
  scene["campaign_objects"] = SceneNames(spec_.objects);
  state_.scene_json = JsonText(scene);
  state_.step = static_cast<std::uint32_t>(session_->step());
  state_.max_steps = static_cast<std::uint32_t>(session_->max_steps());
  OrderedJson judge = session_->JudgeJson();
  judge["doing"] = std::string(session_->doing());
  state_.judge_json = JsonText(judge);
  const Eigen::VectorXf arm = session_->world().q().cast<float>();
  const Eigen::VectorXf gripper = session_->world().gripper_q().cast<float>();
  state_.joints.assign(arm.begin(), arm.end());
  state_.joints.insert(state_.joints.end(), gripper.begin(), gripper.end());
  const policy::Answer& answer = session_->answer();
  state_.waypoints = NumbersOf(answer.waypoints);
  if (!std::ranges::all_of(state_.waypoints, [](float value) { return std::isfinite(value); }))
    state_.waypoints.clear();
  state_.modules_json = answer.modules.is_object() ? JsonText(answer.modules) : "";
  state_.checkpoint_step = answer.checkpoint_step;
  state_.policy_ms = session_->policy_ms();
  state_.speed = moving() ? pace_.Measured() : 0;
  if (const Status written = states_.Write(state_); !written)
    Log().warn("session={}: {}", state_.session, written.error().message);
  if (with_picture && frames_.matched_readers() > 0) PublishPicture();
}

void PlayHost::PublishPicture() {
  const Camera& camera = session_->camera();
  auto image = EncodeJpeg(session_->Picture(), camera.width, camera.height);
  if (!image) return Log().warn("session={}: {}", state_.session, image.error().message);
  bus::PlayFrame frame;
  frame.session = state_.session;
  frame.number = ++frame_number_;
  frame.step = state_.step;
  frame.width = static_cast<std::uint32_t>(camera.width);
  frame.height = static_cast<std::uint32_t>(camera.height);
  frame.format = "jpeg";
  frame.image = std::move(*image);
  if (const Status written = frames_.Write(frame); !written)
    Log().warn("session={}: {}", state_.session, written.error().message);
}

}  // namespace

CLI::App* AddPlay(CLI::App& app, PlayOptions& options) {
  auto* play = app.add_subcommand("play", "keep a scene in which people talk to a policy (`etude play`)");
  play->add_option("spec", options.spec.file, "campaign file, or the folder of a dataset")->required();
  play->add_option("--run", options.run, "policy to ask: the run whose checkpoints it serves, NAME or NAME@ID")
      ->required();
  play->add_option("--session", options.session, "name of the session (default: one of its own)");
  play->add_option("--index", options.index, "episode whose scene it begins with")->capture_default_str();
  play->add_option("--seed", options.spec.seed, "instead of the spec's");
  play->add_option("--speed", options.speed, "of the simulation against the clock; 0: as fast as it goes")
      ->check((CLI::Range(0.0, 0.0) | CLI::Range(0.01, 100.0)).description("0 or 0.01 .. 100"))
      ->capture_default_str();
  play->add_option("--idle", options.idle_s, "s without a command after which it ends; 0: never")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  play->add_option("--set", options.spec.overrides, "KEY=VALUE over the spec's, e.g. camera.width=448")
      ->allow_extra_args(false)
      ->type_name("KEY=VALUE");
  return play;
}

Status Play(const PlayOptions& options, const bus::Arguments& bus, const sim::RendererConfig& renderer) {
  PlayOptions chosen = options;
  if (chosen.session.empty()) chosen.session = "play-" + NewId().substr(0, 6);
  if (!play::IsSessionName(chosen.session))
    return Fail(Code::kInvalidArgument,
                fmt::format("--session '{:.80}': letters, digits, _ and -, 1 to 64 of them", chosen.session));
  if (chosen.spec.seed) chosen.spec.overrides.push_back(fmt::format("seed={}", *chosen.spec.seed));
  ETUDE_ASSIGN_OR_RETURN(const CampaignSpec spec, campaign::LoadSpecOrDataset(chosen.spec));
  ETUDE_ASSIGN_OR_RETURN(const auto participant, bus.Open({security::Role::kWorker}));
  ETUDE_ASSIGN_OR_RETURN(const auto reporter, bus::ProcessReporter::Start(participant, {.role = "play"}));
  ETUDE_ASSIGN_OR_RETURN(PlayHost host, PlayHost::Open(chosen, spec, participant, renderer));
  // the name is what people and programs wait for
  fmt::print("play {}\n", chosen.session);
  std::fflush(stdout);
  return host.Run();
}

}  // namespace etude
