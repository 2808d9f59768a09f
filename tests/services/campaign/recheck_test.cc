// SPDX-License-Identifier: Apache-2.0
// Tests services/campaign/collector_recheck.cc over a real bus: two hosts, of which one makes other bytes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <memory>
#include <stop_token>
#include <thread>

#include "services/bus/blob_transfer.h"
#include "services/bus/topic.h"
#include "services/campaign/collector.h"
#include "services/campaign/process.h"
#include "services/campaign/recheck_table.h"
#include "services/core/command.h"
#include "services/core/file.h"
#include "services/core/share.h"
#include "services/spec/attempt_outcome.h"
#include "services/store/attempts.h"
#include "services/store/dataset.h"
#include "tests/services/campaign/fake_work.h"
#include "tests/services/campaign/running_collector.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::campaign {
namespace recheck_test {

using testing::HasSubstr;

constexpr std::uint32_t kDomain = 81;

// A worker by hand on a host of its own, which says in heartbeats and beside its episodes that it is on another one:
// that is for people to read, and decides nothing.
class HostWorker {
 public:
  HostWorker(Running& running, const CampaignSpec& spec, const std::string& name, const std::string& host)
      : participant_(std::move(*bus::Participant::Open({.domain = kDomain, .address = host}))),
        raw_(participant_, spec, running->id(), name),
        sender_(std::move(*bus::BlobSender::Open(participant_, {spec.name, running->id()}, "episode", name))),
        statuses_(std::move(*bus::Writer<bus::WorkerStatus>::Open(participant_, PartitionOf(running, spec)))) {
    status_.campaign = spec.name;
    status_.campaign_id = running->id();
    status_.worker = name;
    status_.host = kSaid;
    status_.phase = "idle";
    EXPECT_TRUE(statuses_.WaitForReaders(1, 20s));
    EXPECT_TRUE(statuses_.Write(status_));
    beat_ = std::jthread([this](const std::stop_token& stop) {
      while (!stop.stop_requested()) {
        (void)statuses_.Write(status_);
        std::this_thread::sleep_for(100ms);
      }
    });
  }

  bus::Lease Ask() { return raw_.Ask(); }
  bus::Verdict Send(const bus::Lease& lease, const std::vector<std::uint8_t>& bytes) {
    const OrderedJson meta{{"host", kSaid}};
    auto verdict = sender_.Send(lease.token, bytes, lease.token, meta.dump(), 20s);
    EXPECT_THAT(verdict, IsOk());
    return verdict.value_or(bus::Verdict{bus::AckKind::kProgress, ""});
  }
  RawWorker& raw() { return raw_; }

 private:
  static constexpr const char* kSaid = "localhost";
  bus::Participant participant_;
  RawWorker raw_;
  bus::BlobSender sender_;
  bus::Writer<bus::WorkerStatus> statuses_;
  bus::WorkerStatus status_;
  std::jthread beat_;
};

class Recheck : public testing::Test {
 protected:
  void SetUp() override {
    spec_ = SyntheticSpec();
    spec_.name = "recheck-" + std::to_string(::getpid());
    spec_.episodes = 3;
    spec_.max_attempts = 100;
    spec_.recheck = 1;
    auto opened = bus::Participant::Open({kDomain, ""});
    ASSERT_THAT(opened, IsOk());
    participant_ = std::make_unique<bus::Participant>(std::move(*opened));
  }
  Result<Collector> Open() {
    CollectorOptions options = QuickOptions();
    options.lease = 60s;  // none of these tests waits for one to run out
    options.drain = 20s;  // on a busy machine workers ask later
    return Collector::Open(*participant_, spec_, folder_ / "data", options);
  }
  std::vector<std::uint8_t> Bytes(const bus::Lease& lease) const {
    return EncodeEpisode(FakeEpisode(spec_, lease.index, lease.attempt));
  }
  // what `maker` commits, then the lease by which `checker` makes it again
  bus::Lease CommitAndLeaseAgain(HostWorker& maker, HostWorker& checker) {
    const bus::Lease lease = maker.Ask();
    EXPECT_EQ(lease.kind, bus::LeaseKind::kWork);
    EXPECT_EQ(maker.Send(lease, Bytes(lease)).kind, bus::AckKind::kDone);
    const bus::Lease again = checker.Ask();
    EXPECT_EQ(again.kind, bus::LeaseKind::kWork);
    EXPECT_EQ(again.index, lease.index);
    EXPECT_EQ(again.attempt, lease.attempt);
    EXPECT_NE(again.token, lease.token);
    return again;
  }
  std::vector<OrderedJson> Mismatches() const {
    std::vector<OrderedJson> found;
    store::ForEachAttempt(folder_ / "data", [&](const store::AttemptLine& line) {
      if (line.outcome == kRecheckMismatch) found.push_back(line.details);
    });
    return found;
  }

