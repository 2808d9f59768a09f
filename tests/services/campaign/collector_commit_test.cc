// SPDX-License-Identifier: Apache-2.0
// Tests services/campaign/collector_commit.cc: what is taken, what is refused, and disks that are full.

#include <gtest/gtest.h>

#include <atomic>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <thread>

#include "services/bus/topic.h"
#include "services/campaign/process.h"
#include "services/campaign/sink.h"
#include "services/spec/attempt_outcome.h"
#include "services/store/filter_keys.h"
#include "tests/services/campaign/collector_fixture.h"
#include "tests/services/campaign/full_disk_sink.h"
#include "tests/support/wait_until.h"

namespace etude::campaign {
namespace collector_commit_test {

class CollectorCommit : public CollectorTest {};

TEST_F(CollectorCommit, FullDiskWaitsSaysSoAndResumesByItself) {
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

  ASSERT_TRUE(WaitUntil([&] {
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

class CollectorWithoutIndex : public CollectorCommit {
 protected:
  // all episodes are committed by now, and its disk has no room for the index
  std::unique_ptr<Running> Complete(const CampaignSpec& spec) {
    auto sink = OpenDatasetSink(folder_ / "data", spec);
    EXPECT_TRUE(sink);
    auto collector = Collector::Open(*participant_, spec,
                                     std::make_unique<FullDiskSink>(std::move(*sink), full_, FullDiskSink::Of::kIndex),
                                     QuickOptions());
    EXPECT_TRUE(collector);
    auto running = std::make_unique<Running>(std::move(*collector));
    RawWorker worker(*participant_, spec, (*running)->id(), "worker");
    const bus::Lease lease = worker.Ask();
    EXPECT_EQ(worker.Send(lease, FakeEpisode(spec, lease.index, lease.attempt)).kind, bus::AckKind::kDone);
    EXPECT_EQ(worker.Ask().kind, bus::LeaseKind::kDone) << "a worker need not wait for that";
    EXPECT_TRUE(WaitUntil([&] { return (*running)->progress().error.find("No space left") != std::string::npos; }));
    return running;
  }

  std::atomic<bool> full_{true};
};

TEST_F(CollectorWithoutIndex, WaitsForTheDiskAtTheEndToo) {
  const CampaignSpec spec = Spec("index", 1);
  const auto running = Complete(spec);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "data" / "dataset.hdf5"));
  full_ = false;
  running->Join();
  EXPECT_TRUE(running->status()) << running->status().error().message;
  EXPECT_EQ((*running)->progress().error, "");
  EXPECT_TRUE(std::filesystem::exists(folder_ / "data" / "dataset.hdf5"));
}

TEST_F(CollectorWithoutIndex, StoppedMeanwhileItSaysWhatIsMissing) {
  const auto running = Complete(Spec("no_index", 1));
  running->Stop();
  ASSERT_FALSE(running->status());
  EXPECT_EQ(running->status().error().code, Code::kUnavailable);
  EXPECT_NE(running->status().error().message.find("start it again to write the dataset's index"), std::string::npos)
      << running->status().error().message;
}

TEST_F(CollectorCommit, OldTokensAreRefusedAndRepeatsAreDuplicates) {
  const CampaignSpec spec = Spec("token", 3);
  auto collector = Open(spec, folder_ / "data");
  ASSERT_TRUE(collector);
  Running running(std::move(*collector));
  RawWorker slow(*participant_, spec, running->id(), "slow"), quick(*participant_, spec, running->id(), "quick");

  const bus::Lease old = slow.Ask();  // and never a heartbeat
  ASSERT_EQ(old.kind, bus::LeaseKind::kWork);
  ASSERT_TRUE(WaitUntil([&] { return running->progress().lost_leases == 1; }));
  bus::Lease lease = quick.Ask();
  // an index that lost a worker comes after those that did not
  while (lease.index != old.index) {
    EXPECT_EQ(quick.Send(lease, FakeEpisode(spec, lease.index, lease.attempt)).kind, bus::AckKind::kDone);
    lease = quick.Ask();
    ASSERT_EQ(lease.kind, bus::LeaseKind::kWork);
  }
  EXPECT_NE(lease.token, old.token);
  const Episode episode = FakeEpisode(spec, old.index, old.attempt);
  const bus::Verdict refused = slow.Send(old, episode);
  EXPECT_EQ(refused.kind, bus::AckKind::kRefused);
  EXPECT_NE(refused.reason.find("old"), std::string::npos) << refused.reason;
  EXPECT_EQ(quick.Send(lease, episode).kind, bus::AckKind::kDone);
  EXPECT_EQ(running->progress().stale_results, 1u);
}

TEST_F(CollectorCommit, EpisodesThatDoNotFitAreRefusedWithTheReasonAndCostTheIndexNothing) {
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
    EXPECT_NE(lease.token, last_token) << "what was refused is not leased on";
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

// Whoever knows a token and is not who was told it takes no lease away, and sends nobody away.
TEST_F(CollectorCommit, UnfitEpisodesInSomebodyElsesPlaceCostNobodyAnything) {
  const CampaignSpec spec = Spec("unfit_forged", 2);
  CollectorOptions options = QuickOptions();
  options.lease = 60s;
  Running running(std::move(*Collector::Open(*participant_, spec, folder_ / "data", options)));
  RawWorker holder(*participant_, spec, running->id(), "holder"), thief(*participant_, spec, running->id(), "thief");
  const bus::Lease held = holder.Ask();
  ASSERT_EQ(held.kind, bus::LeaseKind::kWork);
  Episode bad = FakeEpisode(spec, held.index, held.attempt);
  ++bad.seed;
  bus::Lease invented = held;
  invented.token += 1;
  const int forgeries = 2 * options.unfit_budget;
  for (int k = 0; k < forgeries; ++k) {
    EXPECT_EQ(thief.Send(held, bad).kind, bus::AckKind::kRefused);
    EXPECT_EQ(holder.Send(invented, bad).kind, bus::AckKind::kRefused) << "in the holder's name";
  }
  EXPECT_EQ(running->progress().refused, static_cast<std::uint64_t>(2 * forgeries));
  EXPECT_FALSE(running->progress().failures.contains(kUnfitEpisode));
  EXPECT_EQ(thief.Send(held, FakeEpisode(spec, held.index, held.attempt)).kind, bus::AckKind::kRefused)
      << "nor is what fits taken from anybody";
  EXPECT_EQ(holder.Ask().token, held.token) << "its lease is still out, and it is not sent away";
  EXPECT_EQ(holder.Send(held, FakeEpisode(spec, held.index, held.attempt)).kind, bus::AckKind::kDone);
}

// Asks a collector for a filter key; what it answers: "" when it wrote it.
class KeyAsker {
 public:
  KeyAsker(const bus::Participant& participant, const CampaignSpec& spec, Running& running)
      : campaign_(spec.name),
        id_(running->id()),
        controls_(std::move(*bus::Writer<bus::CampaignControl>::Open(participant, PartitionOf(running, spec)))),
        statuses_(std::move(*bus::Reader<bus::CampaignStatus>::Open(participant, PartitionOf(running, spec)))) {}

  std::string Ask(const std::string& key, const std::string& episodes) {
    const bus::CampaignControl message{.campaign = campaign_,
                                       .control_id = std::to_string(++asked_),
                                       .campaign_id = id_,
                                       .action = bus::ControlAction::kFilterKey,
                                       .filter_key = key,
                                       .episodes = episodes};
    std::optional<std::string> answer;
    (void)WaitUntil([&] {
      EXPECT_TRUE(controls_.Write(message));
      statuses_.Wait(200ms);
      for (const auto& status : statuses_.Take())
        if (status.control_id == message.control_id) answer = status.control_refusal;
      return answer.has_value();
    });
    return answer.value_or("no answer");
  }

 private:
  std::string campaign_, id_;
  bus::Writer<bus::CampaignControl> controls_;
  bus::Reader<bus::CampaignStatus> statuses_;
  int asked_ = 0;
};

TEST_F(CollectorCommit, GivesAFilterKeyToWhatIsCommitted) {
  const CampaignSpec spec = Spec("keys", 4);
  auto collector = Open(spec, folder_ / "data");
  ASSERT_TRUE(collector) << collector.error().message;
  Running running(std::move(*collector));
  RawWorker worker(*participant_, spec, running->id(), "raw");
  const bus::Lease lease = worker.Ask();
  ASSERT_EQ(lease.kind, bus::LeaseKind::kWork);
  ASSERT_EQ(worker.Send(lease, FakeEpisode(spec, lease.index, lease.attempt)).kind, bus::AckKind::kDone);

  KeyAsker asker(*participant_, spec, running);
  const std::string made = std::to_string(lease.index);
  EXPECT_EQ(asker.Ask("mine", made), "");
  const auto keys = store::ReadFilterKeys(folder_ / "data");
  ASSERT_TRUE(keys) << keys.error().message;
  EXPECT_EQ(*keys, (store::FilterKeys{{"mine", {lease.index}}}));
  EXPECT_NE(ReadTextFile(folder_ / "data" / "dataset.hdf5").value_or("").find("mine"), std::string::npos);

  EXPECT_NE(asker.Ask("mine", "3").find("has no episode 3"), std::string::npos) << "not committed yet";
  EXPECT_NE(asker.Ask("train", made).find("choose another"), std::string::npos);
  EXPECT_NE(asker.Ask("mine", "0-99").find("at most 4"), std::string::npos);
  EXPECT_EQ(*store::ReadFilterKeys(folder_ / "data"), *keys);
  EXPECT_EQ(worker.Ask().kind, bus::LeaseKind::kWork) << "it goes on";
}

}  // namespace collector_commit_test
}  // namespace etude::campaign
