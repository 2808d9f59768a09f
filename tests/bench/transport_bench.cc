// SPDX-License-Identifier: Apache-2.0
// Episodes from one process to another on the path that workers and the collector take: a blob of an episode's size,
// sent, hashed at both ends (SHA-256), received whole, acknowledged by the application, then the next one. Against
// ddsperf (reliable; nothing verified, nothing acknowledged) with the same DDS profile and samples of one chunk.
// Both sides run in turn, A/B/A/B, each as processes of its own.
#include <algorithm>
#include <cinttypes>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "services/bus/blob_transfer.h"
#include "services/core/clock.h"
#include "services/core/hash.h"
#include "services/core/log.h"
#include "services/core/stop.h"
#include "tests/bench/processes.h"

namespace {

using namespace etude;
using namespace etude::bench;
using namespace std::chrono_literals;

constexpr std::size_t kEpisodeSize = 2'200'000;  // of the campaign `quickstart`, on average
constexpr std::uint32_t kDomain = 70;
constexpr double kWarmUpS = 0.5;

bus::Participant OpenOrDie() {
  InitLog("bench", "warn");  // to stderr: stdout is for results
  auto participant = bus::Participant::Open({kDomain, ""});
  if (!participant) {
    std::fprintf(stderr, "%s\n", participant.error().message.c_str());
    std::exit(3);
  }
  return std::move(*participant);
}

// Sends episodes one after the other, as a worker does, until it is killed or stopped.
int RunSender() {
  InstallStopSignals();
  const auto participant = OpenOrDie();
  auto sender = bus::BlobSender::Open(participant, {"bench", "1"}, "episode", bus::UniquePeerName());
  if (!sender) return 1;
  std::vector<std::uint8_t> episode(kEpisodeSize);
  for (std::size_t i = 0; i < kEpisodeSize; ++i) episode[i] = static_cast<std::uint8_t>(i * 31 + i / 255);
  for (std::uint64_t id = 1; !StopRequested(); ++id) {
    episode[id % kEpisodeSize] ^= 1;
    if (!sender->Send(id, episode, id, "", 30s) && !StopRequested()) return 1;
  }
  return 0;
}

// Prints verified episodes a second, and all of them.
int RunReceiver(double seconds) {
  const auto participant = OpenOrDie();
  auto receiver = bus::BlobReceiver::Open(participant, {"bench", "1"}, "episode");
  if (!receiver) return 1;
  std::uint64_t total = 0, episodes = 0;
  Stopwatch watch;
  bool warm = false;
  for (auto episode = receiver->Receive(30s); !warm || watch.Seconds() < seconds; episode = receiver->Receive(5s)) {
    if (!episode) return 2;
    if (episode->bytes.size() != kEpisodeSize) return 3;
    if (!receiver->Acknowledge(episode->manifest, {})) return 1;
    if (!warm && watch.Seconds() > kWarmUpS) {
      warm = true;
      episodes = 0;
      watch.Restart();
      continue;
    }
    ++episodes;
    ++total;
  }
  std::printf("%.3f %" PRIu64 "\n", static_cast<double>(episodes) / watch.Seconds(), total);
  return receiver->corrupt_blobs() == 0 ? 0 : 4;
}

struct Sides {
  std::vector<double> megabytes;  // a second, of each round
  std::vector<double> cpu_ms;     // CPU time of all processes for a megabyte
};

void RunOurs(double seconds, int senders, Sides& sides) {
  const double cpu_before = ChildrenCpuSeconds();
  double rate = 0;
  std::uint64_t total = 0;
  {
    std::vector<std::unique_ptr<Child>> sending;
    for (int i = 0; i < senders; ++i) sending.push_back(std::make_unique<Child>(Self({"sender"})));
    Child receiver(Self({"receiver", std::to_string(seconds)}));
    std::sscanf(receiver.ReadAll().c_str(), "%lf %" SCNu64, &rate, &total);
  }
  const double megabytes = static_cast<double>((total + 1) * kEpisodeSize) / 1e6;
  sides.megabytes.push_back(rate * kEpisodeSize / 1e6);
  sides.cpu_ms.push_back(1e3 * (ChildrenCpuSeconds() - cpu_before) / megabytes);
}

void RunDdsperf(double seconds, Sides& sides) {
  const std::size_t chunk = bus::SendOptions{}.chunk_size;
  const double cpu_before = ChildrenCpuSeconds();
  const auto rates = DdsperfRates(kDomain, chunk + 12, seconds);
  double total = 1;
  for (const double rate : rates) total += rate;
  total *= static_cast<double>(rates.size() + 1) / static_cast<double>(std::max<std::size_t>(rates.size(), 1));
  sides.megabytes.push_back(Median(rates) * static_cast<double>(chunk) / 1e6);
  sides.cpu_ms.push_back(1e3 * (ChildrenCpuSeconds() - cpu_before) / (total * static_cast<double>(chunk) / 1e6));
}

// SHA-256 of an episode on one core, MB/s: at both ends of a transfer it bounds what can be reached.
double HashMegabytes() {
  const std::vector<std::uint8_t> episode(kEpisodeSize, 7);
  std::uint64_t sink = 0;
  std::size_t count = 0;
  const Stopwatch watch;
  for (; watch.Seconds() < 0.5; ++count) sink += Sha256Of(episode)[0];
  return (sink > 0 ? 1.0 : 0.5) * static_cast<double>(count * kEpisodeSize) / 1e6 / watch.Seconds();
}

int RunBench(int repeats, double seconds) {
  UseProfile("deploy/dds/local.xml");
  const double calibration_before = TwoProcessSpin();
  Sides one, two, theirs;
  for (int i = 0; i < repeats; ++i) {
    RunDdsperf(seconds, theirs);
    RunOurs(seconds, 1, one);
    RunOurs(seconds, 2, two);
    std::fprintf(stderr, "round %d: ddsperf %.0f MB/s, ours %.0f (one worker), %.0f (two)\n", i + 1,
                 theirs.megabytes.back(), one.megabytes.back(), two.megabytes.back());
  }
  const double calibration_after = TwoProcessSpin();
  std::fprintf(stderr, "one core alone: SHA-256 %.0f MB/s, needed at both ends\n", HashMegabytes());
  for (const auto& [name, side] :
       {std::pair{"ddsperf", &theirs}, {"ours, one worker", &one}, {"ours, two workers", &two}}) {
    std::fprintf(stderr, "%-18s %s MB/s, CPU %s ms/MB\n", name, Summary(side->megabytes).c_str(),
                 Summary(side->cpu_ms).c_str());
  }
  PrintCalibration(calibration_before, calibration_after);
  const double value = Median(one.megabytes);
  const double baseline = Median(theirs.megabytes);
  std::printf(
      "{\"name\": \"transport\", \"value\": %.1f, \"unit\": \"MB/s\", \"baseline\": %.1f, "
      "\"ratio\": %.3f}\n",
      value, baseline, baseline > 0 ? value / baseline : 0.0);
  return value > 0 && baseline > 0 ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 2 && std::strcmp(argv[1], "sender") == 0) return RunSender();
  if (argc == 3 && std::strcmp(argv[1], "receiver") == 0) return RunReceiver(std::strtod(argv[2], nullptr));
  const int repeats = argc > 1 ? std::atoi(argv[1]) : 5;
  const double seconds = argc > 2 ? std::strtod(argv[2], nullptr) : 3;
  return RunBench(std::max(1, repeats), seconds);
}
