// SPDX-License-Identifier: Apache-2.0
// F25: a campaign under seeded chaos for ETUDE_SOAK_MINUTES (tests/run soak --minutes M): workers are killed and
// stopped, the link between the hosts is cut (where two hosts can be made), the collector is killed and stopped for the
// first half and lives through the second, in which its memory and open files are watched. Without the variable: a
// quarter of a minute.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <cstdlib>
#include <map>

#include "services/core/clock.h"
#include "services/core/rng.h"
#include "services/core/stop.h"
#include "tests/faults/two_hosts.h"

namespace etude::faults {
namespace soak_test {

using namespace std::chrono_literals;

constexpr double kMostCollectorMb = 256;  // resident, whatever is done to it and to its workers
constexpr double kSlopeFromMinutes = 10;  // shorter runs say nothing about growth

struct Taken {
  double minutes = 0;
  double rss_mb = 0;
  std::size_t files = 0;
};

Taken TakenBy(pid_t pid, double minutes) {
  Taken taken{.minutes = minutes, .rss_mb = ResidentMb(pid)};
  std::error_code error;
  for (std::filesystem::directory_iterator it(fmt::format("/proc/{}/fd", pid), error), end; !error && it != end;
       it.increment(error))
    ++taken.files;
  return taken;
}

// Least squares, MB a minute.
double SlopeOf(const std::vector<Taken>& samples) {
  double t = 0, y = 0, tt = 0, ty = 0;
  const auto n = static_cast<double>(samples.size());
  for (const Taken& sample : samples) {
    t += sample.minutes;
    y += sample.rss_mb;
    tt += sample.minutes * sample.minutes;
    ty += sample.minutes * sample.rss_mb;
  }
  const double spread = n * tt - t * t;
  return spread > 0 ? (n * ty - t * y) / spread : 0;
}

class Chaos {
 public:
  Chaos(CampaignRun& run, const TwoHosts& hosts, double minutes) : run_(run), hosts_(hosts), minutes_(minutes) {}

  // One harm, at random.
  void Harm(bool spare_collector) {
    std::vector<void (Chaos::*)()> ways{&Chaos::KillWorker, &Chaos::StopWorker};
    if (hosts_.up()) ways.push_back(&Chaos::CutLink);
    if (!spare_collector) ways.insert(ways.end(), {&Chaos::StopCollector, &Chaos::KillCollector});
    (this->*ways[rng_.Below(ways.size())])();
  }
  void Pause() { Wait(0, 1500); }
  // "12 workers killed, 9 stopped, ..."
  std::string Text() const {
    std::string text;
    for (const auto& [what, count] : done_) text += fmt::format("{}{} x {}", text.empty() ? "" : ", ", count, what);
    return text;
  }

 private:
  void Wait(std::uint64_t least_ms, std::uint64_t more_ms) {
    WaitForStop(std::chrono::milliseconds(least_ms + rng_.Below(more_ms)));
  }
  campaign::Process& AnyWorker() { return run_.worker(rng_.Below(run_.workers())); }
  void KillWorker() {
    run_.ReplaceWorker(rng_.Below(run_.workers()));
    ++done_["worker killed"];
  }
  void StopWorker() {
    auto& worker = AnyWorker();
    worker.Signal(SIGSTOP);
    Wait(200, 4500);  // on both sides of the lease
    worker.Signal(SIGCONT);
    ++done_["worker stopped"];
  }
  void CutLink() {
    hosts_.Link(false);
    // now and then for longer than peers of DDS believe in each other (10 s)
    if (minutes_ >= kSlopeFromMinutes && rng_.Below(4) == 0)
      Wait(11'000, 4000);
    else
      Wait(200, 4500);
    hosts_.Link(true);
    ++done_["link cut"];
  }
  void StopCollector() {
    run_.collector().Signal(SIGSTOP);
    Wait(200, 4000);
    run_.collector().Signal(SIGCONT);
    ++done_["collector stopped"];
  }
  void KillCollector() {
    run_.collector().Signal(SIGKILL);
    run_.collector().Wait(5s);
    run_.StartCollector();
    ++done_["collector killed"];
  }

  CampaignRun& run_;
  const TwoHosts& hosts_;
  const double minutes_;
  Rng rng_{25};
  std::map<std::string, int> done_;
};

// Of the second half, in which one collector lives: what it takes is bounded and does not grow.
void ExpectBounded(const std::vector<Taken>& samples, double minutes) {
  const auto [fewest, most] = std::ranges::minmax_element(samples, {}, &Taken::files);
  EXPECT_LE(most->files, fewest->files + 16) << "open files grow";
  if (minutes >= kSlopeFromMinutes) {
    EXPECT_LT(SlopeOf(samples), 1.0) << "MB a minute";
  }
}

TEST(Soak, F25NothingIsLostWhateverHappens) {
  const char* text = std::getenv("ETUDE_SOAK_MINUTES");
  const double minutes = text == nullptr ? 0.25 : std::atof(text);
  constexpr std::uint64_t kMoreThanAreMade = 1'000'000;
  const TwoHosts hosts;
  RunOptions options{.name = "soak", .domain = 98, .episodes = kMoreThanAreMade, .ms_per_attempt = 60};
  if (hosts.up()) options = hosts.Options("soak", kMoreThanAreMade, 60);
  CampaignRun run(options);
  run.StartCollector();
  for (int i = 0; i < 4; ++i) run.StartWorker();
  run.WaitForCommitted(1);
  Chaos chaos(run, hosts, minutes);
  std::vector<Taken> samples;
  double most_mb = 0;
  const Stopwatch watch;
  for (double now = 0; (now = watch.Seconds() / 60) < minutes || samples.empty();) {
    const bool second_half = now > minutes / 2;
    chaos.Pause();
    chaos.Harm(second_half);
    ASSERT_TRUE(run.collector().running()) << run.Logs();
    const Taken taken = TakenBy(run.collector().pid(), now);
    most_mb = std::max(most_mb, taken.rss_mb);
    if (second_half) samples.push_back(taken);
  }
  run.WaitForCommitted(run.Committed() + 1);  // it goes on
  run.collector().Signal(SIGTERM);
  EXPECT_EQ(run.collector().Wait(30s), 0) << run.Logs();
  ExpectBounded(samples, minutes);
  EXPECT_LE(most_mb, kMostCollectorMb);
  ReportRow("F25",
            fmt::format("{:g} min of chaos: {}; collector at most {:.0f} MB, {:+.2f} MB/min", minutes, chaos.Text(),
                        most_mb, SlopeOf(samples)),
            run.Scan());
}

}  // namespace soak_test
}  // namespace etude::faults
