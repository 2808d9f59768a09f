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
#include <fcntl.h>
#include <fmt/format.h>

#include <atomic>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <thread>

#include "services/bus/blob_transfer.h"
#include "services/bus/topic.h"
#include "services/campaign/collector.h"
#include "services/core/hash.h"
#include "services/core/log.h"
#include "services/core/stop.h"
#include "services/episode/codec.h"
#include "services/spec/episode_plan.h"
#include "services/store/dataset.h"
#include "tests/bench/processes.h"

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
      : spec_(spec), sha256_(SpecHash(spec)), owner_{spec.name, id}, name_(std::move(name)) {
    requests_.emplace(OrDie(bus::Writer<bus::WorkRequest>::Open(participant, owner_.partition())));
    leases_.emplace(OrDie(bus::Reader<bus::Lease>::Open(participant, owner_.partition())));
    heartbeats_.emplace(OrDie(bus::Writer<bus::WorkerStatus>::Open(participant, owner_.partition())));
    sender_.emplace(OrDie(bus::BlobSender::Open(participant, owner_, "episode", name_)));
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
  std::string name_;
  std::optional<bus::Writer<bus::WorkRequest>> requests_;
  std::optional<bus::Reader<bus::Lease>> leases_;
  std::optional<bus::Writer<bus::WorkerStatus>> heartbeats_;
  std::optional<bus::BlobSender> sender_;
  std::uint64_t asked_ = 0, sent_ = 0;
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

// --------------------------------------------------------------------------------------- collector

// Prints its id; once all is committed "RATE CPU_MS RSS_MB".
int RunCollector(std::uint32_t domain, const Path& dataset, std::uint64_t total, const Path& folder) {
  InstallStopSignals();
  const auto participant = Join(domain);
  campaign::CollectorOptions options;
  options.drain = 300ms;
  auto collector = OrDie(campaign::Collector::Open(participant, BenchSpec(dataset, total), folder, options));
  fmt::print("{}\n", collector.id());
  std::fflush(stdout);
  std::thread running([&] {
    if (const Status ended = collector.Run(); !ended) Die(ended.error());
  });
  const auto warm = static_cast<std::uint64_t>(kWarmUp * static_cast<double>(total));
  const auto committed = [&] { return collector.progress().committed; };
  while (committed() < warm && !StopRequested()) std::this_thread::sleep_for(2ms);
  const Stopwatch watch;
  const double cpu = CpuSeconds(RUSAGE_SELF);
  const std::uint64_t first = committed();
  while (committed() < total && !StopRequested()) std::this_thread::sleep_for(2ms);
  const auto count = static_cast<double>(committed() - first);
  const double seconds = watch.Seconds();
  const double cpu_ms = 1e3 * (CpuSeconds(RUSAGE_SELF) - cpu) / count;
  running.join();
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  fmt::print("{:.4f} {:.4f} {:.1f}\n", count / seconds, cpu_ms, static_cast<double>(usage.ru_maxrss) / 1024);
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
      for (auto& sender : sending) {
        const std::string text = sender->ReadAll();
        for (const char* at = text.c_str(); *at != '\0';) {
          char* end = nullptr;
          waits.push_back(std::strtod(at, &end));
          at = *end == '\0' ? end : end + 1;
        }
      }
    }
    figures.senders_cpu_ms = 1e3 * (ChildrenCpuSeconds() - cpu) / static_cast<double>(total);
    const std::string line = collector.ReadAll();
    std::sscanf(line.c_str(), "%lf %lf %lf", &figures.rate, &figures.collector_cpu_ms, &figures.rss_mb);
    std::sort(waits.begin(), waits.end());
    if (!waits.empty()) {
      figures.lease_p50_ms = waits[waits.size() / 2];
      figures.lease_p99_ms = waits[waits.size() * 99 / 100];
    }
    return figures;
  }
};

// A folder of its own below `parent`, gone with this.
class Scratch {
 public:
  explicit Scratch(const Path& parent) : path_(parent / fmt::format("etude-collector-bench-{}", ::getpid())) {
    if (const Status made = MakeFolders(path_); !made) Die(made.error());
  }
  ~Scratch() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  Path operator/(const std::string& name) const { return path_ / name; }
  const Path& path() const { return path_; }

 private:
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
    good = good && figures.rate > 0;
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
  const char* const program = std::getenv("ETUDE_BIN");
  Child collect({program != nullptr ? program : "build/bin/etude", "collect", "deploy/campaigns/quickstart.yaml",
                 "--episodes", std::to_string(kReplayed), "--domain", std::to_string(domain), "--out",
                 (folder / "replayed").string()});
  (void)collect.ReadAll();
  return folder / "replayed";
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
  if (argc == 6 && std::strcmp(argv[1], "collector") == 0)
    return RunCollector(static_cast<std::uint32_t>(number(2, "")), argv[3], number(4, ""), argv[5]);
  return RunBench(std::max<std::uint64_t>(20, number(1, "300")), argument(2, ""), argument(3, "/dev/shm"),
                  argument(4, std::filesystem::temp_directory_path().c_str()),
                  static_cast<std::uint32_t>(number(5, "75")));
}
