// SPDX-License-Identifier: Apache-2.0
// Tests services/campaign/collector.cc and worker_client.cc over a real bus, with worker processes that are
// killed.
#include "services/campaign/collector.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <atomic>
#include <functional>
#include <thread>

#include "services/bus/object_channel.h"
#include "services/bus/topic.h"
#include "services/campaign/process.h"
#include "services/core/clock.h"
#include "services/core/rng.h"
#include "services/store/dataset.h"
#include "tests/services/campaign/fake_work.h"
#include "tests/support/temporary_folder.h"

namespace etude::campaign {
namespace {

using namespace std::chrono_literals;

constexpr std::uint32_t kDomain = 80;

CampaignSpec Spec(const std::string& name, std::uint64_t episodes) {
  CampaignSpec spec = SyntheticSpec();
  spec.name = name + "-" + std::to_string(::getpid());
  spec.episodes = episodes;
  spec.max_attempts = 100;
  return spec;
}

CollectorOptions QuickOptions() {
  CollectorOptions options;
  options.lease = 3s;
  options.status_every = 100ms;
  options.retry_commit = 50ms;
  options.master_every = 500ms;
  return options;
}

bool WaitFor(const std::function<bool()>& condition, std::chrono::milliseconds timeout = 60s) {
  const auto deadline = MonotonicClock::now() + timeout;
  while (MonotonicClock::now() < deadline) {
    if (condition()) return true;
    std::this_thread::sleep_for(5ms);
  }
  return condition();
}

Process StartWorker(const CampaignSpec& spec, const Path& log, int ms_per_attempt,
                    const std::string& version = Version()) {
  auto process = Process::Start({{(ProgramFolder() / "fake_worker").string(), spec.name, std::to_string(kDomain),
                                  std::to_string(ms_per_attempt), version},
                                 log});
  EXPECT_TRUE(process) << (process ? "" : process.error().message);
  return std::move(*process);
}

// A collector on a thread of its own.
class Running {
 public:
  explicit Running(Collector collector)
      : collector_(std::move(collector)), thread_([this] { status_ = collector_.Run(); }) {}
  ~Running() { Stop(); }
  void Stop() {
    collector_.Stop();
    Join();
  }
  void Join() {
    if (thread_.joinable()) thread_.join();
  }
  Collector& operator*() { return collector_; }
  Collector* operator->() { return &collector_; }
  const Status& status() const { return status_; }

 private:
  Collector collector_;
  Status status_;
  std::thread thread_;
};

class CollectorTest : public testing::Test {
 protected:
  void SetUp() override {
    auto opened = bus::Participant::Open({kDomain, ""});
    ASSERT_TRUE(opened) << opened.error().message;
    participant_ = std::make_unique<bus::Participant>(std::move(*opened));
  }
  Result<Collector> Open(const CampaignSpec& spec, const Path& folder) {
    return Collector::Open(*participant_, spec, folder, QuickOptions());
  }

  // what must be in the folder at the end, whoever made it
  void ExpectWhole(const CampaignSpec& spec, const Path& dataset) {
    const auto reader = store::DatasetReader::Open(dataset);
    ASSERT_TRUE(reader) << reader.error().message;
    const auto indices = reader->List();
    ASSERT_TRUE(indices);
    ASSERT_EQ(indices->size(), spec.episodes) << "nothing lost";
    for (const std::uint64_t index : *indices) {
      const auto record = reader->Read(index);
      ASSERT_TRUE(record) << record.error().message;
      EXPECT_EQ(record->episode.attempt, FakeCommittedAttempt(index)) << index;
    }
    const auto report = store::Verify(dataset, store::Quarantine::kNo);
    ASSERT_TRUE(report);
    EXPECT_EQ(report->good, spec.episodes);
    EXPECT_TRUE(report->bad.empty());
  }

