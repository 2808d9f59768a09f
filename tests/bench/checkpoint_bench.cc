// SPDX-License-Identifier: Apache-2.0
// A 40 MB checkpoint from the call of Publish until a subscriber in another process has verified it
// (SHA-256 over all of it), against the same bytes as one DDS sample, from the write until another
// process has taken it (nothing verified), with the same QoS for late joiners. Four lines:
//   checkpoint               the one sample with Cyclone DDS as it comes, without a profile
//   checkpoint_same_profile  the one sample with our profile, whose large packets help it as well
//   checkpoint_ddsperf       one-sample checkpoints back to back, as ddsperf sends them, without a profile
//   checkpoint_floor         the larger of one SHA-256 pass over the bytes and ddsperf's time for them in samples of
//   512 KiB
//                            with our profile: what a transfer that hashes while it sends and receives comes to
// All sides run in turn, A/B/C/D/A/B/C/D, in processes of their own.
#include <dds/dds.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

#include "blob.h"
#include "services/bus/blob_transfer.h"
#include "services/bus/participant_state.h"
#include "services/core/clock.h"
#include "services/core/hash.h"
#include "services/core/log.h"
#include "tests/bench/processes.h"

namespace {

using namespace etude;
using namespace etude::bench;
using namespace std::chrono_literals;

constexpr std::size_t kSize = 40'000'000;
constexpr std::uint32_t kDomain = 70;

constexpr char kNoProfile[] = "<CycloneDDS/>";
constexpr char kProfile[] = "deploy/dds/local.xml";

// `plain`: Cyclone DDS with its own defaults; else the profile of the environment.
bus::Participant OpenOrDie(bool plain = false) {
  InitLog("bench", "warn");  // to stderr: stdout is for results
  auto participant = bus::Participant::Open({kDomain, plain ? kNoProfile : ""});
  if (!participant) {
    std::fprintf(stderr, "%s\n", participant.error().message.c_str());
    std::exit(3);
  }
  return std::move(*participant);
}

// What could not be opened ends the program with words.
template <class T>
T OrDie(etude::Result<T> opened) {
  if (opened) return std::move(*opened);
  std::fprintf(stderr, "checkpoint_bench: %s\n", opened.error().message.c_str());
  std::exit(3);
}

// Says "ready" and then a line for every version that it has got.
void Say(const char* line) {
  std::printf("%s\n", line);
  std::fflush(stdout);
}

int RunChunkedSubscriber() {
  const auto participant = OpenOrDie();
  auto subscriber = OrDie(bus::BlobSubscriber::Open(participant, {"bench", "1"}, "latest"));
  Say("ready");
  while (const auto blob = subscriber.Wait(60s)) {
    if (blob->bytes.size() != kSize) return 1;
    Say("got");
  }
  return 0;
}

// A checkpoint's QoS: reliable, transient-local, the newest only.
constexpr bus::TopicQos kBlobQos{true, 1};

// The topic of one sample is not one of Etude's, whose table says what the bus opens: made with the library's calls.
bus::Endpoint OpenSingle(const bus::Participant& participant, bool is_writer) {
  bus::Endpoint out;
  out.state = participant.state();
  out.is_writer = is_writer;
  const dds_entity_t parent = out.state->participant.get();
  const bus::Qos qos = bus::MakeQos(kBlobQos);
  out.topic = OrDie(bus::CheckEntity(dds_create_topic(parent, &etude_bench_Blob_desc, "bench/blob", qos.get(), nullptr),
                                     "topic of the bench"));
  out.endpoint = OrDie(bus::CheckEntity(is_writer ? dds_create_writer(parent, out.topic.get(), qos.get(), nullptr)
                                                  : dds_create_reader(parent, out.topic.get(), qos.get(), nullptr),
                                        "endpoint of the bench"));
  out.traffic = out.state->TrafficOf("bench/blob", is_writer);
  return out;
}

int RunSingleSubscriber(bool plain) {
  const auto participant = OpenOrDie(plain);
  auto reader = OpenSingle(participant, false);
  bus::Waiter waiter;
  const auto opened = waiter.Open(participant);
  const auto added = opened ? waiter.AddReader(reader) : opened;
  if (!added) {
    std::fprintf(stderr, "checkpoint_bench: %s\n", added.error().message.c_str());
    return 3;
  }
  Say("ready");
  while (waiter.Wait(60s)) {
    void* sample[1] = {};
    dds_sample_info_t info;
    const int count = dds_take(reader.get(), sample, &info, 1, 1);
    if (count > 0 && info.valid_data) {
      if (static_cast<etude_bench_Blob*>(sample[0])->data._length != kSize) return 1;
      Say("got");
    }
    if (count > 0) dds_return_loan(reader.get(), sample, count);
  }
  return 0;
}

std::vector<std::uint8_t> MakeCheckpoint() {
  std::vector<std::uint8_t> bytes(kSize);
  std::uint32_t state = 1;
  for (auto& byte : bytes) {
    state = state * 1664525u + 1013904223u;
    byte = static_cast<std::uint8_t>(state >> 24);
  }
  return bytes;
}

// Prints the milliseconds of each of `count` checkpoints after a first one that does not count.
template <class Publish, class Matched>
int Time(const char* subscriber_role, int count, Publish&& publish, Matched&& matched) {
  Child subscriber(Self({subscriber_role}));
  if (subscriber.ReadLine() != "ready") return 1;
  for (const Stopwatch watch; !matched() && watch.Seconds() < 10;) ::usleep(1000);
  auto bytes = MakeCheckpoint();
  for (int version = 1; version <= count + 1; ++version) {
    bytes[0] = static_cast<std::uint8_t>(version);
    const Stopwatch watch;
    if (!publish(static_cast<std::uint64_t>(version), bytes)) return 1;
    if (subscriber.ReadLine() != "got") return 1;
    if (version > 1) std::printf("%.4f\n", 1e3 * watch.Seconds());
  }
  return 0;
}

int RunChunkedPublisher(int count) {
  const auto participant = OpenOrDie();
  bus::SendOptions options;
  if (const char* kilobytes = std::getenv("CHUNK_KIB")) {
    options.chunk_size = static_cast<std::uint32_t>(std::atoi(kilobytes)) * 1024;
  }
  auto publisher = OrDie(bus::BlobPublisher::Open(participant, {"bench", "1"}, options));
  return Time(
      "chunked-subscriber", count,
      [&](std::uint64_t version, const std::vector<std::uint8_t>& bytes) {
        return publisher.Publish("latest", version, bytes, "{}").has_value();
      },
      [&] { return publisher.matched_subscribers() > 0; });
}

int RunSinglePublisher(bool plain, int count) {
  const auto participant = OpenOrDie(plain);
  auto writer = OpenSingle(participant, true);
  return Time(
      plain ? "plain-subscriber" : "single-subscriber", count,
      [&](std::uint64_t version, std::vector<std::uint8_t>& bytes) {
        etude_bench_Blob blob{};
        blob.version = version;
        blob.data._length = blob.data._maximum = static_cast<std::uint32_t>(bytes.size());
        blob.data._buffer = bytes.data();
        return dds_write(writer.get(), &blob) == DDS_RETCODE_OK;
      },
      [&] { return bus::MatchedReaders(writer) > 0; });
}

std::vector<double> Run(const char* role, int count) {
  Child publisher(Self({role, std::to_string(count)}));
  std::vector<double> times;
  for (std::string line; !(line = publisher.ReadLine()).empty();) {
    times.push_back(std::strtod(line.c_str(), nullptr));
  }
  return times;
}

// Milliseconds a sample of `size` bytes, with the profile of the environment.
double DdsperfMs(std::size_t size) {
  const auto rates = DdsperfRates(kDomain, size, 5);
  double total = 0;
  for (const double rate : rates) total += rate;
  return total > 0 ? 1e3 * static_cast<double>(rates.size()) / total : 0;
}

double RunDdsperf() {
  ::setenv("CYCLONEDDS_URI", kNoProfile, 1);
  const double milliseconds = DdsperfMs(kSize);
  UseProfile(kProfile);
  return milliseconds;
}

// All bytes in samples of the largest chunk.
double RunDdsperfInChunks() { return DdsperfMs(bus::kMaxChunkSize) * static_cast<double>(kSize) / bus::kMaxChunkSize; }

double HashMs() {
  const auto bytes = MakeCheckpoint();
  const Stopwatch watch;
  const auto digest = Sha256Of(bytes);
  const double milliseconds = 1e3 * watch.Seconds();
  std::fprintf(stderr, "  SHA-256 of it on one core: %.1f ms (%s)\n", milliseconds, ToHex(digest).substr(0, 8).c_str());
  return milliseconds;
}

int RunBench(int repeats, int count) {
  UseProfile(kProfile);
  const double calibration_before = TwoProcessSpin();
  std::vector<double> ours, plain, profiled, ddsperf, floor;
  const auto take = [count](const char* role, std::vector<double>& all) {
    const auto times = Run(role, count);
    std::fprintf(stderr, "  %s %s ms\n", role, Summary(times).c_str());
    all.insert(all.end(), times.begin(), times.end());
    return static_cast<int>(times.size()) == count;
  };
  for (int i = 0; i < repeats; ++i) {
    std::fprintf(stderr, "round %d\n", i + 1);
    if (!take("plain-publisher", plain) || !take("single-publisher", profiled) || !take("chunked-publisher", ours)) {
      std::fprintf(stderr, "a side failed\n");
      return 1;
    }
    ddsperf.push_back(RunDdsperf());
    const double in_chunks = RunDdsperfInChunks();
    floor.push_back(std::max(HashMs(), in_chunks));
    std::fprintf(stderr, "  ddsperf %.1f ms, in samples of 512 KiB %.1f ms\n", ddsperf.back(), in_chunks);
  }
  PrintCalibration(calibration_before, TwoProcessSpin());
  const double value = Median(ours);
  const auto print = [value](const char* name, double baseline) {
    std::printf(
        "{\"name\": \"%s\", \"value\": %.2f, \"unit\": \"ms\", \"baseline\": %.2f, "
        "\"ratio\": %.3f}\n",
        name, value, baseline, baseline / value);
  };
  print("checkpoint", Median(plain));
  print("checkpoint_same_profile", Median(profiled));
  print("checkpoint_ddsperf", Median(ddsperf));
  print("checkpoint_floor", Median(floor));
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string role = argc > 1 ? argv[1] : "";
  if (role == "chunked-subscriber") return RunChunkedSubscriber();
  if (role == "single-subscriber") return RunSingleSubscriber(false);
  if (role == "plain-subscriber") return RunSingleSubscriber(true);
  if (role == "chunked-publisher" && argc > 2) return RunChunkedPublisher(std::atoi(argv[2]));
  if (role == "single-publisher" && argc > 2) return RunSinglePublisher(false, std::atoi(argv[2]));
  if (role == "plain-publisher" && argc > 2) return RunSinglePublisher(true, std::atoi(argv[2]));
  return RunBench(argc > 1 ? std::max(1, std::atoi(argv[1])) : 5, argc > 2 ? std::max(1, std::atoi(argv[2])) : 3);
}
