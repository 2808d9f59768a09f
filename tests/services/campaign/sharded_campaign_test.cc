// SPDX-License-Identifier: Apache-2.0
// Tests collectors that share a campaign (collector.cc, worker_client.cc) over a real bus, with worker processes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <cstdlib>
#include <memory>
#include <thread>

#include "services/campaign/collector.h"
#include "services/campaign/history.h"
#include "services/campaign/process.h"
#include "services/core/command.h"
#include "services/core/share.h"
#include "services/store/edit.h"
#include "tests/services/campaign/fake_work.h"
#include "tests/services/campaign/full_disk_sink.h"
#include "tests/services/campaign/running_collector.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/wait_until.h"

namespace etude::campaign {
namespace sharded_campaign_test {

constexpr std::uint32_t kDomain = 81;

class ShardedCampaign : public testing::Test {
 protected:
  void SetUp() override {
    spec_ = SyntheticSpec();
    spec_.name = "shards-" + std::to_string(::getpid());
    spec_.episodes = 15;
    spec_.max_attempts = 100;
    auto opened = bus::Participant::Open({kDomain, ""});
    ASSERT_TRUE(opened) << opened.error().message;
    participant_ = std::make_unique<bus::Participant>(std::move(*opened));
  }
  Result<Collector> Open(const std::string& name, const Shard& shard, Claim claim = Claim::kRefuse) {
    CollectorOptions options = QuickOptions();
    options.lease = 60s;  // none of these tests waits for one to run out
    options.shard = shard;
    options.claim = claim;
    return Collector::Open(*participant_, spec_, folder_ / name, options);
  }
  std::unique_ptr<Running> Start(const std::string& name, const Shard& shard) {
    auto collector = Open(name, shard);
    EXPECT_THAT(collector, IsOk());
    return std::make_unique<Running>(std::move(*collector));
  }
  // `campaign`: NAME or NAME@ID
  Process StartWorker(const std::string& campaign, int ms_per_attempt = 0) {
    auto process = Process::Start({.argv = {(ProgramFolder() / "fake_worker").string(), campaign,
                                            std::to_string(kDomain), std::to_string(ms_per_attempt)},
                                   .log = folder_ / "w.log"});
    EXPECT_THAT(process, IsOk());
    return std::move(*process);
  }
  std::string Log() const { return ReadTextFile(folder_ / "w.log").value_or(""); }
  std::vector<std::uint64_t> List(const std::string& name) const {
    return store::DatasetReader::Open(folder_ / name)->List().value();
  }
  std::string HashOfLinked(const std::vector<Path>& shards) const {
    EXPECT_THAT(store::LinkDatasets(shards, folder_ / "linked", Leftover::kRefuse), IsOk());
    return store::HashDataset(folder_ / "linked").value();
  }
  std::string HashOfOne() {
    const auto running = Start("one", {});
    Process worker = StartWorker(spec_.name);
    running->Join();
    EXPECT_EQ(worker.Wait(20s), 0) << Log();
    return store::HashDataset(folder_ / "one").value();
  }