  std::unique_ptr<bus::Participant> participant_;
  TemporaryFolder folder_;
};

TEST_F(CollectorTest, OneWorkerCompletesACampaign) {
  const CampaignSpec spec = Spec("one", 8);
  auto collector = Open(spec, folder_ / "data");
  ASSERT_TRUE(collector) << collector.error().message;
  Running running(std::move(*collector));
  Process worker = StartWorker(spec, folder_ / "w.log", 5);

  running.Join();

  EXPECT_TRUE(running.status());
  const auto progress = running->progress();
  EXPECT_TRUE(progress.complete);
  std::uint64_t failed = 0;
  for (std::uint64_t i = 0; i < spec.episodes; ++i) failed += FakeCommittedAttempt(i);
  EXPECT_EQ(progress.attempts, spec.episodes + failed);
  EXPECT_EQ(progress.failures.at("plan_failed"), failed);
  ExpectWhole(spec, folder_ / "data");
  EXPECT_TRUE(std::filesystem::exists(folder_ / "data/dataset.hdf5"));
  const auto code = worker.Wait(10s);
  EXPECT_EQ(code, 0) << "the worker goes home by itself\n" << ReadTextFile(folder_ / "w.log").value_or("");
}

TEST_F(CollectorTest, KilledWorkersLoseAndDoubleNothing) {
  const CampaignSpec spec = Spec("kill", 40);
  std::string expected;
  {
    Running running(std::move(*Open(spec, folder_ / "calm")));
    Process worker = StartWorker(spec, folder_ / "calm.log", 0);
    running.Join();
    expected = store::HashDataset(folder_ / "calm").value();
  }
  auto collector = Open(spec, folder_ / "data");
  ASSERT_TRUE(collector) << collector.error().message;
  Running running(std::move(*collector));
  std::vector<Process> workers;
  for (int k = 0; k < 3; ++k) workers.push_back(StartWorker(spec, folder_ / "w.log", 30));
  Rng rng(7);
  int kills = 0;
  while (!running->progress().complete) {
    WaitFor([&] { return running->progress().complete; }, std::chrono::milliseconds(100 + rng.Below(400)));
    if (kills >= 12) continue;
    Process& victim = workers[rng.Below(workers.size())];
    victim.Signal(SIGKILL);
    victim.Wait(5s);
    victim = StartWorker(spec, folder_ / "w.log", 30);
    ++kills;
  }
  running.Join();

  EXPECT_GE(kills, 3);
  ExpectWhole(spec, folder_ / "data");
  EXPECT_EQ(store::HashDataset(folder_ / "data").value(), expected);
}

TEST_F(CollectorTest, RestartedCollectorContinuesWithTheSameWorkers) {
  const CampaignSpec spec = Spec("restart", 30);
  Process worker_a = StartWorker(spec, folder_ / "a.log", 20);
  Process worker_b = StartWorker(spec, folder_ / "b.log", 20);
  std::uint64_t before = 0;
  for (int life = 0; life < 3; ++life) {
    auto collector = Open(spec, folder_ / "data");
    ASSERT_TRUE(collector) << collector.error().message;
    Running running(std::move(*collector));
    if (life == 2) {
      running.Join();
    } else {
      ASSERT_TRUE(WaitFor([&] { return running->progress().committed >= before + 5; }));
      running.Stop();
      before = running->progress().committed;
    }
  }
  ExpectWhole(spec, folder_ / "data");
  EXPECT_EQ(OrderedJson::parse(ReadTextFile(folder_ / "data/collector.json").value())["epoch"], 3);
  EXPECT_EQ(worker_a.Wait(10s), 0);
  EXPECT_EQ(worker_b.Wait(10s), 0);
}

TEST_F(CollectorTest, WorkersOfAnotherVersionAreRefusedWithTheReason) {
  const CampaignSpec spec = Spec("version", 4);
  auto collector = Open(spec, folder_ / "data");
  ASSERT_TRUE(collector);
  Running running(std::move(*collector));
  Process worker = StartWorker(spec, folder_ / "w.log", 5, "0.0.9");

  EXPECT_EQ(worker.Wait(20s), kExitMachine);
  const std::string log = ReadTextFile(folder_ / "w.log").value_or("");
  EXPECT_NE(log.find("0.0.9"), std::string::npos) << log;
  EXPECT_NE(log.find("install the same version"), std::string::npos) << log;
  EXPECT_EQ(running->progress().committed, 0u);
}

TEST_F(CollectorTest, ASecondCollectorOfTheSameCampaignIsRefused) {
  const CampaignSpec spec = Spec("twice", 4);
  auto collector = Open(spec, folder_ / "data");
  ASSERT_TRUE(collector);
  Running running(std::move(*collector));
  auto statuses = bus::Reader<bus::CampaignStatus>::Open(*participant_, spec.name);
  ASSERT_TRUE(statuses);
  ASSERT_TRUE(WaitFor([&] { return !statuses->Take().empty(); }));

  const auto second = Open(spec, folder_ / "other");
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().code, Code::kUnavailable);
  EXPECT_NE(second.error().message.find("another collector"), std::string::npos) << second.error().message;
}

TEST_F(CollectorTest, TerminatedWorkerHandsItsWorkBack) {
  const CampaignSpec spec = Spec("drain", 4);
  auto collector = Open(spec, folder_ / "data");
  ASSERT_TRUE(collector);
  Running running(std::move(*collector));
  Process worker = StartWorker(spec, folder_ / "w.log", 3'600'000);
  ASSERT_TRUE(WaitFor([&] { return running->progress().workers == 1; }));
  auto statuses = bus::Reader<bus::WorkerStatus>::Open(*participant_, spec.name);
  ASSERT_TRUE(statuses);
  ASSERT_TRUE(WaitFor([&] {
    for (const auto& status : statuses->Take())
      if (status.token != 0) return true;
    return false;
  }));

  EXPECT_EQ(worker.Stop(5s), 0) << ReadTextFile(folder_ / "w.log").value_or("");
  Process other = StartWorker(spec, folder_ / "o.log", 0);
  running.Join();
  EXPECT_EQ(running->progress().lost_leases, 0u);
  ExpectWhole(spec, folder_ / "data");
}

// A sink whose disk is full for a while.
class FullDiskSink : public EpisodeSink {
 public:
  FullDiskSink(std::unique_ptr<EpisodeSink> inner, std::atomic<bool>& full) : inner_(std::move(inner)), full_(full) {}
  const Path& folder() const override { return inner_->folder(); }
  const std::set<std::uint64_t>& committed() const override { return inner_->committed(); }
  Status Commit(const Episode& episode) override {
    if (full_) return Fail(Code::kUnavailable, "write 'x': No space left on device");
    return inner_->Commit(episode);
  }
  Status RecordFailure(std::uint64_t index, std::uint32_t attempt, const std::string& outcome,
                       const std::string& details_json) override {
    return inner_->RecordFailure(index, attempt, outcome, details_json);
  }
  Status WriteMaster() override { return inner_->WriteMaster(); }

