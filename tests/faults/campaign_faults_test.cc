// SPDX-License-Identifier: Apache-2.0
// Processes of a campaign that are killed, stopped, hung and short of memory, at random and at every named point.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <thread>

#include "services/bus/blob_transfer.h"
#include "services/bus/topic.h"
#include "services/campaign/lease_table.h"
#include "services/cli/worker_pool.h"
#include "services/core/identity.h"
#include "services/core/rng.h"
#include "services/core/share.h"
#include "services/store/dataset.h"
#include "tests/faults/two_hosts.h"
#include "tests/services/campaign/fake_work.h"
#include "tests/support/wait_until.h"
#include "tests/support/write_program.h"

namespace etude::faults {
namespace campaign_faults_test {

using namespace std::chrono_literals;

constexpr int kKilled = 128 + SIGKILL;

TEST(Faults, F1WorkersThatAreKilledMidEpisode) {
  CampaignRun run({.name = "f1", .domain = 90, .episodes = 40, .ms_per_attempt = 30});
  run.StartCollector();
  for (int i = 0; i < 3; ++i) run.StartWorker();
  Rng rng(1);
  for (std::uint64_t kill = 1; kill <= 8; ++kill) {
    run.WaitForCommitted(4 * kill);
    std::this_thread::sleep_for(std::chrono::milliseconds(rng.Below(30)));  // anywhere in an episode
    run.ReplaceWorker(rng.Below(run.workers()));
  }
  ReportRow("F1", "8 of 3 workers killed mid-episode", run.Finish());
}

TEST(Faults, F2WorkersThatDieWithAnEpisodeSentOrAnswered) {
  CampaignRun run({.name = "f2", .domain = 90, .episodes = 30});
  run.StartCollector();
  run.StartWorker({{"ETUDE_CRASH_AT", "worker.before_send:2"}});
  run.StartWorker({{"ETUDE_CRASH_AT", "worker.after_ack:3"}});
  run.StartWorker({{"ETUDE_CRASH_AT", "worker.after_ack:4"}});
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(run.worker(i).Wait(60s), kKilled) << i << run.Logs();
  run.StartWorker();
  ReportRow("F2", "3 workers killed before sending, and before noting the answer", run.Finish());
}

TEST(Faults, F3CollectorsThatDieAtEveryPointOfACommit) {
  CampaignRun run({.name = "f3", .domain = 90, .episodes = 40, .ms_per_attempt = 5});
  for (int i = 0; i < 2; ++i) run.StartWorker();
  const std::vector<std::string> points{
      "file.written:1",  "file.synced:1",    "file.renamed:1", "commit.created:2",       "commit.written:2",
      "commit.synced:2", "commit.renamed:2", "commit.done:2",  "collector.before_ack:2", "collector.after_ack:2",
  };
  for (const auto& point : points) {
    auto& collector = run.StartCollector({{"ETUDE_CRASH_AT", point}});
    EXPECT_EQ(collector.Wait(30s), kKilled) << point << run.Logs();
    const Counts counts = run.Scan();
    EXPECT_TRUE(counts.clean()) << point << " " << counts.Text();
  }
  run.StartCollector();
  ReportRow("F3", fmt::format("collector killed at {} points between write, fsync, rename and answer", points.size()),
            run.Finish());
}

TEST(Faults, F5CollectorsThatComeBackFenceTheirPast) {
  // slow, so that the last ten are not done before the third kill
  CampaignRun run({.name = "f5", .domain = 90, .episodes = 40, .ms_per_attempt = 80});
  run.StartCollector();
  for (int i = 0; i < 2; ++i) run.StartWorker();
  for (std::uint64_t kill = 1; kill <= 3; ++kill) {
    run.WaitForCommitted(10 * kill);
    run.collector().Signal(SIGKILL);
    run.collector().Wait(5s);
    run.StartCollector();
  }
  const Counts counts = run.Finish();
  std::map<std::uint64_t, std::uint64_t> of_epoch;
  for (const Ack& ack : run.Acks()) ++of_epoch[campaign::EpochOf(ack.token)];
  EXPECT_EQ(of_epoch.size(), 4u) << "each life of the collector answered for tokens of its own";
  ReportRow("F5", "collector killed 3 times; tokens of each life are larger", counts);
}

// Longer than peers of DDS believe in each other (10 s): each worker makes one episode more and waits with it.
TEST(Faults, F11ACollectorThatStandsStillIsWaitedFor) {
  CampaignRun run({.name = "f11", .domain = 90, .episodes = 60, .ms_per_attempt = 40});
  run.StartCollector();
  for (int i = 0; i < 3; ++i) run.StartWorker();
  run.WaitForCommitted(10);
  run.collector().Signal(SIGSTOP);
  const auto held = run.Committed();
  std::vector<double> before_mb;
  for (std::size_t i = 0; i < run.workers(); ++i) before_mb.push_back(ResidentMb(run.worker(i).pid()));
  Last(12s);
  double grown_mb = 0;
  for (std::size_t i = 0; i < run.workers(); ++i) {
    EXPECT_TRUE(run.worker(i).running()) << i << run.Logs();
    grown_mb = std::max(grown_mb, ResidentMb(run.worker(i).pid()) - before_mb[i]);
  }
  EXPECT_LT(grown_mb, 16) << "a worker holds more than the episode that it waits with";
  EXPECT_LE(run.Committed(), held + 1) << "it was not stopped";
  run.collector().Signal(SIGCONT);
  ReportRow("F11", fmt::format("collector stopped for 12 s; workers grew by {:.0f} MB at most", grown_mb),
            run.Finish(90s));
}

TEST(Faults, F21WorkersThatHangLoseTheirLease) {
  CampaignRun run({.name = "f21", .domain = 90, .episodes = 30, .lease_s = "1", .ms_per_attempt = 20});
  run.StartCollector();
  for (int i = 0; i < 2; ++i) run.StartWorker();
  run.WaitForCommitted(5);
  run.worker(0).Signal(SIGSTOP);
  run.WaitForCommitted(30);  // what it holds is leased again
  run.worker(0).Signal(SIGCONT);
  ReportRow("F21", "worker stopped for longer than its lease", run.Finish());
}

// Workers that take 250 MB of address space more with every attempt and may have 2 GB (threads of malloc reserve some
// of it), under the supervisor of `etude up`.
TEST(Faults, F22WorkersThatRunOutOfMemoryAreStartedAgain) {
  CampaignRun run({.name = "f22", .domain = 92, .episodes = 30});
  run.StartCollector();
  const Path program = WriteProgram(
      run.folder() / "worker",
      fmt::format("#!/bin/sh\nexport FAKE_LEAK_MB=250 FAKE_ROOM_MB=2000 ETUDE_ACK_LOG={}/acks-$$\nexec {} {} 92 5\n",
                  run.folder().string(), (ProgramFolder() / "fake_worker").string(), run.spec().name));
  auto pool = cli::WorkerPool::Start({.workers = 2,
                                      .campaign = run.spec().name,
                                      .bus = {},
                                      .logs = run.folder() / "logs",
                                      .on_end = nullptr,
                                      .done = [&] { return run.Committed(); },
                                      .program = program});
  ASSERT_TRUE(pool) << pool.error().message;
  Status status;
  EXPECT_TRUE(WaitUntil(
      [&] {
        status = pool->Supervise();
        return !status || !run.collector().running();
      },
      180s))
      << run.Logs();
  EXPECT_TRUE(status) << status.error().message;
  const Counts counts = run.Finish();
  const int restarts = pool->restarts();
  pool->Stop();
  EXPECT_GE(restarts, 4) << "their memory was enough";
  const std::string log = ReadTextFile(run.folder() / "logs" / "worker-0.log").value_or("");
  EXPECT_NE(log.find("bad_alloc"), std::string::npos) << log;
  ReportRow("F22", fmt::format("workers of RLIMIT_AS ran out of memory {} times and were started again", restarts),
            counts);
}

// Of work that somebody else does: what its heartbeats say, under another worker's name and its own, and guesses.
// Returns how many; the attempts of a campaign are far fewer.
int ForgeReports(const bus::Participant& participant, const CampaignRun& run, const std::string& id) {
  const std::string partition = bus::Owner{run.spec().name, id}.partition();
  auto heartbeats = bus::Reader<bus::WorkerStatus>::Open(participant, partition);
  auto reports = bus::Writer<bus::AttemptReport>::Open(participant, partition);
  EXPECT_TRUE(heartbeats && reports && reports->WaitForReaders(1, 20s));
  int forged = 0;
  const auto forge = [&](const bus::WorkerStatus& status, const std::string& worker, std::uint64_t token) {
    bus::AttemptReport report{.campaign = run.spec().name, .worker = worker, .campaign_id = id};
    report.spec_sha256 = SpecHash(run.spec());
    report.index = status.index;
    report.attempt = status.attempt;
    report.token = token;
    report.outcome = "plan_failed";
    EXPECT_TRUE(reports->Write(report));
    ++forged;
  };
  int overheard = 0;
  EXPECT_TRUE(WaitUntil([&] {
    heartbeats->Wait(200ms);
    for (const auto& status : heartbeats->Take()) {
      if (status.token == 0) continue;
      ++overheard;
      forge(status, "thief", status.token);
      forge(status, status.worker, status.token);
      const auto acks = run.Acks();  // beside a token of the same epoch
      for (std::uint64_t step = 1; step <= 20; ++step)
        forge(status, status.worker, (acks.empty() ? 0 : acks.back().token) + step);
    }
    return overheard >= 3;
  }));
  return forged;
}

// What a stranger would send who has seen the bus: an episode of a committed index again, with tokens old and invented.
TEST(Faults, F12LateAndRepeatedEpisodesCountOnce) {
  // so many that it goes on until all is forged, and that the last one is not leased before its token is invented
  CampaignRun run({.name = "f12", .domain = 91, .episodes = 60, .ms_per_attempt = 200});
  run.StartCollector();
  run.StartWorker();
  run.WaitForCommitted(4);
  const auto identity = OpenIdentity(run.dataset(), Claim::kRefuse);
  ASSERT_TRUE(identity) << identity.error().message;
  auto participant = bus::Participant::Open({91, ""});
  ASSERT_TRUE(participant) << participant.error().message;
  const auto replay = [&](const std::string& id, std::uint64_t index, std::uint64_t token,
                          std::chrono::seconds patience) {
    auto sender = bus::BlobSender::Open(*participant, {run.spec().name, id}, "episode", "replay");
    EXPECT_TRUE(sender);
    const auto bytes = EncodeEpisode(campaign::FakeEpisode(run.spec(), index, campaign::FakeCommittedAttempt(index)));
    return sender->Send(token, bytes, token, "{}", patience);
  };
  std::uint64_t old = 0;
  for (const Ack& ack : run.Acks()) old = ack.token;
  const auto again = replay(identity->id, 0, old, 30s);
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(again->kind, bus::AckKind::kDuplicate) << again->reason;
  const auto invented = replay(identity->id, run.spec().episodes - 1, (7ull << 32) + 1, 30s);
  ASSERT_TRUE(invented) << invented.error().message;
  EXPECT_EQ(invented->kind, bus::AckKind::kRefused) << "nobody was leased that";
  EXPECT_FALSE(replay(NewId(), 1, old, 1s)) << "another campaign's: nobody answers";
  const int forged = ForgeReports(*participant, run, identity->id);
  const Counts counts = run.Finish(120s);
  EXPECT_EQ(counts.acknowledged, run.spec().episodes) << "none was given up";
  ReportRow("F12",
            fmt::format("an episode sent again, with an invented token, and under another campaign's id; {} forged "
                        "reports, with tokens overheard and guessed",
                        forged),
            counts);
}

TEST(Faults, F17FortyWorkersWithoutMulticast) {
  CampaignRun run({.name = "f17", .domain = 92, .episodes = 120, .lease_s = "20", .ms_per_attempt = 200});
  run.StartCollector();
  for (int i = 0; i < 40; ++i) run.StartWorker();
  const Counts counts = run.Finish(120s);
  EXPECT_EQ(counts.acknowledged, 120u);
  ReportRow("F17", "40 workers on one host without multicast", counts);
}

TEST(Faults, F24StoppedProcessesHandBackAndEndWithZero) {
  CampaignRun run({.name = "f24", .domain = 90, .episodes = 30, .ms_per_attempt = 30});
  run.StartCollector();
  for (int i = 0; i < 2; ++i) run.StartWorker();
  run.WaitForCommitted(6);
  run.worker(0).Signal(SIGTERM);
  EXPECT_EQ(run.worker(0).Wait(5s), 0);
  run.collector().Signal(SIGTERM);
  EXPECT_EQ(run.collector().Wait(5s), 0);
  EXPECT_TRUE(run.Scan().clean());
  run.StartCollector();
  ReportRow("F24", "worker and collector stopped by SIGTERM: exit code 0 within 5 s", run.Finish());
}

}  // namespace campaign_faults_test
}  // namespace etude::faults
