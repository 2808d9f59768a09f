// SPDX-License-Identifier: Apache-2.0
#include "worker/policy_client.h"

#include <fmt/format.h>

#include <cmath>
#include <optional>

#include "services/bus/topic.h"
#include "services/core/clock.h"
#include "services/core/stop.h"

namespace etude {
namespace {

Result<task::PolicyAnswer> AnswerOf(const bus::Action& action) {
  constexpr std::size_t kSize = static_cast<std::size_t>(kWaypoints) * kWaypointSize;
  if (action.waypoints.size() != kSize)
    return Fail(Code::kCorrupt, fmt::format("policy '{}' answered {} numbers instead of {}", action.run,
                                            action.waypoints.size(), kSize));
  for (const float value : action.waypoints)
    if (!std::isfinite(value))
      return Fail(Code::kCorrupt, fmt::format("policy '{}' answered a number that is not finite", action.run));
  task::PolicyAnswer answer;
  for (int k = 0; k < kWaypoints; ++k)
    answer.waypoints.push_back(FromVector(action.waypoints.data() + k * kWaypointSize));
  answer.modules = OrderedJson::parse(action.modules_json, nullptr, false);
  if (answer.modules.is_discarded()) answer.modules = OrderedJson::object();
  answer.checkpoint_step = action.checkpoint_step;
  return answer;
}

}  // namespace

struct PolicyClient::Impl {
  std::string run, session;
  PolicyClientOptions options;
  bus::Writer<bus::Observation> observations;
  bus::Reader<bus::Action> actions;
  std::uint64_t request_id = 0;

  // the answer to the last observation, or nothing within `timeout`
  std::optional<bus::Action> Await(std::chrono::nanoseconds timeout) {
    const auto deadline = MonotonicClock::now() + timeout;
    while (!StopRequested() && MonotonicClock::now() < deadline) {
      if (!actions.Wait(deadline - MonotonicClock::now())) break;
      for (auto& action : actions.Take())
        if (action.session == session && action.request_id == request_id) return std::move(action);
    }
    return std::nullopt;
  }
};

PolicyClient::PolicyClient(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
PolicyClient::PolicyClient(PolicyClient&&) noexcept = default;
PolicyClient& PolicyClient::operator=(PolicyClient&&) noexcept = default;
PolicyClient::~PolicyClient() = default;

Result<PolicyClient> PolicyClient::Open(const bus::Participant& participant, const std::string& run,
                                        const std::string& session, const PolicyClientOptions& options) {
  ETUDE_ASSIGN_OR_RETURN(auto observations, bus::Writer<bus::Observation>::Open(participant, run));
  ETUDE_ASSIGN_OR_RETURN(auto actions, bus::Reader<bus::Action>::Open(participant, run));
  return PolicyClient(
      std::unique_ptr<Impl>(new Impl{run, session, options, std::move(observations), std::move(actions)}));
}

Result<task::PolicyAnswer> PolicyClient::Ask(const task::PolicyQuestion& question) {
  Impl& impl = *impl_;
  bus::Observation observation;
  observation.run = impl.run;
  observation.session = impl.session;
  observation.instruction = question.instruction;
  observation.joints = question.joints;
  observation.width = static_cast<std::uint32_t>(question.width);
  observation.height = static_cast<std::uint32_t>(question.height);
  observation.image.assign(question.rgb.begin(), question.rgb.end());

  std::string last = "no answer; is `etude policy` running for this run and domain?";
  Stopwatch elapsed;
  const double patience = std::chrono::duration<double>(impl.options.patience).count();
  while (!StopRequested() && elapsed.Seconds() < patience) {
    observation.request_id = ++impl.request_id;
    if (const Status asked = impl.observations.Write(observation); !asked) last = asked.error().message;
    const auto action = impl.Await(impl.options.answer);
    if (!action) continue;
    if (action->error.empty()) return AnswerOf(*action);
    // e.g. no checkpoint yet: ask again later
    last = action->error;
    WaitForStop(std::chrono::milliseconds(500));
  }
  if (StopRequested()) return Fail(Code::kTimeout, "ask the policy: this process was asked to stop");
  return Fail(Code::kUnavailable, fmt::format("ask the policy of run '{}': {}", impl.run, last));
}

}  // namespace etude