 private:
  std::unique_ptr<EpisodeSink> inner_;
  std::atomic<bool>& full_;
};

TEST_F(CollectorTest, FullDiskWaitsSaysSoAndResumesByItself) {
  const CampaignSpec spec = Spec("full", 6);
  std::atomic<bool> full{true};
  auto sink = OpenDatasetSink(folder_ / "data", spec);
  ASSERT_TRUE(sink) << sink.error().message;
  auto collector =
      Collector::Open(*participant_, spec, std::make_unique<FullDiskSink>(std::move(*sink), full), QuickOptions());
  ASSERT_TRUE(collector) << collector.error().message;
  auto statuses = bus::Reader<bus::CampaignStatus>::Open(*participant_, spec.name);
  ASSERT_TRUE(statuses);
  auto workers = bus::Reader<bus::WorkerStatus>::Open(*participant_, spec.name);
  ASSERT_TRUE(workers);
  Running running(std::move(*collector));
  Process worker = StartWorker(spec, folder_ / "w.log", 0);

  ASSERT_TRUE(WaitFor([&] {
    for (const auto& status : statuses->Take())
      if (status.error.find("No space left") != std::string::npos) return true;
    return false;
  })) << "the status names the error";
  // longer than a lease: the worker waits in its send and keeps its lease by heartbeats
  std::this_thread::sleep_for(4s);
  EXPECT_EQ(running->progress().committed, 0u);
  EXPECT_EQ(running->progress().lost_leases, 0u);
  for (const auto& status : workers->Take()) EXPECT_EQ(status.episodes, 0u) << "nothing was acknowledged";

  full = false;
  running.Join();
  EXPECT_TRUE(running->progress().error.empty());
  ExpectWhole(spec, folder_ / "data");
}

// A worker by hand, to say things that a good one does not.
class RawWorker {
 public:
  RawWorker(const bus::Participant& participant, const CampaignSpec& spec, const std::string& name,
            const std::string& files_sha256 = "")
      : spec_(spec),
        name_(name),
        files_sha256_(files_sha256),
        requests_(std::move(*bus::Writer<bus::WorkRequest>::Open(participant, spec.name))),
        leases_(std::move(*bus::Reader<bus::Lease>::Open(participant, spec.name))),
        sender_(std::move(*bus::ObjectSender::Open(participant, spec.name, "episode", name))) {}

  bus::Lease Ask() {
    for (int i = 0; i < 5; ++i) {
      (void)requests_.Write({spec_.name, name_, ++id_, Version(), files_sha256_});
      // answers to what was asked before come late on a busy machine: only this one counts
      for (const auto deadline = std::chrono::steady_clock::now() + 2s; std::chrono::steady_clock::now() < deadline;) {
        leases_.Wait(200ms);
        for (const auto& lease : leases_.Take())
          if (lease.worker == name_ && lease.request_id == id_) return lease;
      }
    }
    ADD_FAILURE() << "no answer";
    return {};
  }
  bus::Verdict Send(const bus::Lease& lease, const Episode& episode) {
    auto verdict = sender_.Send(++object_, EncodeEpisode(episode), lease.token, "{}", 20s);
    EXPECT_TRUE(verdict) << (verdict ? "" : verdict.error().message);
    return verdict.value_or(bus::Verdict{bus::AckKind::kProgress, ""});
  }

