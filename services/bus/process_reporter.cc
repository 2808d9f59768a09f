// SPDX-License-Identifier: Apache-2.0
#include "services/bus/process_reporter.h"

#include <fmt/format.h>
#include <unistd.h>

#include <condition_variable>
#include <deque>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <stop_token>
#include <thread>
#include <utility>

#include "services/bus/participant_state.h"
#include "services/bus/topic.h"
#include "services/bus/topology.h"
#include "services/core/clock.h"
#include "services/core/command.h"
#include "services/core/identity.h"
#include "services/core/log.h"
#include "services/core/process_facts.h"

namespace etude::bus {
namespace {

constexpr std::size_t kMostWaiting = 64;  // events that were not published yet
constexpr std::size_t kLongestText = 1000;

std::string TopicsJson(Participant::State& state) {
  std::vector<std::pair<std::pair<std::string, bool>, std::shared_ptr<Traffic>>> all;
  {
    const MutexLock lock(state.mutex);
    all.assign(state.traffic.begin(), state.traffic.end());
  }
  nlohmann::ordered_json topics = nlohmann::ordered_json::array();
  for (const auto& [key, traffic] : all)
    topics.push_back({{"topic", key.first},
                      {"kind", key.second ? "writer" : "reader"},
                      {"samples", traffic->samples.load()},
                      {"bytes", traffic->bytes.load()},
                      {"matched", traffic->Matched(key.second)}});
  return topics.dump();
}

// NUL bytes do not fit the wire.
std::string Plain(std::string text) {
  if (text.size() > kLongestText) text.resize(kLongestText);
  std::erase(text, '\0');
  return text;
}

}  // namespace

struct ProcessReporter::Impl {
  std::shared_ptr<Participant::State> state;
  std::chrono::milliseconds every;
  Writer<ProcessStatus> statuses;
  Writer<ProcessEvent> events;
  ProcessStatus status;
  ProcessMeter meter;

  std::mutex mutex;
  std::condition_variable_any wake;
  std::deque<LogRecord> waiting;  // guarded by mutex
  std::uint64_t number = 0;       // of the last event, guarded by mutex
  std::optional<LogListener> listener;
  std::jthread thread;  // last: it uses all of the above

  void Hear(const LogRecord& record) {
    const std::scoped_lock lock(mutex);
    if (waiting.size() >= kMostWaiting) {
      waiting.pop_front();
      ++number;  // a gap in the numbers is what was dropped
    }
    waiting.push_back(record);
    wake.notify_one();
  }
  void Work(const std::stop_token& stop);
  void PublishEvents(std::deque<LogRecord> records, std::uint64_t first);
  void PublishStatus();
};

void ProcessReporter::Impl::PublishStatus() {
  const ProcessFacts facts = meter.Measure();
  status.rss_bytes = facts.rss_bytes;
  status.cpu = facts.cpu;
  status.disk_free_bytes = facts.disk_free_bytes;
  status.disk_total_bytes = facts.disk_total_bytes;
  status.topics_json = TopicsJson(*state);
  // not above debug: what is logged here would be published next
  if (const Status written = statuses.Write(status); !written)
    Log().debug("cannot say how this process is: {}", written.error().message);
}

void ProcessReporter::Impl::PublishEvents(std::deque<LogRecord> records, std::uint64_t first) {
  for (auto& record : records) {
    ProcessEvent event;
    event.process = status.process;
    event.role = status.role;
    event.host = status.host;
    event.number = first++;
    event.time_ms = record.time_ms;
    event.level = record.level;
    event.code = record.code;
    event.text = Plain(std::move(record.text));
    if (const Status written = events.Write(event); !written)
      Log().debug("cannot publish an event: {}", written.error().message);
  }
}

void ProcessReporter::Impl::Work(const std::stop_token& stop) {
  auto next = MonotonicClock::now();
  std::unique_lock lock(mutex);
  while (true) {
    wake.wait_until(lock, stop, next, [this] { return !waiting.empty(); });
    auto records = std::exchange(waiting, {});
    const std::uint64_t first = number + 1;
    number += records.size();
    const bool ends = stop.stop_requested();
    const bool due = MonotonicClock::now() >= next;
    lock.unlock();
    PublishEvents(std::move(records), first);
    if (due && !ends) {
      PublishStatus();
      next = MonotonicClock::now() + every;
    }
    lock.lock();
    if (ends && waiting.empty()) return;
  }
}

ProcessReporter::ProcessReporter(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

ProcessReporter::~ProcessReporter() {
  impl_->listener.reset();
  impl_->thread.request_stop();
  impl_->thread.join();
  (void)impl_->statuses.Dispose(impl_->status);
}

const std::string& ProcessReporter::process() const { return impl_->status.process; }

Result<std::unique_ptr<ProcessReporter>> ProcessReporter::Start(const Participant& participant,
                                                                const ReporterOptions& options) {
  ETUDE_ASSIGN_OR_RETURN(auto statuses, Writer<ProcessStatus>::Open(participant, kProcessPartition));
  ETUDE_ASSIGN_OR_RETURN(auto events, Writer<ProcessEvent>::Open(participant, kProcessPartition));
  ProcessStatus status;
  status.process = UniquePeerName();
  status.role = options.role;
  status.host = HostName();
  status.pid = static_cast<std::uint32_t>(::getpid());
  status.version = Version();
  status.since = static_cast<std::uint64_t>(WallSeconds());
  if (!options.folder.empty()) status.folder = std::filesystem::absolute(options.folder).lexically_normal().string();
  status.participant = ParticipantId(participant);
  std::unique_ptr<Impl> impl(new Impl{.state = participant.state(),
                                      .every = options.every,
                                      .statuses = std::move(statuses),
                                      .events = std::move(events),
                                      .status = std::move(status),
                                      .meter = ProcessMeter(options.folder)});
  Impl* const self = impl.get();
  impl->listener.emplace([self](const LogRecord& record) { self->Hear(record); });
  impl->thread = std::jthread([self](const std::stop_token& stop) { self->Work(stop); });
  return std::unique_ptr<ProcessReporter>(new ProcessReporter(std::move(impl)));
}

}  // namespace etude::bus
