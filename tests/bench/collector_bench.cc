// SPDX-License-Identifier: Apache-2.0
// How many episodes one collector makes durable: replayed real ones, from senders that are processes of their own, by
// the protocol of workers on real DDS. Beside it the floor: the same bytes in memory, two threads, SHA-256 once, write,
// rename, fsync per 16 files and of their folder.
//
//   collector_bench [EPISODES [DATASET [TMPFS [DISK [DOMAIN]]]]]
//
// EPISODES are committed in each configuration (default 300); DATASET is replayed (default: twelve demonstrations of
// the quickstart are collected first); TMPFS and DISK are folders to write in (/dev/shm, the temporary folder).
// A JSON line for each of 1, 2, 4 senders on either; tables and rounds go to stderr. CPU per episode is the figure to
// compare where the machine has other work.
//
//   collector_bench paced [EPISODES [DATASET [TMPFS [DOMAIN]]]]
//
// What many workers cost beside few at the same 20 episodes a second in all: 2 processes, 100 processes, each its own
// participant, and 100 slots of 4 processes that have one participant each (host agents), all with the heartbeats of
// workers. The clock starts when everybody has been matched and nobody is busy with discovery any more. A JSON line for
// each: the collector's CPU per episode (`baseline`: with 2), and lease p99; `rate` tells whether the machine kept up.
#include <fcntl.h>
#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <stop_token>
#include <thread>

#include "services/bus/blob_transfer.h"
#include "services/bus/topic.h"
#include "services/campaign/collector.h"
#include "services/campaign/lease_table.h"
#include "services/core/clock.h"
#include "services/core/hash.h"
#include "services/core/identity.h"
#include "services/core/log.h"
#include "services/core/stop.h"
#include "services/episode/codec.h"
#include "services/spec/episode_plan.h"
#include "services/store/dataset.h"
#include "tests/bench/processes.h"
#include "tests/support/programs_folder.h"

namespace {

using namespace etude;
using namespace etude::bench;
using namespace std::chrono_literals;

constexpr std::uint64_t kReplayed = 12;  // episodes that a sender keeps in memory
constexpr double kWarmUp = 0.1;          // share of the episodes that are committed before the clock starts

[[noreturn]] void Die(const Error& error) {
  fmt::print(stderr, "{}\n", error.message);
  std::exit(3);
}

template <class T>
T OrDie(Result<T> result) {
  if (!result) Die(result.error());
  return std::move(*result);
}

std::vector<Episode> RealEpisodes(const Path& dataset) {
  const auto reader = OrDie(store::DatasetReader::Open(dataset));
  std::vector<Episode> episodes;
  for (const std::uint64_t index : OrDie(reader.List())) {
    if (episodes.size() == kReplayed) break;
    episodes.push_back(OrDie(reader.ReadWhole(index)));
  }
  if (episodes.empty()) Die({Code::kNotFound, fmt::format("'{}' has no episodes", dataset.string())});
  return episodes;
}

CampaignSpec BenchSpec(const Path& dataset, std::uint64_t episodes) {
  CampaignSpec spec = OrDie(store::DatasetReader::Open(dataset)).spec();
  spec.name = "collector-bench";
  spec.episodes = episodes;
  return spec;
}

// ------------------------------------------------------------------------------------------ sender

// What a worker does, without the work: asks, sends a real episode under the number that it was given, asks again.
class Sender {
 public:
  Sender(const bus::Participant& participant, const CampaignSpec& spec, const std::string& id, std::string name)
      : spec_(spec),
        sha256_(SpecHash(spec)),
        owner_{spec.name, id},
        name_(std::move(name)),
        host_(participant.address()) {
    requests_.emplace(OrDie(bus::Writer<bus::WorkRequest>::Open(participant, owner_.partition())));
    leases_.emplace(OrDie(bus::Reader<bus::Lease>::Open(participant, owner_.address_partition(host_))));
    heartbeats_.emplace(OrDie(bus::Writer<bus::WorkerStatus>::Open(participant, owner_.partition())));
    sender_.emplace(OrDie(bus::BlobSender::Open(participant, owner_, "episode", name_)));
  }