 private:
  CampaignSpec spec_;
  std::string name_, files_sha256_;
  bus::Writer<bus::WorkRequest> requests_;
  bus::Reader<bus::Lease> leases_;
  bus::ObjectSender sender_;
  std::uint64_t id_ = 0, object_ = 0;
};

TEST_F(CollectorTest, OldTokensAreRefusedAndRepeatsAreDuplicates) {
  const CampaignSpec spec = Spec("token", 3);
  auto collector = Open(spec, folder_ / "data");
  ASSERT_TRUE(collector);
  Running running(std::move(*collector));
  RawWorker slow(*participant_, spec, "slow"), quick(*participant_, spec, "quick");

  const bus::Lease old = slow.Ask();  // and never a heartbeat
  ASSERT_EQ(old.kind, bus::LeaseKind::kWork);
  ASSERT_TRUE(WaitFor([&] { return running->progress().lost_leases == 1; }));
  bus::Lease lease = quick.Ask();
  // an index that lost a worker comes after those that did not
  while (lease.index != old.index) {
    EXPECT_EQ(quick.Send(lease, FakeEpisode(spec, lease.index, lease.attempt)).kind, bus::AckKind::kDone);
    lease = quick.Ask();
    ASSERT_EQ(lease.kind, bus::LeaseKind::kWork);
  }
  EXPECT_GT(lease.token, old.token);
  const Episode episode = FakeEpisode(spec, old.index, old.attempt);
  const bus::Verdict refused = slow.Send(old, episode);
  EXPECT_EQ(refused.kind, bus::AckKind::kRefused);
  EXPECT_NE(refused.reason.find("old"), std::string::npos) << refused.reason;
  EXPECT_EQ(quick.Send(lease, episode).kind, bus::AckKind::kDone);
  running->progress();
}

TEST_F(CollectorTest, WorkersWithOtherFilesOfTheUserAreRefusedAlsoAfterARestart) {
  const CampaignSpec spec = Spec("files", 3);
  for (int start = 0; start < 2; ++start) {
    auto collector = Open(spec, folder_ / "data");
    ASSERT_TRUE(collector) << collector.error().message;
    Running running(std::move(*collector));
    // names of their own: what was said to those before a restart is not heard again
    RawWorker same(*participant_, spec, fmt::format("same{}", start), "a"),
        other(*participant_, spec, fmt::format("other{}", start), "b");
    if (start == 0) {
      const bus::Lease lease = same.Ask();
      ASSERT_EQ(lease.kind, bus::LeaseKind::kWork);
      EXPECT_EQ(same.Send(lease, FakeEpisode(spec, lease.index, lease.attempt)).kind, bus::AckKind::kDone);
    }
    const bus::Lease refused = other.Ask();
    EXPECT_EQ(refused.kind, bus::LeaseKind::kRefused);
    EXPECT_NE(refused.reason.find("other robot or object files"), std::string::npos) << refused.reason;
    EXPECT_EQ(same.Ask().kind, bus::LeaseKind::kWork);
  }
}

TEST_F(CollectorTest, EpisodesThatDoNotFitAreRefusedWithTheReason) {
  const CampaignSpec spec = Spec("unfit", 2);
  auto collector = Open(spec, folder_ / "data");
  ASSERT_TRUE(collector);
  Running running(std::move(*collector));
  RawWorker worker(*participant_, spec, "raw");
  const bus::Lease lease = worker.Ask();
  const Episode good = FakeEpisode(spec, lease.index, lease.attempt);
  const auto expect_refused = [&](const char* what, const std::function<void(Episode&)>& change) {
    Episode bad = good;
    change(bad);
    const bus::Verdict verdict = worker.Send(lease, bad);
    EXPECT_EQ(verdict.kind, bus::AckKind::kRefused) << what;
    EXPECT_NE(verdict.reason.find(what), std::string::npos) << verdict.reason;
  };
  expect_refused("seed", [](Episode& episode) { ++episode.seed; });
  expect_refused("spec", [](Episode& episode) { episode.spec_sha256 = std::string(64, 'f'); });
  expect_refused("version", [](Episode& episode) { episode.version = "0.0.1"; });
  expect_refused("index", [](Episode& episode) { episode.index = 99; });
  expect_refused("campaign", [](Episode& episode) { episode.campaign = "other"; });
  expect_refused("outcome", [](Episode& episode) {
    episode.success = false;
    episode.outcome = "dropped";
  });
  EXPECT_EQ(running->progress().committed, 0u);
  EXPECT_EQ(running->progress().refused, 6u);

  EXPECT_EQ(worker.Send(lease, good).kind, bus::AckKind::kDone);
  EXPECT_EQ(running->progress().committed, 1u);
  EXPECT_EQ(worker.Send(lease, good).kind, bus::AckKind::kDuplicate);
}

}  // namespace
}  // namespace etude::campaign
