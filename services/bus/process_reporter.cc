// SPDX-License-Identifier: Apache-2.0
#include "services/bus/process_reporter.h"

#include <fmt/format.h>
#include <unistd.h>

#include <atomic>
#include <deque>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>
#include <utility>

#include "services/bus/access.h"
#include "services/bus/participant_state.h"
#include "services/bus/topic.h"
#include "services/bus/topology.h"
#include "services/core/clock.h"
#include "services/core/command.h"
#include "services/core/identity.h"
#include "services/core/log.h"
#include "services/core/process_facts.h"
#include "services/core/thread_annotations.h"

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

  Mutex mutex;
  ConditionVariable wake;
  std::deque<LogRecord> waiting ETUDE_GUARDED_BY(mutex);
  std::uint64_t number ETUDE_GUARDED_BY(mutex) = 0;  // of the last event
  bool ending ETUDE_GUARDED_BY(mutex) = false;
  std::optional<LogListener> listener;
  std::thread thread;  // last: it uses all of the above

  std::atomic<std::thread::id> publisher = {};

  void Hear(const LogRecord& record) ETUDE_EXCLUDES(mutex) {
    // what publishing logs, a library of a link that is down at every datagram, would be published next
    if (std::this_thread::get_id() == publisher.load()) return;
    const MutexLock lock(mutex);
    if (waiting.size() >= kMostWaiting) {
      waiting.pop_front();
      ++number;  // a gap in the numbers is what was dropped
    }
    waiting.push_back(record);
    wake.NotifyOne();
  }
  // What is to be published now.
  struct News {
    std::deque<LogRecord> records;
    std::uint64_t first = 0;  // number of the first of them
    bool ends = false;
  };
  News AwaitNews(MonotonicClock::time_point due) ETUDE_EXCLUDES(mutex);
  void Work();
  void End() ETUDE_EXCLUDES(mutex);
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

// Until something is logged, the process ends, or the status is due.
ProcessReporter::Impl::News ProcessReporter::Impl::AwaitNews(MonotonicClock::time_point due) {
  const MutexLock lock(mutex);
  while (waiting.empty() && !ending && MonotonicClock::now() < due) wake.WaitFor(mutex, due - MonotonicClock::now());
  News news{std::exchange(waiting, {}), number + 1, ending};
  number += news.records.size();
  return news;
}

// What was logged before the end is published first.
void ProcessReporter::Impl::Work() {
  publisher = std::this_thread::get_id();
  auto due = MonotonicClock::now();
  while (true) {
    News news = AwaitNews(due);
    if (news.ends && news.records.empty()) return;
    PublishEvents(std::move(news.records), news.first);
    if (news.ends || MonotonicClock::now() < due) continue;
    PublishStatus();
    due = MonotonicClock::now() + every;
  }
}

void ProcessReporter::Impl::End() {
  listener.reset();
  {
    const MutexLock lock(mutex);
    ending = true;
  }
  wake.NotifyOne();
  thread.join();
}

ProcessReporter::ProcessReporter(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

ProcessReporter::~ProcessReporter() {
  impl_->End();
  (void)impl_->statuses.Dispose(impl_->status);
}

const std::string& ProcessReporter::process() const { return impl_->status.process; }

Result<std::unique_ptr<ProcessReporter>> ProcessReporter::Start(const Participant& participant,
                                                                const ReporterOptions& options) {
  ETUDE_ASSIGN_OR_RETURN(auto statuses, Writer<ProcessStatus>::Open(participant, kDirectoryPartition));
  ETUDE_ASSIGN_OR_RETURN(auto events, Writer<ProcessEvent>::Open(participant, kDirectoryPartition));
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
  impl->thread = std::thread([self] { self->Work(); });
  return std::unique_ptr<ProcessReporter>(new ProcessReporter(std::move(impl)));
}

}  // namespace etude::bus