  // Until the collector has found this one; who answers is there with the first answer (bus::AddressedWriters).
  void AwaitMatch() const {
    (void)requests_->WaitForReaders(1, 60s);
    (void)heartbeats_->WaitForReaders(1, 60s);
  }

  void Beat() {
    bus::WorkerStatus status;
    status.campaign = owner_.name;
    status.campaign_id = owner_.id;
    status.worker = name_;
    status.host = HostName();
    status.phase = "play";
    status.token = campaign::MarkOf(token_);
    status.index = index_;
    (void)heartbeats_->Write(status);
  }

  // One episode; milliseconds that its lease took. Nothing when it could not be had.
  std::optional<double> MakeOne(const std::vector<Episode>& episodes) {
    const Stopwatch watch;
    const auto lease = Ask();
    if (!lease || lease->kind != bus::LeaseKind::kWork) return std::nullopt;
    const double wait_ms = 1e3 * watch.Seconds();
    index_ = lease->index;
    token_ = lease->token;
    const Episode& real = episodes[lease->index % episodes.size()];
    const auto verdict = sender_->Send(++sent_, EncodeEpisode(Renumbered(real, *lease)), lease->token, "{}", 60s);
    if (verdict && verdict->kind == bus::AckKind::kRefused) Die({Code::kInternal, verdict->reason});
    token_ = 0;
    return verdict ? std::optional(wait_ms) : std::nullopt;
  }

  // Until the campaign is complete; milliseconds that each lease took.
  std::vector<double> Run(const std::vector<Episode>& episodes) {
    std::vector<double> waits;
    while (!StopRequested()) {
      const Stopwatch watch;
      const auto lease = Ask();
      if (!lease || lease->kind == bus::LeaseKind::kDone) break;
      if (lease->kind != bus::LeaseKind::kWork) {
        std::this_thread::sleep_for(5ms);
        continue;
      }
      waits.push_back(1e3 * watch.Seconds());
      const Episode& real = episodes[lease->index % episodes.size()];
      const auto verdict = sender_->Send(++sent_, EncodeEpisode(Renumbered(real, *lease)), lease->token, "{}", 60s);
      if (!verdict) break;
      if (verdict->kind == bus::AckKind::kRefused) Die({Code::kInternal, verdict->reason});
    }
    return waits;
  }

 private:
  std::optional<bus::Lease> Ask() {
    bus::WorkRequest request;
    request.campaign = owner_.name;
    request.campaign_id = owner_.id;
    request.spec_sha256 = sha256_;
    request.worker = name_;
    request.host = host_;
    request.content = kContentVersion;
    for (int tries = 0; tries < 20 && !StopRequested(); ++tries) {
      request.request_id = ++asked_;
      (void)requests_->Write(request);
      for (const Stopwatch watch; watch.Seconds() < 1;) {
        leases_->Wait(100ms);
        for (auto& lease : leases_->Take())
          if (lease.worker == name_ && lease.request_id == asked_) return std::move(lease);
      }
    }
    return std::nullopt;
  }

  Episode Renumbered(Episode episode, const bus::Lease& lease) const {
    const EpisodePlan plan = PlanEpisode(spec_, lease.index, lease.attempt, {});
    episode.campaign = spec_.name;
    episode.spec_sha256 = sha256_;
    episode.version = std::to_string(kContentVersion);
    episode.index = lease.index;
    episode.attempt = lease.attempt;
    episode.seed = plan.seed;
    episode.task = plan.task.text();
    return episode;
  }

