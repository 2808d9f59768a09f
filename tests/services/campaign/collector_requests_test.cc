// SPDX-License-Identifier: Apache-2.0
// Who is leased what, and who is refused.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "services/bus/topic.h"
#include "tests/services/campaign/collector_fixture.h"
#include "tests/support/wait_until.h"

namespace etude::campaign {
namespace collector_requests_test {

class CollectorRequests : public CollectorTest {};

TEST_F(CollectorRequests, AHostsLeasesAreNotSeenByOthers) {
  const CampaignSpec spec = Spec("hosts", 40);
  Running running(std::move(*Open(spec, folder_ / "data")));
  const auto one = bus::Participant::Open({kCollectorDomain, "", "", {}, "rack-1"});
  const auto two = bus::Participant::Open({kCollectorDomain, "", "", {}, "rack-2"});
  ASSERT_TRUE(one && two);
  RawWorker worker(*one, spec, running->id(), "worker-1"), other(*two, spec, running->id(), "worker-2");
  const bus::Owner owner{spec.name, running->id()};
  auto neighbour = bus::Reader<bus::Lease>::Open(*two, owner.address_partition("rack-2"));
  auto everybody = bus::Reader<bus::Lease>::Open(*two, owner.partition());
  ASSERT_TRUE(neighbour && everybody);
  constexpr int kOthers = 3;
  for (int k = 0; k < kOthers; ++k) EXPECT_EQ(other.Ask().kind, bus::LeaseKind::kWork);
  for (int k = 0; k < 20; ++k) {
    const bus::Lease lease = worker.Ask();
    ASSERT_EQ(lease.kind, bus::LeaseKind::kWork);
    ASSERT_EQ(worker.Send(lease, FakeEpisode(spec, lease.index, lease.attempt)).kind, bus::AckKind::kDone);
  }
  const auto heard = neighbour->Take();
  EXPECT_GE(heard.size(), std::size_t{kOthers});
  for (const auto& lease : heard) EXPECT_EQ(lease.worker, "worker-2");
  EXPECT_TRUE(everybody->Take().empty());
  EXPECT_EQ(everybody->matched_writers(), 0);
}

// One that was started again takes its own lease over; two that run would make every attempt twice.
TEST_F(CollectorRequests, TwoWorkersOfOneHostAndNameDoNotBothWork) {
  const CampaignSpec spec = Spec("namesakes", 3);
  Running running(std::move(*Open(spec, folder_ / "data")));
  const auto first = bus::Participant::Open({kCollectorDomain, "", "", {}, "lab--00000001"});
  const auto second = bus::Participant::Open({kCollectorDomain, "", "", {}, "lab--00000002"});
  ASSERT_TRUE(first && second);
  RawWorker one(*first, spec, running->id(), "worker"), two(*second, spec, running->id(), "worker");
  const bus::Lease lease = one.Ask();
  ASSERT_EQ(lease.kind, bus::LeaseKind::kWork);

  EXPECT_EQ(two.Ask().token, lease.token) << "as if it were the first one, started again";
  EXPECT_EQ(one.Ask().kind, bus::LeaseKind::kWait) << "it is not";
  EXPECT_EQ(two.Ask().token, lease.token);
  ASSERT_EQ(two.Send(lease, FakeEpisode(spec, lease.index, lease.attempt)).kind, bus::AckKind::kDone);
  EXPECT_EQ(one.Ask().kind, bus::LeaseKind::kWork) << "its namesake holds nothing";
  EXPECT_EQ(two.Ask().kind, bus::LeaseKind::kWait);
}

// It could not be told in its partition: it is, where everybody listens who does not know of hosts.
TEST_F(CollectorRequests, AWorkerThatNamesNoHostIsRefused) {
  const CampaignSpec spec = Spec("nowhere", 3);
  Running running(std::move(*Open(spec, folder_ / "data")));
  auto everybody = bus::Reader<bus::Lease>::Open(*participant_, PartitionOf(running, spec));
  auto requests = bus::Writer<bus::WorkRequest>::Open(*participant_, PartitionOf(running, spec));
  ASSERT_TRUE(everybody && requests && requests->WaitForReaders(1, 20s));
  for (const char* host : {"", "*", "a/b"}) {
    bus::WorkRequest request{.campaign = spec.name, .worker = "nowhere", .campaign_id = running->id()};
    request.spec_sha256 = SpecHash(spec);
    request.content = kContentVersion;
    request.host = host;
    std::vector<bus::Lease> told;
    EXPECT_TRUE(WaitUntil([&] {
      EXPECT_TRUE(requests->Write(request));
      if (everybody->Wait(200ms)) told = everybody->Take();
      return !told.empty();
    }));
    ASSERT_FALSE(told.empty()) << host;
    EXPECT_EQ(told.front().kind, bus::LeaseKind::kRefused) << host;
    EXPECT_NE(told.front().reason.find("host"), std::string::npos) << told.front().reason;
  }
}

TEST_F(CollectorRequests, WorkersThatAreReadyForAnotherSpecWaitAndThoseOfAnotherWireAreRefused) {
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

TEST_F(CollectorRequests, WorkersWithOtherFilesOfTheUserAreRefusedAlsoAfterARestart) {
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
      EXPECT_NE(other.Ask().reason.find("nothing is committed yet"), std::string::npos)
          << "the first one may be the odd one";
      EXPECT_EQ(same.Send(lease, FakeEpisode(spec, lease.index, lease.attempt)).kind, bus::AckKind::kDone);
    }
    const bus::Lease refused = other.Ask();
    EXPECT_EQ(refused.kind, bus::LeaseKind::kRefused);
    EXPECT_NE(refused.reason.find("other robot or object files"), std::string::npos) << refused.reason;
    EXPECT_EQ(same.Ask().kind, bus::LeaseKind::kWork);
  }
}

// A robot file that lets nothing succeed, mended: the dataset is the one that the mended file makes from the start.
TEST_F(CollectorRequests, FilesThatWereMendedBeforeTheFirstEpisodeBeginAnew) {
  CampaignSpec spec = Spec("mended", 1);
  spec.max_attempts = 2;
  {
    Running running(std::move(*Open(spec, folder_ / "data")));
    RawWorker worker(*participant_, spec, running->id(), "before", "a");
    for (std::uint32_t attempt = 0; attempt < 2; ++attempt) {
      const bus::Lease lease = worker.Ask();
      ASSERT_EQ(lease.kind, bus::LeaseKind::kWork);
      EXPECT_EQ(lease.attempt, attempt);
      worker.Report(lease, running->id(), SpecHash(spec));
    }
    EXPECT_TRUE(WaitUntil([&] { return running->progress().given_up == 1; }));
  }
  Running running(std::move(*Open(spec, folder_ / "data")));
  RawWorker worker(*participant_, spec, running->id(), "after", "b");
  const bus::Lease lease = worker.Ask();
  ASSERT_EQ(lease.kind, bus::LeaseKind::kWork);
  EXPECT_EQ(lease.attempt, 0u);
  EXPECT_EQ(worker.Send(lease, FakeEpisode(spec, lease.index, lease.attempt)).kind, bus::AckKind::kDone);
  EXPECT_TRUE(running->progress().failures.empty());
  EXPECT_TRUE(std::filesystem::exists(folder_ / "data/attempts.1.jsonl")) << "what failed before, for people";
}

TEST_F(CollectorRequests, HostsWhoseBytesDifferFromTheFirstOnesAreRefusedUnlessTheCampaignAllowsThem) {
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
  EXPECT_NE(refused_at_start(0, "bytes").find("picture: here bb, there aa"), std::string::npos);
  EXPECT_EQ(refused_at_start(1, "physics"), "") << "pictures may differ; and the dataset goes on";
  EXPECT_NE(refused_at_start(2, "bytes").find("picture: here bb, there aa"), std::string::npos) << "remembered";
}

// Which of them a worker that was told `lease` holds beside it.
std::uint64_t IndexAhead(RawWorker& worker, const bus::Lease& lease) {
  worker.request.working_on = MarkOf(lease.token);
  const bus::Lease next = worker.Ask();
  EXPECT_EQ(next.kind, bus::LeaseKind::kWork);
  worker.request.working_on = 0;
  return next.index;
}

TEST_F(CollectorRequests, AWorkerMayHoldItsNextLeaseUnlessTheCampaignIsPaused) {
  const CampaignSpec spec = Spec("ahead", 8);
  CollectorOptions options = QuickOptions();
  options.lease = 60s;
  Running running(std::move(*Collector::Open(*participant_, spec, folder_ / "data", options)));
  RawWorker worker(*participant_, spec, running->id(), "worker"), other(*participant_, spec, running->id(), "other");
  const bus::Lease lease = worker.Ask();
  EXPECT_EQ(IndexAhead(worker, lease), 1u);
  EXPECT_EQ(IndexAhead(worker, lease), 1u) << "one, however often it asks";
  EXPECT_EQ(worker.Ask().token, lease.token);
  const bus::Lease of_other = other.Ask();
  EXPECT_EQ(of_other.index, 2u);

  auto controls = bus::Writer<bus::CampaignControl>::Open(*participant_, PartitionOf(running, spec));
  auto statuses = bus::Reader<bus::CampaignStatus>::Open(*participant_, PartitionOf(running, spec));
  ASSERT_TRUE(controls && statuses && controls->WaitForReaders(1, 20s));
  bus::CampaignControl pause{.campaign = spec.name, .control_id = "pause", .campaign_id = running->id()};
  ASSERT_TRUE(controls->Write(pause));
  EXPECT_TRUE(WaitUntil([&] {
    statuses->Wait(200ms);
    const auto taken = statuses->Take();
    return std::ranges::any_of(taken, [](const bus::CampaignStatus& status) { return status.state == "paused"; });
  }));
  other.request.working_on = MarkOf(of_other.token);
  EXPECT_EQ(other.Ask().kind, bus::LeaseKind::kWait) << "nothing new";
  EXPECT_EQ(IndexAhead(worker, lease), 1u) << "what it holds it goes on with";
}

}  // namespace collector_requests_test
}  // namespace etude::campaign
