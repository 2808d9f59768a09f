// SPDX-License-Identifier: Apache-2.0
// Camera frames from one process to another: verified frames a second of our object channel (reliable,
// a checksum over every frame at both ends, every frame acknowledged by the application) against those
// of ddsperf (reliable; nothing verified, nothing acknowledged) with the same DDS profile and the same
// size. Both sides run in turn, A/B/A/B, each as two processes of its own.
//
// The frames are verified by CRC-32C, as frame streams are; the figure with SHA-256, as episodes
// and checkpoints use it, is printed beside it together with SHA-256's own speed, which bounds it.
#include <algorithm>
#include <cinttypes>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

#include "services/bus/checksum.h"
#include "services/bus/object_channel.h"
#include "services/core/clock.h"
#include "services/core/hash.h"
#include "services/core/log.h"
#include "services/core/stop.h"
#include "tests/bench/processes.h"

namespace {

using namespace etude;
using namespace etude::bench;
using namespace std::chrono_literals;

constexpr std::size_t kFrameSize = 224 * 224 * 3;
constexpr std::uint32_t kDomain = 70;
constexpr double kWarmUpS = 0.5;

bus::SendOptions FrameOptions(bool sha256) {
  bus::SendOptions options;
  options.chunk_size = 256 * 1024;  // a frame is one chunk
  options.window = 40;
  options.integrity = sha256 ? bus::Integrity::kSha256 : bus::Integrity::kCrc32c;
  return options;
}

bus::Participant OpenOrDie() {
  InitLog("bench", "warn");  // to stderr: stdout is for results
  auto participant = bus::Participant::Open({kDomain, ""});
  if (!participant) {
    std::fprintf(stderr, "%s\n", participant.error().message.c_str());
    std::exit(3);
  }
  return std::move(*participant);
}

// Sends frames as fast as they are acknowledged, until it is killed or stopped.
int RunSender(bool sha256) {
  InstallStopSignals();
  const auto participant = OpenOrDie();
  auto sender = bus::ObjectSender::Open(participant, "bench", "frames", bus::UniquePeerName(), FrameOptions(sha256));
  if (!sender) return 1;
  std::vector<std::uint8_t> frame(kFrameSize);  // one, as ddsperf's
  for (std::size_t i = 0; i < kFrameSize; ++i) frame[i] = static_cast<std::uint8_t>(i * 31 + i / 255);
  for (std::uint64_t id = 0; !StopRequested();) {
    for (; sender->in_flight() < FrameOptions(sha256).window; ++id) {
      if (!sender->Begin(id, frame, 0, "")) return 1;
    }
    sender->Next(100ms);
  }
  return 0;
}

// Prints verified frames a second, and all of them.
int RunReceiver(double seconds) {
  const auto participant = OpenOrDie();
  bus::ReceiveOptions options;
  options.ack_batch = 20;
  auto receiver = bus::ObjectReceiver::Open(participant, "bench", "frames", options);
  if (!receiver) return 1;
  auto frame = receiver->ReceiveView(30s);
  std::uint64_t total = 0;
  std::uint64_t frames = 0;
  std::uint64_t touched = 0;
  Stopwatch watch;
  bool warm = false;
  while (!warm || watch.Seconds() < seconds) {
    if (!warm && watch.Seconds() > kWarmUpS) {
      warm = true;
      frames = 0;
      watch.Restart();
    }
    if (!frame) return 2;
    if (frame->bytes.size() != kFrameSize) return 3;
    touched += frame->bytes[frames % kFrameSize];
    if (!receiver->Acknowledge(*frame->manifest, {})) return 1;
    frame = receiver->ReceiveView(5s);
    ++frames;
    ++total;
  }
  std::printf("%.3f %" PRIu64 " %" PRIu64 "\n", static_cast<double>(frames) / watch.Seconds(), total, touched);
  return receiver->corrupt_objects() == 0 ? 0 : 4;
}

struct Sides {
  std::vector<double> rates;   // frames/s of each round
  std::vector<double> cpu_us;  // CPU time of both processes for a frame
};

void RunOurs(double seconds, bool sha256, Sides& sides) {
  const double cpu_before = ChildrenCpuSeconds();
  double rate = 0;
  std::uint64_t total = 0;
  {
    Child sender(Self({"sender", sha256 ? "sha256" : "crc32c"}));
    Child receiver(Self({"receiver", std::to_string(seconds)}));
    std::sscanf(receiver.ReadAll().c_str(), "%lf %" SCNu64, &rate, &total);
  }
  sides.rates.push_back(rate);
  sides.cpu_us.push_back(1e6 * (ChildrenCpuSeconds() - cpu_before) / static_cast<double>(total + 1));
}

void RunDdsperf(double seconds, Sides& sides) {
  const double cpu_before = ChildrenCpuSeconds();
  const auto rates = DdsperfRates(kDomain, kFrameSize + 12, seconds);
  double total = 1;
  for (const double rate : rates) total += rate;
  total *= static_cast<double>(rates.size() + 1) / static_cast<double>(std::max<std::size_t>(rates.size(), 1));
  sides.rates.push_back(Median(rates));
  sides.cpu_us.push_back(1e6 * (ChildrenCpuSeconds() - cpu_before) / total);
}

template <class F>
double BytesPerSecond(F&& work) {
  std::size_t count = 0;
  const Stopwatch watch;
  for (; watch.Seconds() < 0.3; ++count) work();
  return static_cast<double>(count) * kFrameSize / watch.Seconds();
}

int RunBench(int repeats, double seconds) {
  UseProfile("deploy/dds/local.xml");
  const double calibration_before = TwoProcessSpin();
  Sides ours, theirs, sha;
  for (int i = 0; i < repeats; ++i) {
    RunDdsperf(seconds, theirs);
    RunOurs(seconds, false, ours);
    RunOurs(seconds, true, sha);
    std::fprintf(stderr, "round %d: ddsperf %.0f frames/s, ours %.0f (CRC-32C), %.0f (SHA-256)\n", i + 1,
                 theirs.rates.back(), ours.rates.back(), sha.rates.back());
  }
  const double calibration_after = TwoProcessSpin();
  const std::vector<std::uint8_t> frame(kFrameSize, 7);
  std::uint64_t sink = 0;
  const double crc_speed = BytesPerSecond([&] { sink += bus::Crc32c(frame); });
  const double sha_speed = BytesPerSecond([&] { sink += Sha256Of(frame)[0]; });
  std::fprintf(stderr,
               "one core alone: CRC-32C %.2f GB/s, SHA-256 %.2f GB/s, so SHA-256 at both ends allows at "
               "most %.0f frames/s (%d)\n",
               crc_speed / 1e9, sha_speed / 1e9, sha_speed / kFrameSize, static_cast<int>(sink & 1));
  for (const auto& [name, side] : {std::pair{"ddsperf", &theirs}, {"ours, CRC-32C", &ours}, {"ours, SHA-256", &sha}}) {
    std::fprintf(stderr, "%-14s %s frames/s, CPU %s us/frame\n", name, Summary(side->rates).c_str(),
                 Summary(side->cpu_us).c_str());
  }
  PrintCalibration(calibration_before, calibration_after);
  const double value = Median(ours.rates);
  const double baseline = Median(theirs.rates);
  std::printf(
      "{\"name\": \"transport\", \"value\": %.1f, \"unit\": \"frames/s\", \"baseline\": %.1f, "
      "\"ratio\": %.3f}\n",
      value, baseline, baseline > 0 ? value / baseline : 0.0);
  return value > 0 && baseline > 0 ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 3 && std::strcmp(argv[1], "sender") == 0) {
    return RunSender(std::strcmp(argv[2], "sha256") == 0);
  }
  if (argc == 3 && std::strcmp(argv[1], "receiver") == 0) {
    return RunReceiver(std::strtod(argv[2], nullptr));
  }
  const int repeats = argc > 1 ? std::atoi(argv[1]) : 5;
  const double seconds = argc > 2 ? std::strtod(argv[2], nullptr) : 3;
  return RunBench(std::max(1, repeats), seconds);
}