  const CampaignSpec& spec_;
  std::string sha256_;
  bus::Owner owner_;
  std::string name_, host_;
  std::optional<bus::Writer<bus::WorkRequest>> requests_;
  std::optional<bus::Reader<bus::Lease>> leases_;
  std::optional<bus::Writer<bus::WorkerStatus>> heartbeats_;
  std::optional<bus::BlobSender> sender_;
  std::uint64_t asked_ = 0, sent_ = 0;
  std::atomic<std::uint64_t> token_{0}, index_{0};  // of what it makes, for Beat from another thread
};

bus::Participant Join(std::uint32_t domain) {
  InitLog("bench", "warn");  // to stderr: stdout is for results
  return OrDie(bus::Participant::Open({domain, ""}));
}

int RunSender(std::uint32_t domain, const Path& dataset, std::uint64_t total, const std::string& id) {
  InstallStopSignals();
  const CampaignSpec spec = BenchSpec(dataset, total);
  const auto episodes = RealEpisodes(dataset);
  const auto participant = Join(domain);
  Sender sender(participant, spec, id, bus::UniquePeerName());
  for (const double wait : sender.Run(episodes)) fmt::print("{:.4f}\n", wait);
  return 0;
}

// What the senders of one process know of a paced run.
struct Pace {
  int first = 0, count = 1;  // of all senders these are here, on one participant
  int all = 1;               // senders
  std::uint64_t each = 0;    // episodes of each
  Path start;                // a file that appears when the clock starts
};

constexpr double kPacedRate = 20;  // episodes a second in all

void AwaitStart(const Path& start) {
  while (!std::filesystem::exists(start) && !StopRequested()) std::this_thread::sleep_for(100ms);
}

// One worker of many: its turn comes every `all` episodes.
std::vector<double> RunPaced(Sender& sender, const Pace& pace, int number, const std::vector<Episode>& episodes) {
  std::vector<double> waits;
  const auto begin = MonotonicClock::now();
  for (std::uint64_t k = 0; k < pace.each && !StopRequested(); ++k) {
    const double turn_s = (number + static_cast<double>(k) * pace.all) / kPacedRate;
    std::this_thread::sleep_until(
        begin + std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::duration<double>(turn_s)));
    const auto wait = sender.MakeOne(episodes);
    if (!wait) Die({Code::kInternal, "a paced sender got no work, or its episode was not taken"});
    waits.push_back(*wait);
  }
  return waits;
}

// Prints "ready" when all of this process have been matched, at the end a line for each lease.
int RunPacedSenders(std::uint32_t domain, const Path& dataset, std::uint64_t total, const std::string& id,
                    const Pace& pace) {
  InstallStopSignals();
  const CampaignSpec spec = BenchSpec(dataset, total);
  auto episodes = RealEpisodes(dataset);
  episodes.resize(1);  // a hundred processes shall fit into the machine
  const auto participant = Join(domain);
  std::vector<std::unique_ptr<Sender>> senders;
  for (int i = 0; i < pace.count; ++i)
    senders.push_back(std::make_unique<Sender>(participant, spec, id, fmt::format("{}-{}", bus::UniquePeerName(), i)));
  for (const auto& sender : senders) sender->AwaitMatch();
  std::jthread beating([&](const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      for (const auto& sender : senders) sender->Beat();
      std::this_thread::sleep_for(500ms);
    }
  });
  fmt::print("ready\n");
  std::fflush(stdout);
  AwaitStart(pace.start);
  std::vector<std::vector<double>> waits(senders.size());
  {
    std::vector<std::jthread> threads;
    for (std::size_t i = 0; i < senders.size(); ++i)
      threads.emplace_back(
          [&, i] { waits[i] = RunPaced(*senders[i], pace, pace.first + static_cast<int>(i), episodes); });
  }
  for (const auto& of_sender : waits)
    for (const double wait : of_sender) fmt::print("{:.4f}\n", wait);
  return 0;
}

// --------------------------------------------------------------------------------------- collector

