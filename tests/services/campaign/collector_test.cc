// SPDX-License-Identifier: Apache-2.0
// Tests services/campaign/collector.cc: campaigns from their beginning to their end.
#include "services/campaign/collector.h"

#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>
#include <cstdlib>
#include <map>
#include <stdexcept>
#include <vector>

#include "services/bus/blob_transfer.h"
#include "services/campaign/process.h"
#include "services/core/identity.h"
#include "services/core/rng.h"
#include "services/store/commit_journal.h"
#include "services/store/dataset.h"
#include "tests/services/campaign/collector_fixture.h"
#include "tests/services/campaign/says_stopped.h"
#include "tests/support/wait_until.h"

namespace etude::campaign {
namespace collector_test {

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
  std::map<std::uint64_t, store::CommitFacts> commits;
  const auto take = [&](const store::CommitRow& row) { commits[row.index] = row.facts; };
  ASSERT_TRUE(store::CommitTail(folder_ / "data").Refresh([] {}, take));
  ASSERT_EQ(commits.size(), spec.episodes);
  for (const auto& [index, facts] : commits) {
    EXPECT_EQ(facts.host, HostName());
    EXPECT_FALSE(facts.worker.empty());
    EXPECT_EQ(facts.timings.plan_s, 0.25) << "beside the episode, not in it";
    EXPECT_GT(facts.timings.wall_s, 0);
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
    WaitUntil([&] { return running->progress().complete; }, std::chrono::milliseconds(100 + rng.Below(400)));
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
  // slow, so that the first two lives end before all is committed
  Process worker_a = StartWorker(spec, folder_ / "a.log", 80);
  Process worker_b = StartWorker(spec, folder_ / "b.log", 80);
  std::uint64_t before = 0;
  for (int life = 0; life < 3; ++life) {
    EXPECT_EQ(SaysStopped(folder_ / "data"), life > 0);
    auto collector = Open(spec, folder_ / "data");
    ASSERT_TRUE(collector) << collector.error().message;
    Running running(std::move(*collector));
    if (life == 2) {
      running.Join();
    } else {
      ASSERT_TRUE(WaitUntil([&] { return running->progress().committed >= before + 5; }));
      running.Stop();
      before = running->progress().committed;
    }
  }
  ExpectWhole(spec, folder_ / "data");
  EXPECT_FALSE(SaysStopped(folder_ / "data"));
  EXPECT_EQ(OrderedJson::parse(ReadTextFile(folder_ / "data/collector.json").value())["epoch"], 3);
  EXPECT_EQ(worker_a.Wait(10s), 0);
  EXPECT_EQ(worker_b.Wait(10s), 0);
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
  EXPECT_FALSE(SaysStopped(folder_ / "data")) << "its successor goes on";

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

  // what the name means is settled 0.3 s after it has looked first: by then it sees both, on a busy machine, too
  ::setenv("FAKE_SEES", "2", 1);
  Process lost = StartWorkerOf(one.name, folder_ / "lost.log", 0);
  ::unsetenv("FAKE_SEES");
  EXPECT_EQ(lost.Wait(40s), kExitUsage);
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
  Status WriteFilterKey(const std::string& name, const std::set<std::uint64_t>& indices) override {
    return inner_->WriteFilterKey(name, indices);
  }

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
  RawWorker worker(*participant_, spec, running->id(), "worker");
  const bus::Lease lease = worker.Ask();
  ASSERT_EQ(lease.kind, bus::LeaseKind::kWork);
  (void)sender->Send(1, EncodeEpisode(FakeEpisode(spec, lease.index, lease.attempt)), lease.token, "{}", 2s);

  running.Join();

  ASSERT_FALSE(running.status());
  EXPECT_EQ(running.status().error().code, Code::kInternal);
  EXPECT_NE(running.status().error().message.find("commit thread failed: an exception: out of paper"),
            std::string::npos)
      << running.status().error().message;
  EXPECT_FALSE(SaysStopped(folder_ / "data")) << "it failed";
}

}  // namespace collector_test
}  // namespace etude::campaign
