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
#include <map>
#include <stdexcept>
#include <thread>

#include "services/bus/blob_transfer.h"
#include "services/bus/directory.h"
#include "services/bus/topic.h"
#include "services/campaign/history.h"
#include "services/campaign/process.h"
#include "services/core/clock.h"
#include "services/core/command.h"
#include "services/core/identity.h"
#include "services/core/rng.h"
#include "services/store/commit_journal.h"
#include "services/store/dataset.h"
#include "tests/services/campaign/fake_work.h"
#include "tests/services/campaign/running_collector.h"
#include "tests/support/temporary_folder.h"

namespace etude::campaign {
namespace collector_test {

using namespace std::chrono_literals;

constexpr std::uint32_t kDomain = 80;

CampaignSpec Spec(const std::string& name, std::uint64_t episodes) {
  CampaignSpec spec = SyntheticSpec();
  spec.name = name + "-" + std::to_string(::getpid());
  spec.episodes = episodes;
  spec.max_attempts = 100;
  return spec;
}

// `campaign`: NAME or NAME@ID
Process StartWorkerOf(const std::string& campaign, const Path& log, int ms_per_attempt,
                      std::uint32_t content = kContentVersion) {
  auto process = Process::Start({{(ProgramFolder() / "fake_worker").string(), campaign, std::to_string(kDomain),
                                  std::to_string(ms_per_attempt), std::to_string(content)},
                                 log});
  EXPECT_TRUE(process) << (process ? "" : process.error().message);
  return std::move(*process);
}

Process StartWorker(const CampaignSpec& spec, const Path& log, int ms_per_attempt) {
  return StartWorkerOf(spec.name, log, ms_per_attempt);
}

class CollectorTest : public testing::Test {
 protected:
  void SetUp() override {
    auto opened = bus::Participant::Open({kDomain, ""});
    ASSERT_TRUE(opened) << opened.error().message;
    participant_ = std::make_unique<bus::Participant>(std::move(*opened));
  }
  Result<Collector> Open(const CampaignSpec& spec, const Path& folder, Claim claim = Claim::kRefuse) {
    CollectorOptions options = QuickOptions();
    options.claim = claim;
    return Collector::Open(*participant_, spec, folder, options);
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
  store::CommitTable commits(folder_ / "data");
  ASSERT_TRUE(commits.Refresh());
  ASSERT_EQ(commits.size(), spec.episodes);
  for (std::size_t row = 0; row < commits.size(); ++row) {
    EXPECT_EQ(commits.host().At(row), HostName());
    EXPECT_FALSE(commits.worker().At(row).empty());
    EXPECT_EQ(commits.timings()[row].plan_s, 0.25) << "beside the episode, not in it";
    EXPECT_GT(commits.timings()[row].wall_s, 0);
  }
  const std::string attempts = ReadTextFile(folder_ / "data/attempts.jsonl").value_or("");
  if (failed > 0) {
    const auto first = OrderedJson::parse(attempts.substr(0, attempts.find('\n')));
    EXPECT_FALSE(first["details"]["worker"].get<std::string>().empty());
    EXPECT_GT(first["details"]["t"].get<double>(), 1.6e9);
  }
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

TEST_F(CollectorTest, WorkersOfAnotherContentNumberAreRefusedWithTheReason) {
  const CampaignSpec spec = Spec("content", 4);
  auto collector = Open(spec, folder_ / "data");
  ASSERT_TRUE(collector);
  Running running(std::move(*collector));
  Process worker = StartWorkerOf(spec.name, folder_ / "w.log", 5, 977);

  EXPECT_EQ(worker.Wait(20s), kExitMachine);
  const std::string log = ReadTextFile(folder_ / "w.log").value_or("");
  EXPECT_NE(log.find("977"), std::string::npos) << log;
  EXPECT_NE(log.find("programs of the same content number"), std::string::npos) << log;
  EXPECT_EQ(running->progress().committed, 0u);
}

// Before ids: a second collector of the name was refused, or, unseen, leased side by side.
TEST_F(CollectorTest, ACopiedFolderIsRefusedUnlessItIsANewOneOrAdopts) {
  const CampaignSpec spec = Spec("copy", 4);
  auto collector = Open(spec, folder_ / "data");
  ASSERT_TRUE(collector);
  Running running(std::move(*collector));
  std::filesystem::copy(folder_ / "data", folder_ / "copy", std::filesystem::copy_options::recursive);
  std::filesystem::remove(folder_ / "copy/.lock");

  const auto refused = Open(spec, folder_ / "copy");
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, Code::kUnavailable);
  for (const std::string& text :
       {(folder_ / "data").string(), HostName(), std::string("--new-id"), std::string("--adopt")})
    EXPECT_NE(refused.error().message.find(text), std::string::npos) << refused.error().message;

  const std::string id = running->id();
  {
    auto renewed = Open(spec, folder_ / "copy", Claim::kNewId);
    ASSERT_TRUE(renewed) << renewed.error().message;
    EXPECT_NE(renewed->id(), id);
  }
  std::filesystem::copy(folder_ / "data/identity.json", folder_ / "copy/identity.json",
                        std::filesystem::copy_options::overwrite_existing);
  auto adopting = Open(spec, folder_ / "copy", Claim::kAdopt);
  ASSERT_TRUE(adopting) << adopting.error().message;
  EXPECT_EQ(adopting->id(), id);
  running.Join();
  ASSERT_FALSE(running.status()) << "the one whose place was taken ends, with words";
  EXPECT_EQ(running.status().error().code, Code::kUnavailable);
  EXPECT_NE(running.status().error().message.find((folder_ / "copy").string()), std::string::npos)
      << running.status().error().message;

  Running adopted(std::move(*adopting));
  Process worker = StartWorkerOf(spec.name + "@" + id, folder_ / "w.log", 0);
  adopted.Join();
  EXPECT_TRUE(adopted.status());
  ExpectWhole(spec, folder_ / "copy");
}

TEST_F(CollectorTest, TwoCampaignsOfANameDoNotMix) {
  const CampaignSpec one = Spec("same", 5);
  CampaignSpec other = one;
  other.seed = one.seed + 1;
  Running first(std::move(*Open(one, folder_ / "one")));
  Running second(std::move(*Open(other, folder_ / "other")));

  Process lost = StartWorkerOf(one.name, folder_ / "lost.log", 0);
  EXPECT_EQ(lost.Wait(20s), kExitUsage);
  const std::string list = ReadTextFile(folder_ / "lost.log").value_or("");
  for (const std::string& text : {one.name + "@" + first->id(), one.name + "@" + second->id(),
                                  (folder_ / "one").string(), (folder_ / "other").string()})
    EXPECT_NE(list.find(text), std::string::npos) << text << "\n" << list;

  Process a = StartWorkerOf(one.name + "@" + first->id(), folder_ / "a.log", 0);
  Process b = StartWorkerOf(one.name + "@" + second->id().substr(0, 8), folder_ / "b.log", 0);
  first.Join();
  second.Join();
  ExpectWhole(one, folder_ / "one");
  ExpectWhole(other, folder_ / "other");
  // each counts the failures of its own worker, and each once; a report that is on its way when its worker asks again
  // is sent twice, and the second is refused as late (`stale_results`): no sign of a mixture
  std::uint64_t failures = 0;
  for (std::uint64_t index = 0; index < one.episodes; ++index) failures += FakeCommittedAttempt(index);
  for (auto* running : {&first, &second}) {
    const CollectorProgress progress = (*running)->progress();
    EXPECT_EQ(progress.refused, 0u);
    EXPECT_EQ(progress.failures, (std::map<std::string, std::uint64_t>{{"plan_failed", failures}}));
  }
}

// It used to refuse the other folder's campaign for ever, because its epoch was smaller, and to make episode 0 of the
// old one again each second.
TEST_F(CollectorTest, AStandingWorkerGoesOnWithTheNextCampaignOfItsName) {
  const CampaignSpec old = Spec("standing", 1000);
  Process worker = StartWorker(old, folder_ / "w.log", 1);
  for (int start = 0; start < 3; ++start) {
    auto collector = Open(old, folder_ / "old");
    ASSERT_TRUE(collector) << collector.error().message;
    Running running(std::move(*collector));
    const auto before = running->progress().committed;
    ASSERT_TRUE(WaitFor([&] { return running->progress().committed > before; }));
  }
  EXPECT_EQ(LastEpoch(folder_ / "old").value(), 3u);

  CampaignSpec anew = old;
  anew.episodes = 6;
  anew.seed = old.seed + 1;
  Running running(std::move(*Open(anew, folder_ / "new")));
  running.Join();

  ExpectWhole(anew, folder_ / "new");
  EXPECT_EQ(running->progress().refused, 0u) << "nothing was made for the old spec";
  EXPECT_EQ(worker.Wait(10s), 0) << ReadTextFile(folder_ / "w.log").value_or("");
}

TEST_F(CollectorTest, TerminatedWorkerReleasesItsWork) {
  const CampaignSpec spec = Spec("drain", 4);
  auto collector = Open(spec, folder_ / "data");
  ASSERT_TRUE(collector);
  Running running(std::move(*collector));
  Process worker = StartWorker(spec, folder_ / "w.log", 3'600'000);
  ASSERT_TRUE(WaitFor([&] { return running->progress().workers == 1; }));
  auto statuses = bus::Reader<bus::WorkerStatus>::Open(*participant_, PartitionOf(running, spec));
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
  std::vector<Status> CommitGroup(std::span<const store::ArrivedEpisode> group) override {
    if (full_) return std::vector<Status>(group.size(), Fail(Code::kUnavailable, "write 'x': No space left on device"));
    return inner_->CommitGroup(group);
  }
  Status RecordFailure(std::uint64_t index, std::uint32_t attempt, const std::string& outcome,
                       const std::string& details_json) override {
    return inner_->RecordFailure(index, attempt, outcome, details_json);
  }
  Status WriteIndex() override { return inner_->WriteIndex(); }

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
  Running running(std::move(*collector));
  auto statuses = bus::Reader<bus::CampaignStatus>::Open(*participant_, PartitionOf(running, spec));
  ASSERT_TRUE(statuses);
  auto workers = bus::Reader<bus::WorkerStatus>::Open(*participant_, PartitionOf(running, spec));
  ASSERT_TRUE(workers);
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

// A worker's report may hold any bytes, and its outcome becomes a key of JSON.
TEST_F(CollectorTest, AnOutcomeOfAnyBytesIsCountedAndEndsNothing) {
  const CampaignSpec spec = Spec("bytes", 1);
  auto collector = Open(spec, folder_ / "data");
  ASSERT_TRUE(collector);
  Running running(std::move(*collector));
  RawWorker worker(*participant_, spec, running->id(), "worker", "files\xff");
  EXPECT_EQ(worker.Ask().kind, bus::LeaseKind::kRefused);
  worker.request.files_sha256.clear();
  bus::Lease lease = worker.Ask();
  ASSERT_EQ(lease.kind, bus::LeaseKind::kWork);
  worker.Report(lease, running->id(), SpecHash(spec), "\xff\xfe");
  ASSERT_TRUE(WaitFor([&] { return running->progress().failures.contains("unnamed"); }));
  // also where nothing is committed afterwards, what failed is in what is derived
  const auto in_index = [&] {
    const auto text = ReadTextFile(folder_ / "data/dataset.json");
    const auto json = OrderedJson::parse(text.value_or("{}"));
    return json.contains("statistics") && json["statistics"].contains("failed_attempts") &&
           json["statistics"]["failed_attempts"].contains("unnamed");
  };
  EXPECT_TRUE(WaitFor(in_index));
  EXPECT_EQ(worker.Ask().kind, bus::LeaseKind::kWork) << "it goes on";
}

// What a thread of the collector throws.
class ThrowingSink : public EpisodeSink {
 public:
  explicit ThrowingSink(std::unique_ptr<EpisodeSink> inner) : inner_(std::move(inner)) {}
  const Path& folder() const override { return inner_->folder(); }
  const std::set<std::uint64_t>& committed() const override { return inner_->committed(); }
  std::vector<Status> CommitGroup(std::span<const store::ArrivedEpisode>) override {
    throw std::runtime_error("out of paper");
  }
  Status RecordFailure(std::uint64_t, std::uint32_t, const std::string&, const std::string&) override { return {}; }
  Status WriteIndex() override { return inner_->WriteIndex(); }

 private:
  std::unique_ptr<EpisodeSink> inner_;
};

TEST_F(CollectorTest, WhatAThreadThrowsEndsItWithWords) {
  const CampaignSpec spec = Spec("throws", 2);
  auto sink = OpenSink(folder_ / "data", spec);
  ASSERT_TRUE(sink);
  auto collector =
      Collector::Open(*participant_, spec, std::make_unique<ThrowingSink>(std::move(*sink)), QuickOptions());
  ASSERT_TRUE(collector);
  Running running(std::move(*collector));
  auto sender = bus::BlobSender::Open(*participant_, {spec.name, running->id()}, "episode", "worker");
  ASSERT_TRUE(sender);
  RawWorker worker(*participant_, spec, running->id(), "asker");
  const bus::Lease lease = worker.Ask();
  ASSERT_EQ(lease.kind, bus::LeaseKind::kWork);
  (void)sender->Send(1, EncodeEpisode(FakeEpisode(spec, lease.index, lease.attempt)), lease.token, "{}", 2s);

  running.Join();

  ASSERT_FALSE(running.status());
  EXPECT_EQ(running.status().error().code, Code::kInternal);
  EXPECT_NE(running.status().error().message.find("commit thread failed: an exception: out of paper"),
            std::string::npos)
      << running.status().error().message;
}

TEST_F(CollectorTest, OnlyReportsOfThisCampaignAndSpecCount) {
  const CampaignSpec spec = Spec("report", 3);
  Running running(std::move(*Open(spec, folder_ / "data")));
  RawWorker worker(*participant_, spec, running->id(), "raw");
  const bus::Lease lease = worker.Ask();
  ASSERT_EQ(lease.kind, bus::LeaseKind::kWork);

  worker.Report(lease, running->id(), std::string(64, 'f'));
  worker.Report(lease, "ffffffffffffffff", SpecHash(spec));
  EXPECT_EQ(worker.Ask().token, lease.token) << "the reports before it were seen before the request";
  EXPECT_TRUE(running->progress().failures.empty());

  worker.Report(lease, running->id(), SpecHash(spec));
  EXPECT_GT(worker.Ask().token, lease.token);
  EXPECT_EQ(running->progress().failures.at("plan_failed"), 1u);
}

TEST_F(CollectorTest, WorkersThatAreReadyForAnotherSpecWaitAndThoseOfAnotherWireAreRefused) {
  const CampaignSpec spec = Spec("ready", 3);
  Running running(std::move(*Open(spec, folder_ / "data")));
  RawWorker unready(*participant_, spec, running->id(), "unready");
  unready.request.spec_sha256 = std::string(64, 'f');
  const bus::Lease wait = unready.Ask();
  EXPECT_EQ(wait.kind, bus::LeaseKind::kWait);
  EXPECT_EQ(wait.spec_sha256, SpecHash(spec));

  RawWorker old(*participant_, spec, running->id(), "old");
  old.request.wire = bus::kWireVersion - 1;
  const bus::Lease refused = old.Ask();
  EXPECT_EQ(refused.kind, bus::LeaseKind::kRefused);
  EXPECT_NE(refused.reason.find("wire number"), std::string::npos) << refused.reason;

  RawWorker newer(*participant_, spec, running->id(), "newer");
  newer.request.version = "99.0.0";
  EXPECT_EQ(newer.Ask().kind, bus::LeaseKind::kWork) << "the program's version does not matter";
}

TEST_F(CollectorTest, OldTokensAreRefusedAndRepeatsAreDuplicates) {
  const CampaignSpec spec = Spec("token", 3);
  auto collector = Open(spec, folder_ / "data");
  ASSERT_TRUE(collector);
  Running running(std::move(*collector));
  RawWorker slow(*participant_, spec, running->id(), "slow"), quick(*participant_, spec, running->id(), "quick");

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
  EXPECT_EQ(running->progress().stale_results, 1u);
}

TEST_F(CollectorTest, WorkersWithOtherFilesOfTheUserAreRefusedAlsoAfterARestart) {
  const CampaignSpec spec = Spec("files", 3);
  for (int start = 0; start < 2; ++start) {
    auto collector = Open(spec, folder_ / "data");
    ASSERT_TRUE(collector) << collector.error().message;
    Running running(std::move(*collector));
    // names of their own: what was said to those before a restart is not heard again
    RawWorker same(*participant_, spec, running->id(), fmt::format("same{}", start), "a"),
        other(*participant_, spec, running->id(), fmt::format("other{}", start), "b");
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

TEST_F(CollectorTest, HostsWhoseBytesDifferFromTheFirstOnesAreRefusedUnlessTheCampaignAllowsThem) {
  CampaignSpec spec = Spec("hosts", 4);
  const auto refused_at_start = [&](int start, const char* determinism) {
    spec.determinism = determinism;
    auto collector = Open(spec, folder_ / "data");
    if (!collector) return collector.error().message;
    Running running(std::move(*collector));
    RawWorker same(*participant_, spec, running->id(), fmt::format("same{}", start)),
        other(*participant_, spec, running->id(), fmt::format("other{}", start)),
        silent(*participant_, spec, running->id(), fmt::format("silent{}", start));
    same.request.fingerprint_json = R"({"picture": "aa", "physics": "cc"})";
    other.request.fingerprint_json = R"({"picture": "bb", "physics": "cc"})";
    const bus::Lease lease = same.Ask();
    EXPECT_EQ(lease.kind, bus::LeaseKind::kWork);
    EXPECT_EQ(same.Send(lease, FakeEpisode(spec, lease.index, lease.attempt)).kind, bus::AckKind::kDone);
    EXPECT_NE(silent.Ask().kind, bus::LeaseKind::kRefused) << "an older program does not say it";
    return other.Ask().reason;
  };
  EXPECT_NE(refused_at_start(0, "bytes").find("picture: here aa, there bb"), std::string::npos);
  EXPECT_EQ(refused_at_start(1, "physics"), "") << "pictures may differ; and the dataset goes on";
  EXPECT_NE(refused_at_start(2, "bytes").find("picture: here aa, there bb"), std::string::npos) << "remembered";
}

TEST_F(CollectorTest, EpisodesThatDoNotFitAreRefusedWithTheReasonAndCostTheIndexNothing) {
  CampaignSpec spec = Spec("unfit", 2);
  spec.max_attempts = 2;
  CollectorOptions options = QuickOptions();
  options.unfit_budget = 7;
  Running running(std::move(*Collector::Open(*participant_, spec, folder_ / "data", options)));
  RawWorker worker(*participant_, spec, running->id(), "raw");
  std::uint64_t last_token = 0;
  const auto expect_refused = [&](const char* what, const std::function<void(Episode&)>& change) {
    const bus::Lease lease = worker.Ask();
    EXPECT_EQ(lease.attempt, 0u) << "which attempt is committed does not depend on a worker's mistake";
    EXPECT_GT(lease.token, last_token) << "what was refused is not leased on";
    last_token = lease.token;
    Episode bad = FakeEpisode(spec, lease.index, lease.attempt);
    change(bad);
    const bus::Verdict verdict = worker.Send(lease, bad);
    EXPECT_EQ(verdict.kind, bus::AckKind::kRefused) << what;
    EXPECT_NE(verdict.reason.find(what), std::string::npos) << verdict.reason;
  };
  expect_refused("seed", [](Episode& episode) { ++episode.seed; });
  expect_refused("spec", [](Episode& episode) { episode.spec_sha256 = std::string(64, 'f'); });
  expect_refused("content number", [](Episode& episode) { episode.version = "0.0.1"; });
  expect_refused("index", [](Episode& episode) { episode.index = 99; });
  expect_refused("campaign", [](Episode& episode) { episode.campaign = "other"; });
  expect_refused("outcome", [](Episode& episode) {
    episode.success = false;
    episode.outcome = "dropped";
  });
  EXPECT_EQ(running->progress().committed, 0u);
  EXPECT_EQ(running->progress().refused, 6u);

  bus::Lease lease = worker.Ask();
  const Episode good = FakeEpisode(spec, lease.index, lease.attempt);
  EXPECT_EQ(worker.Send(lease, good).kind, bus::AckKind::kDone);
  EXPECT_EQ(running->progress().committed, 1u);
  EXPECT_EQ(worker.Send(lease, good).kind, bus::AckKind::kDuplicate);

  // a worker that goes on like this is sent away with the reason, and another one makes the same attempt
  for (int k = 0; k < options.unfit_budget; ++k) {
    lease = worker.Ask();
    ASSERT_EQ(lease.kind, bus::LeaseKind::kWork) << k << ": what fitted before began a new count";
    EXPECT_EQ(lease.attempt, 0u);
    Episode bad = FakeEpisode(spec, lease.index, lease.attempt);
    ++bad.seed;
    EXPECT_EQ(worker.Send(lease, bad).kind, bus::AckKind::kRefused);
  }
  const bus::Lease away = worker.Ask();
  EXPECT_EQ(away.kind, bus::LeaseKind::kRefused);
  EXPECT_NE(away.reason.find("did not fit"), std::string::npos) << away.reason;
  EXPECT_NE(away.reason.find("seed"), std::string::npos) << away.reason;
  RawWorker other(*participant_, spec, running->id(), "other");
  lease = other.Ask();
  ASSERT_EQ(lease.kind, bus::LeaseKind::kWork);
  EXPECT_EQ(lease.attempt, 0u);
  EXPECT_EQ(other.Send(lease, FakeEpisode(spec, lease.index, 0)).kind, bus::AckKind::kDone);
  EXPECT_EQ(other.Ask().kind, bus::LeaseKind::kDone);
  EXPECT_EQ(running->progress().given_up, 0u);
}

// A heartbeat said again and again by hand.
class Beating {
 public:
  Beating(const bus::Participant& participant, Running& running, const CampaignSpec& spec, const bus::Lease& lease,
          const std::string& worker)
      : writer_(std::move(*bus::Writer<bus::WorkerStatus>::Open(participant, PartitionOf(running, spec)))) {
    status_.campaign = spec.name;
    status_.campaign_id = running->id();
    status_.worker = worker;
    status_.index = lease.index;
    status_.attempt = lease.attempt;
    status_.token = lease.token;
    status_.phase = "play";
    status_.stage = "reach";
  }
  void Beat(std::uint32_t step) {
    status_.step = step;
    EXPECT_TRUE(writer_.Write(status_));
  }

 private:
  bus::Writer<bus::WorkerStatus> writer_;
  bus::WorkerStatus status_;
};

TEST_F(CollectorTest, AWorkerThatBeatsAndDoesNotMoveLosesItsLease) {
  CampaignSpec spec = Spec("stall", 2);
  spec.stall_timeout_s = 1;
  Running running(std::move(*Open(spec, folder_ / "data")));
  RawWorker hung(*participant_, spec, running->id(), "hung"), moving(*participant_, spec, running->id(), "moving");
  const bus::Lease stuck = hung.Ask(), at_work = moving.Ask();
  Beating still(*participant_, running, spec, stuck, "hung"), moves(*participant_, running, spec, at_work, "moving");

  std::vector<std::string> silent;
  std::uint32_t step = 0;
  EXPECT_TRUE(WaitFor(
      [&] {
        still.Beat(7);
        moves.Beat(++step);
        for (const auto& name : running->TakeSilent()) silent.push_back(name);
        return !silent.empty();
      },
      20s));

  EXPECT_EQ(silent, std::vector<std::string>{"hung"}) << "its supervisor is told; the other one moves";
  EXPECT_EQ(running->progress().lost_leases, 1u);
  EXPECT_EQ(running->progress().failures.at("stalled"), 1u);
  RawWorker next(*participant_, spec, running->id(), "next");
  const bus::Lease again = next.Ask();
  EXPECT_EQ(again.index, stuck.index);
  EXPECT_EQ(again.attempt, stuck.attempt) << "the attempt is not counted";
  EXPECT_GT(again.token, stuck.token);
}

TEST_F(CollectorTest, AWorkerThatWasAwayAtTheEndIsSentHomeWhenItComesBack) {
  const CampaignSpec spec = Spec("away", 1);
  CollectorOptions options = QuickOptions();
  options.drain = 200ms;
  options.away = 60s;
  Running running(std::move(*Collector::Open(*participant_, spec, folder_ / "data", options)));
  RawWorker away(*participant_, spec, running->id(), "away");
  ASSERT_EQ(away.Ask().kind, bus::LeaseKind::kWork);
  Process worker = StartWorker(spec, folder_ / "w.log", 0);
  ASSERT_TRUE(WaitFor([&] { return running->progress().complete; })) << "with the lease that the other one lost";
  ASSERT_TRUE(WaitFor([&] { return running->progress().workers == 0; })) << "nobody is heard any more";

  EXPECT_EQ(away.Ask().kind, bus::LeaseKind::kDone);
  running.Join();
}

TEST_F(CollectorTest, AnIdleWorkerEndsWhenNobodyWantsItForAsLongAsItWasTold) {
  const CampaignSpec spec = Spec("idle", 1);  // and no collector of it
  ::setenv("FAKE_IDLE_TIMEOUT_MS", "500", 1);
  Process worker = StartWorker(spec, folder_ / "w.log", 0);
  ::unsetenv("FAKE_IDLE_TIMEOUT_MS");
  EXPECT_EQ(worker.Wait(20s), 0);
  EXPECT_NE(ReadTextFile(folder_ / "w.log").value_or("").find("nobody had work"), std::string::npos);
}

TEST_F(CollectorTest, APolicyThatDoesNotAnswerDropsNoRolloutAndEndsTheEvaluationWithWords) {
  CampaignSpec spec = Spec("outage", 1);
  spec.mode = "rollout";
  spec.rollout.run = "run";
  spec.max_attempts = 2;
  CollectorOptions options = QuickOptions();
  options.policy_patience = 1s;
  auto collector = Collector::Open(*participant_, spec, folder_ / "data", options);
  ASSERT_TRUE(collector) << collector.error().message;
  auto owner = std::make_unique<Running>(std::move(*collector));
  Running& running = *owner;
  RawWorker worker(*participant_, spec, running->id(), "raw");
  const auto fail = [&] {
    bus::Lease lease = worker.Ask();
    ASSERT_EQ(lease.kind, bus::LeaseKind::kWork) << "more often than max_attempts";
    EXPECT_EQ(lease.attempt, 0u);
    worker.Report(lease, running->id(), SpecHash(spec), kPolicyError, R"({"reason": "no answer of 'run'"})");
  };
  for (int k = 0; k < 4; ++k) fail();
  ASSERT_TRUE(WaitFor([&] { return !running->progress().error.empty(); }));
  EXPECT_NE(running->progress().error.find("no answer of 'run'"), std::string::npos) << running->progress().error;
  EXPECT_EQ(running->progress().given_up, 0u);

  const auto outage = MonotonicClock::now() + 1s;
  ASSERT_TRUE(WaitFor([&] { return MonotonicClock::now() > outage; }));
  fail();
  running.Join();
  ASSERT_FALSE(running.status());
  EXPECT_EQ(running.status().error().code, Code::kUnavailable);
  EXPECT_NE(running.status().error().message.find("no answer of 'run'"), std::string::npos)
      << running.status().error().message;

  // and the next start begins where it was
  owner.reset();
  auto again = Collector::Open(*participant_, spec, folder_ / "data", options);
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(again->progress().given_up, 0u);
}

}  // namespace collector_test
}  // namespace etude::campaign