  TemporaryFolder folder_;
  CampaignSpec spec_;
  std::unique_ptr<bus::Participant> participant_;
};

TEST_F(ShardedCampaign, MakesTheDatasetOfOneCollectorWithAWorkerThatGoesFromShardToShard) {
  const std::string expected = HashOfOne();
  const auto first = Start("a", {1, 2}), second = Start("b", {2, 2});
  Process worker = StartWorker(spec_.name);

  first->Join();
  second->Join();

  EXPECT_EQ(worker.Wait(20s), 0) << Log();
  EXPECT_EQ((*first)->progress().total, 8u);
  EXPECT_EQ((*second)->progress().total, 7u);
  EXPECT_THAT(List("a"), testing::ElementsAre(0, 2, 4, 6, 8, 10, 12, 14));
  EXPECT_THAT(List("b"), testing::ElementsAre(1, 3, 5, 7, 9, 11, 13));
  for (Running* running : {first.get(), second.get()}) {
    EXPECT_TRUE(running->status());
    EXPECT_EQ((*running)->progress().lost_leases, 0u) << "nobody left with a lease";
  }
  EXPECT_EQ(HashOfLinked({folder_ / "a", folder_ / "b"}), expected);
}

// Workers go to another shard by chance now and then, and each that came to this one stayed for ever.
TEST_F(ShardedCampaign, AShardWhoseDiskIsFullKeepsNobodyFromTheOthers) {
  std::atomic<bool> full{true};
  CollectorOptions options = QuickOptions();
  options.lease = 60s;
  options.shard = {1, 2};
  Running first(std::move(*Collector::Open(
      *participant_, spec_, std::make_unique<FullDiskSink>(std::move(*OpenDatasetSink(folder_ / "a", spec_)), full),
      options)));
  RawWorker stuck(*participant_, spec_, first->id(), "stuck");
  const bus::Lease held = stuck.Ask();
  auto sender = bus::BlobSender::Open(*participant_, {spec_.name, first->id()}, "episode", "stuck");
  ASSERT_THAT(sender, IsOk());
  const auto bytes = EncodeEpisode(FakeEpisode(spec_, held.index, held.attempt));
  std::jthread sends([&] { EXPECT_THAT(sender->Send(held.token, bytes, held.token, "{}", 120s), IsOk()); });
  ASSERT_TRUE(WaitUntil([&] { return !first->progress().error.empty(); }));
  const auto second = Start("b", {2, 2});
  Process worker = StartWorker(spec_.name);
  EXPECT_TRUE(WaitUntil([&] { return (*second)->progress().complete; })) << Log();
  full = false;
  sends.join();
  first.Join();
  EXPECT_EQ(worker.Wait(20s), 0) << Log();
}

TEST_F(ShardedCampaign, TwoWorkersAndAShardThatBeginsLaterFinishAllOfIt) {
  const std::string expected = HashOfOne();
  const auto third = Start("c", {3, 3}), first = Start("a", {1, 3});
  // until the second one is there the first is not complete
  RawWorker holder(*participant_, spec_, (*first)->id(), "holder");
  const bus::Lease held = holder.Ask();
  ASSERT_EQ(held.kind, bus::LeaseKind::kWork);
  Process worker = StartWorker(spec_.name), other = StartWorker(spec_.name);
  ASSERT_TRUE(WaitUntil([&] { return (*third)->progress().complete; })) << Log();
  const auto second = Start("b", {2, 3});
  const auto renewed = [&] { return holder.Ask().token == held.token; };
  ASSERT_TRUE(WaitUntil([&] { return renewed() && (*second)->progress().complete; })) << Log();

  if (FakeFails(held.index, held.attempt))
    holder.Report(held, (*first)->id(), SpecHash(spec_));
  else
    EXPECT_EQ(holder.Send(held, FakeEpisode(spec_, held.index, held.attempt)).kind, bus::AckKind::kDone);
  for (Running* running : {first.get(), second.get(), third.get()}) running->Join();

  EXPECT_EQ(worker.Wait(20s), 0) << Log();
  EXPECT_EQ(other.Wait(20s), 0) << Log();
  EXPECT_EQ(HashOfLinked({folder_ / "a", folder_ / "b", folder_ / "c"}), expected);
}

TEST_F(ShardedCampaign, AWorkerGoesToAnotherShardWhenItsCollectorEndsAndComesBack) {
  std::unique_ptr<Running> running[2] = {Start("a", {1, 2}), Start("b", {2, 2})};
  const auto committed = [&](int k) { return (*running[k])->progress().committed; };
  Process worker = StartWorker(spec_.name, 200);
  ASSERT_TRUE(WaitUntil([&] { return committed(0) + committed(1) >= 2; }));
  const int left = committed(0) > 0 ? 0 : 1, other = 1 - left;
  ASSERT_EQ(committed(other), 0u) << "it stays where there is work";

  running[left].reset();
  ASSERT_TRUE(WaitUntil([&] { return committed(other) >= 2; })) << Log();
  running[left] = left == 0 ? Start("a", {1, 2}) : Start("b", {2, 2});

  for (auto& each : running) each->Join();
  EXPECT_EQ(worker.Wait(20s), 0) << Log();
  EXPECT_EQ(List("a").size() + List("b").size(), spec_.episodes);
}

// else all would stay where they were when the others began
TEST_F(ShardedCampaign, NowAndThenAWorkerGoesWhereChanceSendsIt) {
  spec_.episodes = 300;  // more than are made until it has been at both
  const auto first = Start("a", {1, 2}), second = Start("b", {2, 2});
  ::setenv("FAKE_STAY_MS", "1", 1);
  Process worker = StartWorker(spec_.name);
  ::unsetenv("FAKE_STAY_MS");

  EXPECT_TRUE(WaitUntil([&] { return (*first)->progress().committed > 0 && (*second)->progress().committed > 0; }));
  EXPECT_FALSE((*first)->progress().complete || (*second)->progress().complete);
  EXPECT_EQ((*first)->progress().lost_leases + (*second)->progress().lost_leases, 0u);
  EXPECT_EQ(worker.Stop(10s), 0) << Log();
}

TEST_F(ShardedCampaign, AWorkerOfOneShardGoesHomeWhenThatIsComplete) {
  const auto first = Start("a", {1, 2}), second = Start("b", {2, 2});
  Process worker = StartWorker(spec_.name + "@" + (*second)->id());

  second->Join();

  EXPECT_EQ(worker.Wait(20s), 0) << Log();
  EXPECT_EQ((*first)->progress().committed, 0u);
}

TEST_F(ShardedCampaign, AShardHasOneCollectorAndAllHaveOneCount) {
  const auto first = Start("a", {1, 2});

  for (const auto& [name, shard] : {std::pair{"copy", Shard{1, 2}}, std::pair{"thirds", Shard{2, 3}}}) {
    const auto refused = Open(name, shard);
    EXPECT_THAT(refused, HasCode(Code::kUnavailable));
    EXPECT_THAT(refused, MessageHas((folder_ / "a").string()));
    EXPECT_THAT(refused, MessageHas("shard 1/2"));
    EXPECT_THAT(refused, MessageHas("--adopt"));
  }
  auto adopting = Open("copy", {1, 2}, Claim::kAdopt);
  ASSERT_THAT(adopting, IsOk());
  first->Join();
  EXPECT_THAT(first->status(), MessageHas((folder_ / "copy").string())) << "the one whose place was taken ends";
}

TEST_F(ShardedCampaign, AFolderStaysTheShardThatItIs) {
  { ASSERT_THAT(Open("a", {1, 2}), IsOk()); }
  EXPECT_EQ(KnownShard(folder_ / "a"), "1/2");
  EXPECT_THAT(Open("a", {2, 2}), MessageHas("is shard 1/2 of campaign"));
  EXPECT_THAT(Open("a", {}), MessageHas("--shard 1/2"));
  { EXPECT_THAT(Open("a", {1, 2}), IsOk()); }

  {
    auto writer = store::DatasetWriter::Open(folder_ / "all", spec_);
    ASSERT_THAT(writer, IsOk());
    for (const std::uint64_t index : {0, 1})
      ASSERT_THAT(writer->Commit(MakeSyntheticEpisode(spec_, index, 10)), IsOk());
  }
  EXPECT_THAT(Open("all", {1, 2}), MessageHas("has episode 1, which is none of shard 1/2"));
  { EXPECT_THAT(Open("all", {}), IsOk()); }
  EXPECT_FALSE(KnownShard(folder_ / "all")) << "a whole campaign's folder says nothing of shards";
}

TEST_F(ShardedCampaign, IsForDemonstrationsThatDependOnNobody) {
  spec_.adaptive_sampling.share = 0.5;
  EXPECT_THAT(Open("adaptive", {1, 2}), MessageHas("adaptive_sampling has one collector"));
  spec_.adaptive_sampling = {};
  spec_.mode = "rollout";
  spec_.rollout.run = "run";
  EXPECT_THAT(Open("rollouts", {1, 2}), MessageHas("an evaluation has one collector"));
}

}  // namespace sharded_campaign_test
}  // namespace etude::campaign
