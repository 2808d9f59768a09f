// SPDX-License-Identifier: Apache-2.0
#include "services/policy/client.h"

#include <fmt/format.h>

#include <cmath>
#include <optional>

#include "services/core/clock.h"
#include "services/core/stop.h"
#include "services/episode/bounded_json.h"
#include "services/policy/conversation.h"
#include "services/policy/conversion.h"

namespace etude::policy {
namespace {

constexpr std::chrono::milliseconds kAskAgainAfterRefusal{500};

Result<Answer> AnswerOf(const bus::Action& action) {
  if (action.rotation != kRotationFormat)
    return Fail(Code::kInvalidArgument, fmt::format("policy '{}' answered rotations as '{}', expected '{}'", action.run,
                                                    action.rotation, kRotationFormat));
  if (!AreWaypoints(action.waypoints))
    return Fail(Code::kCorrupt, fmt::format("policy '{}' answered {} numbers, expected {}, all of them finite",
                                            action.run, action.waypoints.size(), kWaypoints * kWaypointSize));
  Answer answer;
  answer.waypoints = WaypointsOf(action.waypoints);
  answer.modules = ParseBoundedJson(action.modules_json).value_or(OrderedJson::object());
  answer.checkpoint_step = action.checkpoint_step;
  if (std::isfinite(action.server_p99_ms) && action.server_p99_ms > 0) answer.server_p99_ms = action.server_p99_ms;
  return answer;
}

}  // namespace

struct Client::Impl {
  const bus::Participant* participant = nullptr;
  Selector run;
  std::string session;
  ClientOptions options;
  bus::Directory directory;
  std::optional<Conversation<bus::Action>> connection = {};
  std::uint64_t request_id = 0;

  Status Connect(std::chrono::nanoseconds timeout);
  bool ServerHasGone();
  std::optional<bus::Action> Await(std::uint64_t first, std::chrono::nanoseconds timeout);
};

// Looks for the server; nothing is connected when there is none within `timeout`.
Status Client::Impl::Connect(std::chrono::nanoseconds timeout) {
  ETUDE_ASSIGN_OR_RETURN(connection,
                         Conversation<bus::Action>::Begin(*participant, directory, run, {timeout, timeout}));
  return {};
}

// Also when a newer one of the same run is there: a process that was killed stays in the directory for a while.
bool Client::Impl::ServerHasGone() {
  const auto live = directory.Matching(bus::PresenceKind::kPolicy, {run.name, connection->server.id});
  return live.empty() || live.front().instance != connection->server.instance;
}

// The answer to whichever try since `first`, which all ask the same; or nothing within `timeout`.
std::optional<bus::Action> Client::Impl::Await(std::uint64_t first, std::chrono::nanoseconds timeout) {
  return connection->Await(timeout, [&](const bus::Action& action) {
    return action.session == session && action.request_id >= first && action.request_id <= request_id;
  });
}

Client::Client(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Client::Client(Client&&) noexcept = default;
Client& Client::operator=(Client&&) noexcept = default;
Client::~Client() = default;

Result<Client> Client::Open(const bus::Participant& participant, const std::string& run, const std::string& session,
                            const ClientOptions& options) {
  ETUDE_ASSIGN_OR_RETURN(auto selector, ParseSelector(run, "ask the policy of run"));
  ETUDE_ASSIGN_OR_RETURN(auto directory, bus::Directory::Open(participant));
  return Client(
      std::unique_ptr<Impl>(new Impl{&participant, std::move(selector), session, options, std::move(directory)}));
}

Result<Answer> Client::Ask(const Question& question) {
  Impl& impl = *impl_;
  bus::Observation observation = ObservationOf(question);
  observation.run = impl.run.name;
  observation.session = impl.session;
  observation.host = impl.participant->address();

  std::string last = "no answer; is `etude policy` running for this run and domain?";
  Stopwatch elapsed;
  const double patience = std::chrono::duration<double>(impl.options.patience).count();
  const std::uint64_t first = impl.request_id + 1;
  while (!StopRequested() && elapsed.Seconds() < patience) {
    if (!impl.connection) {
      ETUDE_RETURN_IF_ERROR(impl.Connect(impl.options.answer));
      continue;
    }
    observation.run_id = impl.connection->server.id;
    observation.server = impl.connection->server.instance;
    observation.request_id = ++impl.request_id;
    if (const Status asked = impl.connection->observations.Write(observation); !asked) last = asked.error().message;
    const auto action = impl.Await(first, impl.options.answer);
    if (!action) {
      if (impl.ServerHasGone()) impl.connection.reset();
      continue;
    }
    if (action->error.empty()) return AnswerOf(*action);
    if (action->refusal == bus::Refusal::kDoesNotFit)
      return Fail(Code::kInvalidArgument,
                  fmt::format("ask the policy of run '{}': {}", impl.run.text(), action->error));
    if (action->refusal == bus::Refusal::kFailed)
      return Fail(Code::kCorrupt, fmt::format("ask the policy of run '{}': {}", impl.run.text(), action->error));
    // e.g. no checkpoint yet: ask again later
    last = action->error;
    WaitForStop(kAskAgainAfterRefusal);
  }
  if (StopRequested()) return Fail(Code::kTimeout, "ask the policy: this process was asked to stop");
  return Fail(Code::kUnavailable, fmt::format("ask the policy of run '{}': {}", impl.run.text(), last));
}

}  // namespace etude::policy