// Prints its id; once all is committed "RATE CPU_MS RSS_MB".
// @param start  the clock starts when this file appears; "": when a tenth is committed
int RunCollector(std::uint32_t domain, const Path& dataset, std::uint64_t total, const Path& folder,
                 const Path& start) {
  InstallStopSignals();
  const auto participant = Join(domain);
  campaign::CollectorOptions options;
  options.drain = 300ms;
  options.away = 0ms;  // paced senders go home without being told to
  auto collector = OrDie(campaign::Collector::Open(participant, BenchSpec(dataset, total), folder, options));
  fmt::print("{}\n", collector.id());
  std::fflush(stdout);
  std::thread running([&] {
    if (const Status ended = collector.Run(); !ended) Die(ended.error());
  });
  if (!start.empty()) AwaitStart(start);
  const double share = start.empty() ? kWarmUp : 0;
  const auto warm = static_cast<std::uint64_t>(share * static_cast<double>(total));
  const auto committed = [&] { return collector.progress().committed; };
  // asking costs the more the more workers there are: rarely, where that is what is compared
  const auto pause = start.empty() ? 2ms : 50ms;
  while (committed() < warm && !StopRequested()) std::this_thread::sleep_for(pause);
  const Stopwatch watch;
  const double cpu = CpuSeconds(RUSAGE_SELF);
  const std::uint64_t first = committed();
  while (committed() < total && !StopRequested()) std::this_thread::sleep_for(pause);
  const auto count = static_cast<double>(committed() - first);
  const double seconds = watch.Seconds();
  const double cpu_ms = 1e3 * (CpuSeconds(RUSAGE_SELF) - cpu) / count;
  running.join();
  fmt::print("{:.4f} {:.4f} {:.1f}\n", count / seconds, cpu_ms, PeakResidentMb());
  return 0;
}

// ------------------------------------------------------------------------------------------- floor

void WriteFile(const Path& path, std::span<const std::uint8_t> bytes) {
  const std::string temporary = path.string() + ".tmp";
  const int fd = ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  std::size_t done = 0;
  while (fd >= 0 && done < bytes.size()) {
    const ssize_t written = ::write(fd, bytes.data() + done, bytes.size() - done);
    if (written <= 0) Die(ErrnoError("write", path, errno));
    done += static_cast<std::size_t>(written);
  }
  if (fd < 0) Die(ErrnoError("create", path, errno));
  ::close(fd);
}

// Episodes a second of two threads that hash, write and rename, and fsync each 16 files and their folder.
double FloorRate(const std::vector<std::vector<std::uint8_t>>& blobs, const Path& folder, std::uint64_t total) {
  constexpr std::uint64_t kGroup = 16;
  std::atomic<std::uint64_t> next{0}, sink{0};
  const auto work = [&] {
    for (std::uint64_t begin = next.fetch_add(kGroup); begin < total; begin = next.fetch_add(kGroup)) {
      std::vector<Path> paths;
      for (std::uint64_t i = begin; i < std::min(begin + kGroup, total); ++i) {
        const auto& blob = blobs[i % blobs.size()];
        sink += Sha256Of(blob)[0];
        paths.push_back(folder / std::to_string(i));
        WriteFile(paths.back(), blob);
      }
      for (const auto& path : paths)
        if (const Status synced = SyncFile(path.string() + ".tmp"); !synced) Die(synced.error());
      for (const auto& path : paths) std::filesystem::rename(path.string() + ".tmp", path);
      if (const Status synced = SyncFolder(folder); !synced) Die(synced.error());
    }
  };
  const Stopwatch watch;
  {
    std::jthread other(work);
    work();
  }
  return static_cast<double>(total) / watch.Seconds();
}

// ------------------------------------------------------------------------------------------- bench

struct Figures {
  double rate = 0, collector_cpu_ms = 0, senders_cpu_ms = 0, lease_p50_ms = 0, lease_p99_ms = 0, rss_mb = 0;
};

double At(const std::vector<double>& sorted, double share) {
  if (sorted.empty()) return 0;
  const auto last = static_cast<double>(sorted.size() - 1);
  return sorted[static_cast<std::size_t>(share * last)];
}

// Milliseconds, a line each.
void TakeWaits(const std::string& text, std::vector<double>& waits) {
  for (const char* at = text.c_str(); *at != '\0';) {
    char* end = nullptr;
    waits.push_back(std::strtod(at, &end));
    if (end == at) break;
    at = *end == '\0' ? end : end + 1;
  }
}

