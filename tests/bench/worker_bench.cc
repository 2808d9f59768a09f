// SPDX-License-Identifier: Apache-2.0
// Measures the worker as a whole: what it costs beyond its parts, how two scale on two cores, and how many
// successful demonstrations they make a second. One JSON line each; calibration and rounds go to stderr.
#include <fmt/format.h>

#include <atomic>
#include <cstdlib>
#include <mutex>
#include <thread>

#include "services/bus/blob_transfer.h"
#include "services/campaign/collector.h"
#include "services/campaign/process.h"
#include "services/campaign/worker_client.h"
#include "services/core/check.h"
#include "services/core/clock.h"
#include "services/core/command.h"
#include "services/core/statistics.h"
#include "services/core/stop.h"
#include "services/episode/codec.h"
#include "tests/support/programs_folder.h"
#include "tests/support/temporary_folder.h"
#include "worker/task/attempt.h"

namespace etude {
namespace {

using namespace std::chrono_literals;

constexpr std::uint32_t kDomain = 84;

CampaignSpec Spec(const std::string& name) {
  CampaignSpec spec;  // three tasks mixed, 224 x 224, image stride 5
  spec.name = name;
  spec.episodes = 100'000;
  spec.seed = 5;
  return spec;
}

void Print(const char* name, double value, const char* unit, double baseline, double ratio) {
  fmt::print(
      "{}\n",
      OrderedJson{{"name", name}, {"value", value}, {"unit", unit}, {"baseline", baseline}, {"ratio", ratio}}.dump());
  std::fflush(stdout);
}

// ---- how fast is this machine, alone and with two at once -----------------------------------------

double SpinRate(int threads) {
  std::atomic<std::uint64_t> total{0};
  std::vector<std::thread> spinning;
  const auto end = MonotonicClock::now() + 1s;
  for (int k = 0; k < threads; ++k)
    spinning.emplace_back([&] {
      std::uint64_t count = 0, state = 1;
      while (MonotonicClock::now() < end)
        for (int i = 0; i < 10'000; ++i, ++count) state = state * 6364136223846793005u + count;
      total += count + (state == 0);
    });
  for (auto& thread : spinning) thread.join();
  return static_cast<double>(total.load());
}

// How much two raw loops do together, relative to one: 2.0 on two free cores.
double SpinScaling() {
  std::vector<double> ratios;
  for (int i = 0; i < 3; ++i) {
    const double one = SpinRate(1);
    ratios.push_back(SpinRate(2) / one);
  }
  return Quantile(ratios, 0.5);
}

// ---- a collector that notes what is committed when -------------------------------------------------

struct Commits {
  struct Entry {
    MonotonicClock::time_point time;
    double steps;
  };
  mutable std::mutex mutex;
  std::vector<Entry> entries;

  std::size_t count() const {
    const std::lock_guard lock(mutex);
    return entries.size();
  }
};

class NotingSink : public campaign::EpisodeSink {
 public:
  NotingSink(std::unique_ptr<campaign::EpisodeSink> inner, Commits& commits)
      : inner_(std::move(inner)), commits_(commits) {}
  const Path& folder() const override { return inner_->folder(); }
  const std::set<std::uint64_t>& committed() const override { return inner_->committed(); }
  std::vector<Status> CommitGroup(std::span<const store::ArrivedEpisode> group) override {
    auto statuses = inner_->CommitGroup(group);
    const std::lock_guard lock(commits_.mutex);
    for (const auto& arrived : group)
      commits_.entries.push_back({MonotonicClock::now(), static_cast<double>(arrived.view->episode.steps())});
    return statuses;
  }
  Status RecordFailure(std::uint64_t index, std::uint32_t attempt, const std::string& outcome,
                       const std::string& details_json) override {
    return inner_->RecordFailure(index, attempt, outcome, details_json);
  }
  Status WriteIndex() override { return {}; }
  Status WriteFilterKey(const std::string& name, const std::set<std::uint64_t>& indices) override {
    return inner_->WriteFilterKey(name, indices);
  }

 private:
  std::unique_ptr<campaign::EpisodeSink> inner_;
  Commits& commits_;
};

// A collector on a thread, committing to a temporary folder.
class Hosted {
 public:
  static std::unique_ptr<Hosted> Start(const bus::Participant& participant, const CampaignSpec& spec) {
    auto hosted = std::unique_ptr<Hosted>(new Hosted);
    auto sink = campaign::OpenDatasetSink(hosted->folder_ / "data", spec);
    ETUDE_CHECK(sink, "{}", sink.error().message);
    auto collector =
        campaign::Collector::Open(participant, spec, std::make_unique<NotingSink>(std::move(*sink), hosted->commits));
    ETUDE_CHECK(collector, "{}", collector.error().message);
    hosted->collector_.emplace(std::move(*collector));
    hosted->thread_ = std::thread([raw = hosted.get()] { (void)raw->collector_->Run(); });
    return hosted;
  }
  ~Hosted() {
    collector_->Stop();
    thread_.join();
  }
  Path folder() const { return folder_.path(); }
  Commits commits;

 private:
  TemporaryFolder folder_;
  std::optional<campaign::Collector> collector_;
  std::thread thread_;
};

// ---- worker_overhead --------------------------------------------------------------------------------

// The parts of the same episodes on their own: what the simulation says of its own, encoding, and sending to a
// receiver that acknowledges at once.
double PartsSeconds(const bus::Participant& participant, task::AttemptRunner& runner, std::uint64_t first,
                    std::uint64_t count) {
  auto receiver = bus::BlobReceiver::Open(participant, {"bench-parts", "1"}, "episode");
  auto sender = bus::BlobSender::Open(participant, {"bench-parts", "1"}, "episode", "bench");
  ETUDE_CHECK(receiver && sender);
  std::atomic<bool> stop{false};
  std::thread thread([&] {
    while (!stop)
      if (const auto object = receiver->Receive(5ms)) (void)receiver->Acknowledge(object->manifest, {});
  });
  static std::uint64_t id = 0;
  ETUDE_CHECK(sender->Send(++id, std::vector<std::uint8_t>(1000), 0, "{}", 10s));  // they have met
  double seconds = 0;
  for (std::uint64_t index = first; index < first + count; ++index) {
    for (std::uint32_t attempt = 0;; ++attempt) {
      const auto result = runner.Demonstrate(index, attempt).value();
      seconds += result.plan_s + result.step_s + result.render_s + result.deflate_s;
      if (result.outcome != task::AttemptOutcome::kSuccess) continue;
      Stopwatch watch;
      const auto bytes = EncodeEpisode(result.episode);
      ETUDE_CHECK(sender->Send(++id, bytes, 0, "{}", 10s));
      seconds += watch.Seconds();
      break;
    }
  }
  stop = true;
  thread.join();
  return seconds;
}

// The whole: lease, attempt, encode, send, durable, acknowledged.
double WholeSeconds(const bus::Participant& participant, const CampaignSpec& spec,
                    const std::shared_ptr<task::AttemptRunner>& runner, std::uint64_t first, std::uint64_t count) {
  CampaignSpec part = spec;
  part.episodes = first + count;
  auto hosted = Hosted::Start(participant, part);
  auto client = campaign::WorkerClient::Open(participant, {.campaign = spec.name});
  ETUDE_CHECK(client);
  std::optional<Stopwatch> since_first;
  double seconds = 0;
  const Status done = client->Run([&](const campaign::JoinedCampaign&) -> Result<campaign::WorkFunction> {
    return [&](const campaign::WorkItem& item) -> Result<campaign::WorkResult> {
      // indices before the first are only to get going: joining and discovery are not the worker's cost per episode
      if (item.index == first && !since_first) since_first.emplace();
      ETUDE_ASSIGN_OR_RETURN(const auto attempt, runner->Demonstrate(item.index, item.attempt, item.weights));
      campaign::WorkResult result;
      if (attempt.outcome == task::AttemptOutcome::kSuccess) {
        result.episode = EncodeEpisode(attempt.episode);
      } else {
        result.outcome = task::ToString(attempt.outcome);
      }
      return result;
    };
  });
  ETUDE_CHECK(done, "{}", done.error().message);
  // until the last commit, not until the campaign's end has been told
  const std::lock_guard lock(hosted->commits.mutex);
  ETUDE_CHECK(since_first && !hosted->commits.entries.empty(), "the bench was stopped");
  const auto last = hosted->commits.entries.back().time;
  seconds = since_first->Seconds() - std::chrono::duration<double>(MonotonicClock::now() - last).count();
  return seconds;
}

void BenchOverhead(const bus::Participant& participant) {
  const CampaignSpec spec = Spec("bench-overhead");
  auto opened = task::AttemptRunner::Open(spec);
  ETUDE_CHECK(opened, "{}", opened.error().message);
  auto runner = std::make_shared<task::AttemptRunner>(std::move(*opened));
  constexpr std::uint64_t kFirst = 1, kCount = 6;
  ETUDE_CHECK(runner->Demonstrate(0, 0));
  std::vector<double> wholes, parts, ratios;
  for (int round = 0; round < 5; ++round) {
    wholes.push_back(WholeSeconds(participant, spec, runner, kFirst, kCount));
    parts.push_back(PartsSeconds(participant, *runner, kFirst, kCount));
    ratios.push_back(wholes.back() / parts.back());
    fmt::print(stderr, "worker_overhead round {}: whole {:.3f} s, parts {:.3f} s, ratio {:.3f}\n", round, wholes.back(),
               parts.back(), ratios.back());
  }
  Print("worker_overhead", Quantile(wholes, 0.5) / kCount, "s/episode", Quantile(parts, 0.5) / kCount,
        Quantile(ratios, 0.5));
}

// ---- scaling and demos_per_second -------------------------------------------------------------------

struct Rate {
  double steps_per_second = 0;
  double demos_per_second = 0;
};

// Commits a second of `workers` processes once all are at work, over `window`.
Rate Measure(const bus::Participant& participant, int workers, std::chrono::seconds window) {
  const CampaignSpec spec = Spec("bench-scaling");
  auto hosted = Hosted::Start(participant, spec);
  const Path program = ProgramsFolder() / "etude-worker";
  std::vector<campaign::Process> processes;
  for (int k = 0; k < workers; ++k) {
    auto process =
        campaign::Process::Start({{program.string(), "--campaign", spec.name, "--domain", std::to_string(kDomain)},
                                  hosted->folder() / "worker.log",
                                  {}});
    ETUDE_CHECK(process, "{}", process.error().message);
    processes.push_back(std::move(*process));
  }
  const std::size_t warm = 3 * static_cast<std::size_t>(workers);
  Stopwatch waiting;
  while (hosted->commits.count() < warm && !StopRequested()) {
    ETUDE_CHECK(waiting.Seconds() < 120, "no demonstrations: {}",
                ReadTextFile(hosted->folder() / "worker.log").value_or(""));
    WaitForStop(20ms);
  }
  WaitForStop(window);
  const std::lock_guard lock(hosted->commits.mutex);
  const auto& entries = hosted->commits.entries;
  // from commit to commit, so that no part of an episode is counted
  const double seconds = std::chrono::duration<double>(entries.back().time - entries[warm - 1].time).count();
  Rate rate;
  for (std::size_t i = warm; i < entries.size(); ++i) rate.steps_per_second += entries[i].steps / seconds;
  rate.demos_per_second = static_cast<double>(entries.size() - warm) / seconds;
  return rate;
}

Status BenchScaling(const bus::Participant& participant) {
  const double before = SpinScaling();
  std::vector<double> one, two, demos, ratios;
  for (int round = 0; round < 3; ++round) {
    const Rate single = Measure(participant, 1, 12s);
    const Rate both = Measure(participant, 2, 12s);
    one.push_back(single.steps_per_second);
    two.push_back(both.steps_per_second);
    demos.push_back(both.demos_per_second);
    ratios.push_back(both.steps_per_second / single.steps_per_second);
    fmt::print(stderr, "scaling round {}: one {:.0f} steps/s ({:.2f} demos/s), two {:.0f} steps/s ({:.2f} demos/s)\n",
               round, single.steps_per_second, single.demos_per_second, both.steps_per_second, both.demos_per_second);
  }
  const double after = SpinScaling();
  fmt::print(stderr, "two raw loops together do {:.2f}x of one before, {:.2f}x after\n", before, after);
  Print("demos_per_second", Quantile(demos, 0.5), "demos/s", 1.0, Quantile(demos, 0.5));
  if (std::abs(before - after) > 0.15)
    return Fail(Code::kUnavailable,
                fmt::format("scaling is not reported: the machine changed under the measurement ({:.2f} -> {:.2f} for "
                            "two raw loops); end other work and run again",
                            before, after));
  Print("scaling", Quantile(two, 0.5), "steps/s", Quantile(one, 0.5), Quantile(ratios, 0.5));
  return {};
}

Status Bench() {
  ETUDE_ASSIGN_OR_RETURN(const auto participant, bus::Participant::Open({kDomain, ""}));
  BenchOverhead(participant);
  return BenchScaling(participant);
}

}  // namespace
}  // namespace etude

int main() {
  ::setenv("LP_NUM_THREADS", "0", 0);
  ::setenv("ETUDE_LOG", "error", 0);
  return etude::RunMain("worker_bench", etude::Bench);
}