  CampaignSpec spec_;
  std::unique_ptr<bus::Participant> participant_;
  TemporaryFolder folder_;
};

// Altered software would have had its own host check what it made, and an honest one named for it.
TEST_F(Recheck, WhoCallsItsBytesAnotherHostsDoesNotMakeThemAgain) {
  Running running(std::move(*Open()));
  HostWorker liar(running, spec_, "liar", "lab-1"), second(running, spec_, "second", "lab-1");
  auto other = bus::Participant::Open({.domain = kDomain, .address = "lab-2"});
  ASSERT_THAT(other, IsOk());
  auto sender = bus::BlobSender::Open(*other, {spec_.name, running->id()}, "episode", "liar");
  ASSERT_THAT(sender, IsOk());
  const bus::Lease lease = liar.Ask();
  EXPECT_THAT(sender->Send(lease.token, Bytes(lease), lease.token, "{}", 20s), IsOk());
  EXPECT_NE(second.Ask().index, lease.index) << "of the host that made it";
}

TEST_F(Recheck, AnotherHostMakesEpisodesAgainAndADifferenceNamesBoth) {
  Running running(std::move(*Open()));
  HostWorker a(running, spec_, "a", "lab-1"), b(running, spec_, "b", "lab-2");

  bus::Lease again = CommitAndLeaseAgain(a, b);
  EXPECT_EQ(b.Send(again, Bytes(again)).kind, bus::AckKind::kDuplicate) << "the same bytes";
  EXPECT_EQ(running->progress().rechecked, 1u);
  EXPECT_EQ(running->progress().mismatched, 0u);

  again = CommitAndLeaseAgain(a, b);
  std::vector<std::uint8_t> altered = Bytes(again);
  altered.back() ^= 1;
  const bus::Verdict refused = b.Send(again, altered);
  EXPECT_EQ(refused.kind, bus::AckKind::kRefused);
  EXPECT_THAT(refused.reason, HasSubstr("'lab-2' (worker b)"));
  EXPECT_THAT(refused.reason, HasSubstr("'lab-1' (worker a)"));
  EXPECT_EQ(running->progress().refused, 0u) << "not an unfit episode: nobody knows who is right";

  again = CommitAndLeaseAgain(a, b);
  EXPECT_FALSE(running->progress().complete) << "the last one is still being made again";
  b.raw().Report(again, running->id(), SpecHash(spec_), "plan_failed");
  EXPECT_EQ(b.Ask().kind, bus::LeaseKind::kDone);
  EXPECT_EQ(a.Ask().kind, bus::LeaseKind::kDone);
  running.Join();

  EXPECT_THAT(running.status(), IsOk());
  EXPECT_EQ(running->progress().committed, 3u);
  EXPECT_EQ(running->progress().rechecked, 3u);
  EXPECT_EQ(running->progress().mismatched, 2u);
  EXPECT_EQ(running->progress().attempts, 3u) << "no failed attempts";
  const auto mismatches = Mismatches();
  ASSERT_EQ(mismatches.size(), 2u);
  EXPECT_EQ(mismatches[0]["host"], "lab-2");
  EXPECT_EQ(mismatches[0]["committed_host"], "lab-1");
  EXPECT_NE(mismatches[0]["sha256"], mismatches[0]["committed_sha256"]);
  EXPECT_EQ(mismatches[1]["outcome"], "plan_failed");
  const auto report = store::Verify(folder_ / "data", store::Quarantine::kNo);
  ASSERT_THAT(report, IsOk());
  EXPECT_EQ(report->good, 3u);
  const auto reader = store::DatasetReader::Open(folder_ / "data");
  ASSERT_THAT(reader, IsOk());
  for (std::uint64_t index = 0; index < 3; ++index) {
    const auto kept = reader->ReadWhole(index);
    ASSERT_THAT(kept, IsOk());
    EXPECT_EQ(EncodeEpisode(*kept), EncodeEpisode(FakeEpisode(spec_, index, kept->attempt))) << "never overwritten";
  }
}

TEST_F(Recheck, ARestartKnowsOfTheDifferencesAndCountsThemAgainstNoIndex) {
  {
    Running running(std::move(*Open()));
    HostWorker a(running, spec_, "a", "lab-1"), b(running, spec_, "b", "lab-2");
    const bus::Lease again = CommitAndLeaseAgain(a, b);
    std::vector<std::uint8_t> altered = Bytes(again);
    altered.front() ^= 1;  // no episode at all
    EXPECT_EQ(b.Send(again, altered).kind, bus::AckKind::kRefused);
  }
  auto collector = Open();
  ASSERT_THAT(collector, IsOk());
  EXPECT_EQ(collector->progress().mismatched, 1u);
  EXPECT_EQ(collector->progress().rechecked, 0u);
  EXPECT_TRUE(collector->progress().failures.empty());
  EXPECT_EQ(collector->progress().attempts, 1u);
  EXPECT_EQ(collector->progress().given_up, 0u);
}

TEST_F(Recheck, WithoutASecondHostTheCampaignCompletes) {
  Running running(std::move(*Open()));
  auto worker =
      Process::Start({.argv = {(ProgramFolder() / "fake_worker").string(), spec_.name, std::to_string(kDomain), "0"},
                      .log = folder_ / "w.log"});
  ASSERT_THAT(worker, IsOk());
  running.Join();
  EXPECT_THAT(running.status(), IsOk());
  EXPECT_TRUE(running->progress().complete);
  EXPECT_EQ(running->progress().committed, 3u);
  EXPECT_EQ(running->progress().rechecked, 0u);
}

}  // namespace recheck_test
}  // namespace etude::campaign