struct Bench {
  std::uint64_t total;
  Path dataset;
  std::uint32_t domain;

  std::vector<std::string> Role(const char* role, const std::string& last) const {
    return Self({role, std::to_string(domain), dataset.string(), std::to_string(total), last});
  }

  Figures Run(int senders, const Path& folder) const {
    Figures figures;
    Child collector(Role("collector", folder.string()));
    const std::string id = collector.ReadLine();
    const double cpu = ChildrenCpuSeconds();
    std::vector<double> waits;
    {
      std::vector<std::unique_ptr<Child>> sending;
      for (int i = 0; i < senders; ++i) sending.push_back(std::make_unique<Child>(Role("sender", id)));
      for (auto& sender : sending) TakeWaits(sender->ReadAll(), waits);
    }
    figures.senders_cpu_ms = 1e3 * (ChildrenCpuSeconds() - cpu) / static_cast<double>(total);
    const std::string line = collector.ReadAll();
    std::sscanf(line.c_str(), "%lf %lf %lf", &figures.rate, &figures.collector_cpu_ms, &figures.rss_mb);
    std::sort(waits.begin(), waits.end());
    figures.lease_p50_ms = At(waits, 0.5);
    figures.lease_p99_ms = At(waits, 0.99);
    return figures;
  }
};

// A folder of its own below `parent`, gone with this.
class Scratch {
 public:
  explicit Scratch(const Path& parent) : path_(parent / fmt::format("etude-test-{}-bench-{}", ::getpid(), made_++)) {
    if (const Status made = MakeFolders(path_); !made) Die(made.error());
  }
  ~Scratch() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  Path operator/(const std::string& name) const { return path_ / name; }
  const Path& path() const { return path_; }

 private:
  static inline int made_ = 0;  // two of them below one parent are two folders
  Path path_;
};

bool MeasureOn(const char* where, const Path& parent, const Bench& bench,
               const std::vector<std::vector<std::uint8_t>>& blobs) {
  bool good = true;
  for (const int senders : {1, 2, 4}) {
    double floor = 0;
    {
      const Scratch scratch(parent);
      floor = FloorRate(blobs, scratch.path(), bench.total);
    }
    const Scratch scratch(parent);
    const Figures figures = bench.Run(senders, scratch / "data");
    if (figures.rate <= 0) {
      fmt::print(stderr, "collector_{}_{}: the collector committed nothing\n", where, senders);
      good = false;
      continue;
    }
    const auto round = [](double value) { return std::round(value * 1000) / 1000; };
    fmt::print("{}\n", OrderedJson{{"name", fmt::format("collector_{}_{}", where, senders)},
                                   {"value", round(figures.rate)},
                                   {"unit", "episodes/s"},
                                   {"baseline", round(floor)},
                                   {"ratio", round(figures.rate / floor)},
                                   {"collector_cpu_ms", round(figures.collector_cpu_ms)},
                                   {"senders_cpu_ms", round(figures.senders_cpu_ms)},
                                   {"lease_p50_ms", round(figures.lease_p50_ms)},
                                   {"lease_p99_ms", round(figures.lease_p99_ms)},
                                   {"rss_mb", round(figures.rss_mb)}}
                           .dump());
    std::fflush(stdout);
  }
  return good;
}

// Where nobody named any: what the quickstart collects.
Path CollectSome(const Path& folder, std::uint32_t domain) {
  Child collect({(ProgramsFolder() / "etude").string(), "collect", "deploy/campaigns/quickstart.yaml", "--episodes",
                 std::to_string(kReplayed), "--domain", std::to_string(domain), "--out",
                 (folder / "replayed").string()});
  (void)collect.ReadAll();
  return folder / "replayed";
}

