// SPDX-License-Identifier: Apache-2.0
// F25: a campaign under seeded chaos for ETUDE_SOAK_MINUTES (tests/run soak --minutes M): workers are killed and
// stopped, the collector is killed and stopped for the first half and lives through the second, in which its memory and
// open files are watched. Without the variable: a quarter of a minute.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <cstdlib>

#include "services/core/rng.h"
#include "services/core/stop.h"
#include "tests/faults/campaign_run.h"

namespace etude::faults {
namespace soak_test {

using namespace std::chrono_literals;

struct Taken {
  double minutes = 0;
  double rss_mb = 0;
  std::size_t files = 0;
};

Taken TakenBy(pid_t pid, double minutes) {
  Taken taken{.minutes = minutes};
  const Path proc = fmt::format("/proc/{}", pid);
  std::uint64_t size = 0, resident = 0;
  const std::string text = ReadTextFile(proc / "status").value_or("");
  if (const auto at = text.find("VmRSS:"); at != std::string::npos)
    resident = std::strtoull(text.c_str() + at + 6, nullptr, 10);
  taken.rss_mb = static_cast<double>(resident) / 1024;
  std::error_code error;
  for (std::filesystem::directory_iterator it(proc / "fd", error), end; !error && it != end; it.increment(error))
    ++size;
  taken.files = size;
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

void Harm(CampaignRun& run, Rng& rng, bool spare_collector) {
  const std::size_t which = rng.Below(run.workers());
  switch (rng.Below(spare_collector ? 2 : 4)) {
    case 0:
      return run.ReplaceWorker(which);
    case 1:
      run.worker(which).Signal(SIGSTOP);
      WaitForStop(std::chrono::milliseconds(200 + rng.Below(2500)));  // on both sides of the lease
      return run.worker(which).Signal(SIGCONT);
    case 2:
      run.collector().Signal(SIGSTOP);
      WaitForStop(std::chrono::milliseconds(200 + rng.Below(4000)));
      return run.collector().Signal(SIGCONT);
    default:
      run.collector().Signal(SIGKILL);
      run.collector().Wait(5s);
      run.StartCollector();
  }
}

TEST(Soak, F25NothingIsLostWhateverHappens) {
  const char* text = std::getenv("ETUDE_SOAK_MINUTES");
  const double minutes = text == nullptr ? 0.25 : std::atof(text);
  CampaignRun run({.name = "soak", .domain = 98, .episodes = 1'000'000, .ms_per_attempt = 60});
  run.StartCollector();
  for (int i = 0; i < 4; ++i) run.StartWorker();
  Rng rng(25);
  std::vector<Taken> samples;
  int harms = 0;
  const Stopwatch watch;
  for (double now = 0; (now = watch.Seconds() / 60) < minutes; ++harms) {
    const bool second_half = now > minutes / 2;
    WaitForStop(std::chrono::milliseconds(rng.Below(1500)));
    Harm(run, rng, second_half);
    ASSERT_TRUE(run.collector().running()) << run.Logs();
    if (second_half) samples.push_back(TakenBy(run.collector().pid(), now));
  }
  const auto before = run.Committed();
  run.WaitForCommitted(before + 1);  // it goes on
  run.collector().Signal(SIGTERM);
  EXPECT_EQ(run.collector().Wait(30s), 0) << run.Logs();
  const Counts counts = run.Scan();
  ASSERT_FALSE(samples.empty());
  const auto [fewest, most] = std::minmax_element(samples.begin(), samples.end(),
                                                  [](const Taken& a, const Taken& b) { return a.files < b.files; });
  const double slope = SlopeOf(samples);
  EXPECT_LE(most->files, fewest->files + 16) << "open files grow";
  if (minutes >= 10) {
    EXPECT_LT(slope, 1.0) << "MB a minute";
  }
  ReportRow("F25",
            fmt::format("{:g} min of chaos, {} harms; collector {:.0f} MB, {:+.2f} MB/min, {} to {} open files",
                        minutes, harms, samples.back().rss_mb, slope, fewest->files, most->files),
            counts);
}

}  // namespace soak_test
}  // namespace etude::faults
