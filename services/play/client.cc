// SPDX-License-Identifier: Apache-2.0
#include "services/play/client.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <utility>
#include <vector>

#include "services/bus/topic.h"
#include "services/core/identity.h"
#include "services/core/stop.h"

namespace etude::play {
namespace {

using namespace std::chrono_literals;

constexpr auto kSayAgain = 500ms;
constexpr std::size_t kLongestName = 64;

const std::vector<std::pair<std::string, bus::PlayAction>>& Actions() {
  using bus::PlayAction;
  static const std::vector<std::pair<std::string, PlayAction>> actions{
      {"scene", PlayAction::kScene}, {"say", PlayAction::kSay},    {"stop", PlayAction::kStop},
      {"nudge", PlayAction::kNudge}, {"hide", PlayAction::kHide},  {"show", PlayAction::kShow},
      {"reset", PlayAction::kReset}, {"close", PlayAction::kClose}};
  return actions;
}

}  // namespace

struct Client::Impl {
  bus::Reader<bus::PlayState> states;
  bus::Writer<bus::PlayCommand> commands;
  std::map<std::string, HeardState> sessions = {};

  void Take(std::chrono::nanoseconds timeout) {
    if (timeout > 0ns) states.Wait(timeout);
    for (auto& state : states.Take()) {
      const std::string name = state.session;
      sessions[name] = {std::move(state), MonotonicClock::now()};
    }
    std::erase_if(sessions, [](const auto& item) {
      return MonotonicClock::now() - item.second.heard > kSilent || item.second.state.phase == "ended";
    });
  }
};

Client::Client(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Client::Client(Client&&) noexcept = default;
Client& Client::operator=(Client&&) noexcept = default;
Client::~Client() = default;

Result<Client> Client::Open(const bus::Participant& participant) {
  ETUDE_ASSIGN_OR_RETURN(auto states, bus::Reader<bus::PlayState>::Open(participant, bus::kPlayPartition));
  ETUDE_ASSIGN_OR_RETURN(auto commands, bus::Writer<bus::PlayCommand>::Open(participant, bus::kPlayPartition));
  return Client(std::unique_ptr<Impl>(new Impl{std::move(states), std::move(commands)}));
}

const std::map<std::string, HeardState>& Client::Listen(std::chrono::nanoseconds timeout) {
  impl_->Take(timeout);
  return impl_->sessions;
}

Result<bus::PlayState> Client::Find(const std::string& session, std::chrono::nanoseconds timeout) {
  const auto deadline = MonotonicClock::now() + timeout;
  while (true) {
    impl_->Take(0ns);
    const auto found = impl_->sessions.find(session);
    if (found != impl_->sessions.end()) return found->second.state;
    const auto left = deadline - MonotonicClock::now();
    if (StopRequested()) return Fail(Code::kTimeout, "stopped");
    if (left <= 0ns)
      return Fail(Code::kNotFound, fmt::format("no play session '{:.64}' is live: `etude play list` shows those that "
                                               "are, `etude play open` opens one",
                                               session));
    impl_->states.Wait(std::min<std::chrono::nanoseconds>(left, kSayAgain));
  }
}

Result<bus::PlayState> Client::Command(const std::string& session, bus::PlayAction action, const OrderedJson& arguments,
                                       std::chrono::nanoseconds timeout) {
  const auto deadline = MonotonicClock::now() + timeout;
  bus::PlayCommand command;
  command.session = session;
  command.command_id = NewId();
  command.action = action;
  command.arguments_json = JsonText(arguments);
  command.host = HostName();
  command.user = UserName();
  impl_->commands.WaitForReaders(1, std::min<std::chrono::nanoseconds>(timeout, 5s));
  // once in any case: who was asked to stop says so to the session, too
  ETUDE_RETURN_IF_ERROR(impl_->commands.Write(command));
  MonotonicClock::time_point again = MonotonicClock::now() + kSayAgain;
  while (MonotonicClock::now() < deadline && !StopRequested()) {
    if (MonotonicClock::now() >= again) {
      ETUDE_RETURN_IF_ERROR(impl_->commands.Write(command));
      again = MonotonicClock::now() + kSayAgain;
    }
    impl_->states.Wait(std::min<std::chrono::nanoseconds>(again - MonotonicClock::now(), kSayAgain));
    for (auto& state : impl_->states.Take()) {
      const bool ours = state.session == session && state.command_id == command.command_id;
      const std::string name = state.session;
      impl_->sessions[name] = {state, MonotonicClock::now()};
      if (!ours) continue;
      if (!state.refusal.empty()) return Fail(Code::kInvalidArgument, state.refusal);
      return std::move(state);
    }
  }
  return Fail(Code::kUnavailable, fmt::format("play session '{:.64}' does not answer", session));
}

struct Frames::Impl {
  bus::Reader<bus::PlayFrame> reader;
};

Frames::Frames(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Frames::Frames(Frames&&) noexcept = default;
Frames& Frames::operator=(Frames&&) noexcept = default;
Frames::~Frames() = default;

Result<Frames> Frames::Open(const bus::Participant& participant, const std::string& session) {
  if (!IsSessionName(session))
    return Fail(Code::kInvalidArgument, fmt::format("'{:.64}' is not the name of a play session", session));
  ETUDE_ASSIGN_OR_RETURN(auto reader, bus::Reader<bus::PlayFrame>::Open(participant, FramePartition(session)));
  return Frames(std::unique_ptr<Impl>(new Impl{std::move(reader)}));
}

std::optional<bus::PlayFrame> Frames::Take(std::chrono::nanoseconds timeout) {
  if (timeout > 0ns) impl_->reader.Wait(timeout);
  auto frames = impl_->reader.Take();
  if (frames.empty()) return std::nullopt;
  return std::move(frames.back());
}

bool IsSessionName(const std::string& name) {
  return !name.empty() && name.size() <= kLongestName &&
         std::ranges::all_of(name, [](unsigned char c) { return std::isalnum(c) || c == '_' || c == '-'; });
}

std::string FramePartition(const std::string& session) { return std::string(bus::kPlayPartition) + "/" + session; }

std::string PolicySession(const std::string& session) { return "play-" + session; }

Result<bus::PlayAction> ActionOf(const std::string& name) {
  std::vector<std::string> names;
  for (const auto& [known, action] : Actions()) {
    if (known == name) return action;
    names.push_back(known);
  }
  return Fail(Code::kInvalidArgument, "action: " + NotKnown(name.substr(0, 40), names));
}

}  // namespace etude::play