// Until these have found each other: a hundred of them keep two cores busy for a minute. More than an interval of
// discovery in which they took less than a third of a core together, or 0.8 % each: what heartbeats and being there
// cost.
void AwaitQuiet(const std::vector<std::unique_ptr<Child>>& children) {
  constexpr auto kWindow = 8s;
  constexpr double kQuietEach = 0.008, kMostSeconds = 240;
  const double quiet = std::max(0.33, kQuietEach * static_cast<double>(children.size()));
  const auto cpu = [&] {
    double seconds = 0;
    for (const auto& child : children) seconds += CpuSecondsOf(child->pid());
    return seconds;
  };
  for (const Stopwatch watch; watch.Seconds() < kMostSeconds && !StopRequested();) {
    const double before = cpu();
    std::this_thread::sleep_for(kWindow);
    if (cpu() - before < quiet * std::chrono::duration<double>(kWindow).count()) return;
  }
  fmt::print(stderr, "{} processes are busy with each other after {:.0f} s: figures that follow have a part of it\n",
             children.size(), kMostSeconds);
}

// `senders` workers in `processes` processes, 20 episodes a second of all together.
Figures RunPacedOnce(const Bench& bench, int senders, int processes, const Path& parent) {
  const Scratch scratch(parent);
  const Path start = scratch / "start";
  Figures figures;
  auto words = bench.Role("collector", (scratch / "data").string());
  words.push_back(start.string());
  Child collector(std::move(words));
  const std::string id = collector.ReadLine();
  const double cpu = ChildrenCpuSeconds();
  std::vector<double> waits;
  {
    std::vector<std::unique_ptr<Child>> sending;
    const int each = senders / processes;
    for (int p = 0; p < processes; ++p) {
      auto role = bench.Role("paced-sender", id);
      for (const int number : {p * each, each, senders}) role.push_back(std::to_string(number));
      role.push_back(start.string());
      sending.push_back(std::make_unique<Child>(std::move(role)));
    }
    for (const auto& child : sending)
      if (child->ReadLine() != "ready") Die({Code::kUnavailable, "a paced sender did not find the collector"});
    AwaitQuiet(sending);  // what it costs to be found is another bench's matter
    if (const Status started = WriteFileAtomically(start, std::string_view("go\n")); !started) Die(started.error());
    for (const auto& child : sending) TakeWaits(child->ReadAll(), waits);
  }
  figures.senders_cpu_ms = 1e3 * (ChildrenCpuSeconds() - cpu) / static_cast<double>(bench.total);
  std::sscanf(collector.ReadAll().c_str(), "%lf %lf %lf", &figures.rate, &figures.collector_cpu_ms, &figures.rss_mb);
  std::sort(waits.begin(), waits.end());
  figures.lease_p50_ms = At(waits, 0.5);
  figures.lease_p99_ms = At(waits, 0.99);
  return figures;
}

struct Crowd {
  const char* name;
  int senders, processes;
  std::vector<double> cpu_ms = {}, rate = {}, p99_ms = {};
};

