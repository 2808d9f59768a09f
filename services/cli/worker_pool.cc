// SPDX-License-Identifier: Apache-2.0
#include "services/cli/worker_pool.h"

#include <fmt/format.h>
#include <signal.h>

#include <algorithm>
#include <deque>
#include <fstream>
#include <thread>
#include <utility>

#include "services/bus/participant.h"
#include "services/core/command.h"
#include "services/core/cores.h"
#include "services/core/log.h"

namespace etude::cli {
namespace {

using namespace std::chrono_literals;

constexpr auto kPatience = 8s;       // of Stop, until SIGKILL
constexpr auto kHealthyAfter = 20s;  // a life this long resets the back-off
constexpr auto kAtOnce = 10s;        // exit code 3 before this: the machine cannot

MonotonicClock::duration BackOff(int deaths) {
  return std::min<MonotonicClock::duration>(10s, 250ms * (1 << std::min(deaths, 6)));
}

}  // namespace

int DefaultWorkers() { return std::min(Cores(), kMostWorkers); }

std::string LogTail(const Path& log, int lines) {
  std::ifstream file(log);
  std::deque<std::string> tail;
  for (std::string line; std::getline(file, line);) {
    tail.push_back(line);
    if (static_cast<int>(tail.size()) > lines) tail.pop_front();
  }
  std::string text;
  for (const auto& line : tail) text += "\n    " + line;
  return text;
}

Result<WorkerPool> WorkerPool::Start(const WorkerPoolOptions& options) {
  WorkerPool pool(options);
  pool.program_ = options.program;
  if (pool.program_.empty()) {
    ETUDE_ASSIGN_OR_RETURN(pool.program_, campaign::FindSibling("etude-worker"));
  }
  pool.done_ = options.done ? options.done() : 0;
  pool.slots_.resize(static_cast<std::size_t>(options.workers));
  for (std::size_t k = 0; k < pool.slots_.size(); ++k) ETUDE_RETURN_IF_ERROR(pool.StartSlot(k));
  return pool;
}

Status WorkerPool::StartSlot(std::size_t k) {
  Slot& slot = slots_[k];
  slot.name = fmt::format("{}-w{}", bus::UniquePeerName(), k);
  campaign::ProcessOptions process;
  process.argv = {program_.string(), "--campaign", options_.campaign, "--name", slot.name, "--slots", "0"};
  const auto flags = options_.bus.Flags(security::Role::kWorker);
  process.argv.insert(process.argv.end(), flags.begin(), flags.end());
  process.environment = options_.bus.Environment();
  process.log = LogOf(k);
  ETUDE_ASSIGN_OR_RETURN(auto started, campaign::Process::Start(process));
  slot.process.emplace(std::move(started));
  slot.started = MonotonicClock::now();
  return {};
}

Path WorkerPool::LogOf(std::size_t k) const { return options_.logs / fmt::format("worker-{}.log", k); }

// One more death, of whichever worker.
bool WorkerPool::IsHopeless() {
  const std::uint64_t done = options_.done ? options_.done() : 0;
  deaths_ = done == done_ ? deaths_ + 1 : 1;
  done_ = done;
  return deaths_ >= campaign::HopelessDeaths(options_.workers);
}

Status WorkerPool::OnEnd(std::size_t k, int exit_code) {
  Slot& slot = slots_[k];
  const auto now = MonotonicClock::now();
  const auto life = now - slot.started;
  slot.process.reset();
  if (options_.on_end) options_.on_end(slot.name, exit_code);
  const auto start_again = [&](MonotonicClock::duration at_least) {
    slot.deaths = life > kHealthyAfter ? 1 : slot.deaths + 1;
    slot.start_again = now + std::max(at_least, BackOff(slot.deaths));
  };
  if (exit_code == kExitOk) {
    // Somebody told it to end, or the campaign's end and this look at it crossed: then it is not called again. No
    // failure, but one that ends again and again is given more and more time.
    start_again(1s);
    return {};
  }
  if (exit_code == kExitMachine && life < kAtOnce) {
    // it may be what passes: others' processes take all that the machine has of something
    if (!std::exchange(slot.unable, true))
      Log().warn("worker={} cannot run here now: {}", slot.name, LogTail(LogOf(k)));
    start_again(kAtOnce);
    return {};
  }
  slot.unable = false;
  if (IsHopeless())
    return Fail(Code::kUnavailable,
                fmt::format("workers died {} times without one attempt finished meanwhile; the last one ended by {} "
                            "after {:.1f} s. Its last words, from {}:{}",
                            deaths_, campaign::HowItEnded(exit_code), std::chrono::duration<double>(life).count(),
                            LogOf(k).string(), LogTail(LogOf(k))));
  start_again(0s);
  Log().warn("worker={} ended by {}", slot.name, campaign::HowItEnded(exit_code));
  return {};
}

// No memory, no process, no descriptor: it may pass, as what a worker itself meets may (OnEnd).
Status WorkerPool::StartAgain(std::size_t k) {
  const Status started = StartSlot(k);
  if (started) return {};
  if (started.error().code != Code::kUnavailable) return started;
  if (IsHopeless())
    return Fail(started.error().Wrap(
        fmt::format("workers died or could not be started {} times without one attempt finished meanwhile", deaths_)));
  Log().warn("worker={} cannot be started now: {}", slots_[k].name, started.error().message);
  slots_[k].start_again = MonotonicClock::now() + kAtOnce;
  return {};
}

// SIGKILL: who does not move, or is stopped, does not answer to less.
void WorkerPool::EndSilent() {
  if (!options_.silent) return;
  for (const std::string& name : options_.silent()) {
    const auto slot = std::ranges::find(slots_, name, &Slot::name);
    if (slot == slots_.end() || !slot->process) continue;
    Log().warn("worker={} did not move: what it held is leased to others, and it is ended", name);
    slot->process->Signal(SIGKILL);
  }
}

Status WorkerPool::Supervise() {
  EndSilent();
  for (std::size_t k = 0; k < slots_.size(); ++k) {
    Slot& slot = slots_[k];
    if (slot.finished) continue;
    if (slot.process) {
      if (MonotonicClock::now() - slot.started > kAtOnce) slot.unable = false;
      if (const auto exit_code = slot.process->Poll()) ETUDE_RETURN_IF_ERROR(OnEnd(k, *exit_code));
    } else if (MonotonicClock::now() >= slot.start_again) {
      ++restarts_;
      Log().info("worker={} is started again", slot.name);
      ETUDE_RETURN_IF_ERROR(StartAgain(k));
    }
  }
  const bool unable = std::all_of(slots_.begin(), slots_.end(), [](const Slot& slot) { return slot.unable; });
  if (slots_.empty() || !unable) return {};
  const Path log = LogOf(0);
  return Fail(Code::kUnavailable, fmt::format("no worker can run on this machine; try `etude doctor`. From {}:{}",
                                              log.string(), LogTail(log)));
}

void WorkerPool::NoteEnds() {
  for (auto& slot : slots_) {
    const auto exit_code = slot.process ? slot.process->Poll() : std::nullopt;
    if (!exit_code) continue;
    slot.process.reset();
    slot.finished = true;
    if (options_.on_end) options_.on_end(slot.name, *exit_code);
  }
}

void WorkerPool::Stop() {
  for (auto& slot : slots_)
    if (slot.process) slot.process->Terminate();
  const auto deadline = MonotonicClock::now() + kPatience;
  for (auto& slot : slots_) {
    if (!slot.process) continue;
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(deadline - MonotonicClock::now());
    slot.process->Stop(std::max(left, 0ms));
    slot.process.reset();
    slot.finished = true;
  }
}

}  // namespace etude::cli
