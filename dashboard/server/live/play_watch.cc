// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/live/play_watch.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "services/core/log.h"

namespace etude::live {
namespace {

using namespace std::chrono_literals;

constexpr auto kListen = 30ms;
constexpr auto kForgotten = 10s;  // pictures and insights that nobody asks for
// together within what a request may take
constexpr auto kTurn = 1500ms;  // for the session to answer the command before
constexpr auto kAnswer = 8s;
constexpr auto kLookAgain = 10ms;

}  // namespace

PlayWatch::~PlayWatch() {
  thread_.request_stop();
  if (thread_.joinable()) thread_.join();
}

Status PlayWatch::Start() {
  MutexLock lock(start_mutex_);
  if (participant_) return {};
  ETUDE_ASSIGN_OR_RETURN(auto participant, arguments_.Open());
  ETUDE_ASSIGN_OR_RETURN(auto client, play::Client::Open(participant));
  participant_.emplace(std::move(participant));
  {
    MutexLock reading(mutex_);
    reading_ = &*participant_;
  }
  thread_ = std::jthread(
      [this, heard = std::move(client)](std::stop_token stop) mutable { Run(std::move(stop), std::move(heard)); });
  return {};
}

void PlayWatch::Run(std::stop_token stop, play::Client client) {
  while (!stop.stop_requested()) {
    const auto& sessions = client.Listen(kListen);
    MutexLock lock(mutex_);
    sessions_ = sessions;
    std::erase_if(commanders_, [this](const auto& item) { return !sessions_.contains(item.first); });
    TakeFrames();
    TakeInsights();
  }
}

void PlayWatch::TakeFrames() {
  std::erase_if(watched_, [this](const auto& item) {
    return !sessions_.contains(item.first) || MonotonicClock::now() - item.second.asked > kForgotten;
  });
  for (auto& [name, watched] : watched_) {
    if (!watched.frames) {
      auto frames = play::Frames::Open(*reading_, name);
      if (!frames) {
        Log().warn("session={}: {}", name, frames.error().message);
        continue;
      }
      watched.frames.emplace(std::move(*frames));
    }
    if (auto frame = watched.frames->Take(0ns)) watched.newest = std::move(*frame);
  }
}

void PlayWatch::TakeInsights() {
  for (auto& [name, watched] : watched_) {
    if (MonotonicClock::now() - watched.asked_into <= kForgotten) {
      TakeInsight(name, watched);
      continue;
    }
    watched.viewer.reset();
    watched.insight = {};
  }
}

void PlayWatch::TakeInsight(const std::string& name, Watched& watched) {
  if (!watched.viewer) {
    auto viewer = policy::InsightViewer::Open(*reading_, sessions_.at(name).state.run, play::PolicySession(name));
    if (!viewer) {
      Log().warn("session={}: {}", name, viewer.error().message);
      watched.asked_into = {};  // until somebody asks again
      return;
    }
    watched.viewer.emplace(std::move(*viewer));
  }
  auto insight = watched.viewer->Take();
  if (!insight) return Log().debug("session={}: {}", name, insight.error().message);
  if (!*insight) return;
  watched.insight = {watched.insight.number + 1, std::move(**insight)};
}

Result<std::vector<PlayWatch::Session>> PlayWatch::Sessions() {
  ETUDE_RETURN_IF_ERROR(Start());
  std::vector<Session> all;
  MutexLock lock(mutex_);
  for (const auto& [name, heard] : sessions_) {
    const auto watched = watched_.find(name);
    const auto age = std::chrono::duration_cast<std::chrono::milliseconds>(MonotonicClock::now() - heard.heard);
    const bool pictured = watched != watched_.end() && watched->second.newest;
    all.push_back({heard.state, age.count(), pictured ? watched->second.newest->number : 0});
  }
  return all;
}

Result<PlayWatch::Session> PlayWatch::Look(const std::string& name) {
  {
    ETUDE_RETURN_IF_ERROR(Start());
    MutexLock lock(mutex_);
    if (sessions_.contains(name)) watched_[name].asked = MonotonicClock::now();
  }
  ETUDE_ASSIGN_OR_RETURN(auto all, Sessions());
  const auto found = std::ranges::find_if(all, [&](const Session& one) { return one.state.session == name; });
  if (found == all.end()) return Fail(Code::kNotFound, fmt::format("no play session '{:.64}' is live", name));
  return std::move(*found);
}

Result<bus::PlayFrame> PlayWatch::Frame(const std::string& name) {
  ETUDE_ASSIGN_OR_RETURN(const Session session, Look(name));
  MutexLock lock(mutex_);
  const auto watched = watched_.find(name);
  if (watched == watched_.end() || !watched->second.newest)
    return Fail(Code::kNotFound, fmt::format("play session '{}' has sent no picture yet", session.state.session));
  return *watched->second.newest;
}

Result<PlayWatch::Insight> PlayWatch::LookInto(const std::string& name) {
  ETUDE_ASSIGN_OR_RETURN(const Session session, Look(name));
  MutexLock lock(mutex_);
  const auto watched = watched_.find(session.state.session);
  if (watched == watched_.end()) return Insight{};
  watched->second.asked_into = MonotonicClock::now();
  return watched->second.insight;
}

Result<bus::PlayState> PlayWatch::Command(const std::string& name, bus::PlayAction action,
                                          const OrderedJson& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const Session session, Look(name));
  std::shared_ptr<Commander> commander;
  const bus::Participant* participant = nullptr;
  {
    MutexLock lock(mutex_);
    auto& slot = commanders_[session.state.session];
    if (!slot) slot = std::make_shared<Commander>();
    commander = slot;
    participant = reading_;
  }
  std::unique_lock turn(commander->mutex, std::try_to_lock);
  for (const auto end = Deadline(kTurn); !turn && MonotonicClock::now() < end; (void)turn.try_lock())
    std::this_thread::sleep_for(kLookAgain);
  if (!turn)
    return Fail(Code::kUnavailable, fmt::format("play session '{}' has not answered the command before this one yet; "
                                                "ask again in a moment",
                                                session.state.session));
  if (!commander->client) {
    ETUDE_ASSIGN_OR_RETURN(auto client, play::Client::Open(*participant));
    commander->client.emplace(std::move(client));
  }
  return commander->client->Command(session.state.session, action, arguments, kAnswer);
}

}  // namespace etude::live