int RunPacedBench(std::uint64_t total, Path dataset, const Path& tmpfs, std::uint32_t domain) {
  UseProfile("deploy/dds/local.xml");
  const double calibration_before = TwoProcessSpin();
  const Scratch made(std::filesystem::temp_directory_path());
  if (dataset.empty()) dataset = CollectSome(made.path(), domain);
  constexpr std::uint64_t kMostSenders = 100;
  const Bench bench{(total + kMostSenders - 1) / kMostSenders * kMostSenders, dataset, domain};
  Crowd crowds[] = {{"processes_2", 2, 2}, {"processes_100", 100, 100}, {"agents_4x25", 100, 4}};
  constexpr int kRounds = 2;
  for (int round = 0; round < kRounds; ++round) {
    for (Crowd& crowd : crowds) {
      const Figures figures = RunPacedOnce(bench, crowd.senders, crowd.processes, tmpfs);
      crowd.cpu_ms.push_back(figures.collector_cpu_ms);
      crowd.rate.push_back(figures.rate);
      crowd.p99_ms.push_back(figures.lease_p99_ms);
      fmt::print(
          stderr, "{}, round {}: {:.1f}/s, collector {:.2f} ms, senders {:.2f} ms an episode, lease p99 {:.1f} ms\n",
          crowd.name, round + 1, figures.rate, figures.collector_cpu_ms, figures.senders_cpu_ms, figures.lease_p99_ms);
    }
  }
  PrintCalibration(calibration_before, TwoProcessSpin());
  const double few = Median(crowds[0].cpu_ms);
  const auto rounded = [](double value) { return std::round(value * 1000) / 1000; };
  bool good = few > 0;
  for (const Crowd& crowd : crowds) {
    good = good && Median(crowd.cpu_ms) > 0;
    fmt::print("{}\n", OrderedJson{{"name", fmt::format("collector_paced_{}", crowd.name)},
                                   {"value", rounded(Median(crowd.cpu_ms))},
                                   {"unit", "ms/episode"},
                                   {"baseline", rounded(few)},
                                   {"ratio", rounded(Median(crowd.cpu_ms) / few)},
                                   {"rate", rounded(Median(crowd.rate))},
                                   {"lease_p99_ms", rounded(Median(crowd.p99_ms))}}
                           .dump());
  }
  return good ? 0 : 1;
}

int RunBench(std::uint64_t total, Path dataset, const Path& tmpfs, const Path& disk, std::uint32_t domain) {
  UseProfile("deploy/dds/local.xml");
  const double calibration_before = TwoProcessSpin();
  const Scratch scratch(disk);
  if (dataset.empty()) dataset = CollectSome(scratch.path(), domain);
  std::vector<std::vector<std::uint8_t>> blobs;
  std::size_t bytes = 0;
  for (const Episode& episode : RealEpisodes(dataset)) bytes += blobs.emplace_back(EncodeEpisode(episode)).size();
  fmt::print(stderr, "{} episodes of {:.2f} MB on average are replayed\n", blobs.size(),
             1e-6 * static_cast<double>(bytes) / static_cast<double>(blobs.size()));
  const Bench bench{total, dataset, domain};
  const bool good = MeasureOn("tmpfs", tmpfs, bench, blobs) && MeasureOn("disk", disk, bench, blobs);
  PrintCalibration(calibration_before, TwoProcessSpin());
  return good ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  const auto argument = [&](int i, const char* otherwise) { return std::string(argc > i ? argv[i] : otherwise); };
  const auto number = [&](int i, const char* otherwise) {
    return std::strtoull(argument(i, otherwise).c_str(), nullptr, 10);
  };
  if (argc == 6 && std::strcmp(argv[1], "sender") == 0)
    return RunSender(static_cast<std::uint32_t>(number(2, "")), argv[3], number(4, ""), argv[5]);
  if ((argc == 6 || argc == 7) && std::strcmp(argv[1], "collector") == 0)
    return RunCollector(static_cast<std::uint32_t>(number(2, "")), argv[3], number(4, ""), argv[5], argument(6, ""));
  if (argc == 10 && std::strcmp(argv[1], "paced-sender") == 0) {
    const Pace pace{.first = std::atoi(argv[6]),
                    .count = std::atoi(argv[7]),
                    .all = std::max(1, std::atoi(argv[8])),
                    .each = number(4, "") / std::max<std::uint64_t>(1, number(8, "1")),
                    .start = argv[9]};
    return RunPacedSenders(static_cast<std::uint32_t>(number(2, "")), argv[3], number(4, ""), argv[5], pace);
  }
  if (argc > 1 && std::strcmp(argv[1], "paced") == 0)
    return RunPacedBench(number(2, "600"), argument(3, ""), argument(4, "/dev/shm"),
                         static_cast<std::uint32_t>(number(5, "75")));
  return RunBench(std::max<std::uint64_t>(20, number(1, "300")), argument(2, ""), argument(3, "/dev/shm"),
                  argument(4, std::filesystem::temp_directory_path().c_str()),
                  static_cast<std::uint32_t>(number(5, "75")));
}
