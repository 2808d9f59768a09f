// SPDX-License-Identifier: Apache-2.0
#include "trainer/serve/insight.h"

#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "services/core/log.h"

namespace etude::serve {
namespace {

using namespace std::chrono_literals;

constexpr std::size_t kMostViewers = 16;
constexpr std::uint32_t kLongest = 60;  // s that one wish stands
constexpr int kNice = 10;
constexpr auto kLook = 50ms;  // how often wishes are looked for

bool IsFor(const bus::InsightWish& wish, const std::string& session) {
  return wish.session.empty() || wish.session == session;
}

}  // namespace

Result<std::unique_ptr<InsightDesk>> InsightDesk::Open(const bus::Participant& participant,
                                                       const std::string& partition, const std::string& run_id) {
  ETUDE_ASSIGN_OR_RETURN(auto wishes, bus::Reader<bus::InsightWish>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto insights, bus::Writer<bus::Insight>::Open(participant, partition));
  return std::unique_ptr<InsightDesk>(new InsightDesk(std::move(wishes), std::move(insights), run_id));
}

InsightDesk::InsightDesk(bus::Reader<bus::InsightWish> wishes, bus::Writer<bus::Insight> insights, std::string run_id)
    : reader_(std::move(wishes)),
      writer_(std::move(insights)),
      run_id_(std::move(run_id)),
      thread_([this] { Work(); }) {}

InsightDesk::~InsightDesk() {
  stop_ = true;
  offered_.NotifyAll();
  thread_.join();
}

void InsightDesk::Offer(const bus::Observation& observation, const std::shared_ptr<const Model>& model) {
  if (!wanted_) return;
  const MutexLock lock(mutex_);
  const bool wished =
      std::ranges::any_of(wishes_, [&](const auto& item) { return IsFor(item.second.text, observation.session); });
  if (!wished) return;
  pending_[observation.session] = {observation, model};
  offered_.NotifyOne();
}

bool InsightDesk::IsLookers(const std::string& session) {
  TakeWishes();  // his wish came just before his question
  const MutexLock lock(mutex_);
  const auto wish = wishes_.find(session);
  return wish != wishes_.end() && wish->second.text.session == session;
}

void InsightDesk::TakeWishes() {
  const auto now = MonotonicClock::now();
  const MutexLock lock(mutex_);
  for (const auto& wish : reader_.Take()) {
    if (wish.run_id != run_id_ || (!wishes_.contains(wish.viewer) && wishes_.size() >= kMostViewers)) continue;
    Wish& own = wishes_[wish.viewer];
    own.text = wish;
    own.until = now + std::chrono::seconds(std::min(wish.seconds, kLongest));
  }
  std::erase_if(wishes_, [&](const auto& item) { return item.second.until <= now; });
  wanted_ = !wishes_.empty();
  if (!wanted_) pending_.clear();
}

void InsightDesk::Show(const Offered& offered) {
  std::vector<bus::InsightWish> due;
  {
    const MutexLock lock(mutex_);
    const auto now = MonotonicClock::now();
    for (auto& [viewer, wish] : wishes_) {
      if (!IsFor(wish.text, offered.observation.session)) continue;
      // a session that may be shown again is as good as one that never was
      std::erase_if(wish.next, [&](const auto& item) { return item.second <= now; });
      if (!wish.next.emplace(offered.observation.session, now + 1000ms / kPerSecond).second) continue;
      due.push_back(wish.text);
    }
  }
  for (const auto& wish : due) {
    if (stop_) return;  // whoever ends this answers no robot meanwhile
    bus::Insight insight = offered.model->Inspect(offered.observation, wish.what_if_json);
    insight.viewer = wish.viewer;
    if (const Status written = writer_.Write(insight); !written)
      Log().debug("insight for '{}': {}", wish.viewer, written.error().message);
    else
      ++shown_;
  }
}

void InsightDesk::Work() {
  ::setpriority(PRIO_PROCESS, static_cast<id_t>(::syscall(SYS_gettid)), kNice);
  while (!stop_) {
    TakeWishes();
    std::map<std::string, Offered> pending;
    {
      const MutexLock lock(mutex_);
      if (pending_.empty() && !stop_) offered_.WaitFor(mutex_, kLook);
      pending.swap(pending_);
    }
    for (const auto& [session, offered] : pending) {
      if (stop_) break;
      Show(offered);
    }
  }
}

}  // namespace etude::serve
