// SPDX-License-Identifier: Apache-2.0
// Tests services/campaign/collector_control.cc: who is leased what, what reports and heartbeats do, and who is refused.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "services/bus/topic.h"
#include "services/campaign/history.h"
#include "services/campaign/lease_table.h"
#include "services/campaign/process.h"
#include "services/campaign/worker_client.h"
#include "services/core/clock.h"
#include "services/core/file.h"
#include "tests/services/campaign/collector_fixture.h"

namespace etude::campaign {
namespace collector_control_test {

class CollectorControl : public CollectorTest {};

// A worker's report may hold any bytes, and its outcome becomes a key of JSON.
TEST_F(CollectorControl, AnOutcomeOfAnyBytesIsCountedAndEndsNothing) {
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

TEST_F(CollectorControl, OnlyReportsOfThisCampaignAndSpecCount) {
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
  EXPECT_NE(worker.Ask().token, lease.token);
  EXPECT_EQ(running->progress().failures.at("plan_failed"), 1u);
}

// The next attempt is made instead of one that crashed three children, and a collector that is started again knows it.
TEST_F(CollectorControl, AnAttemptThatCrashesWorkersHasFailed) {
  const CampaignSpec spec = Spec("deadly", 1);
  {
    Running running(std::move(*Open(spec, folder_ / "data")));
    RawWorker worker(*participant_, spec, running->id(), "worker");
    for (int death = 1; death <= 3; ++death) {
      const bus::Lease lease = worker.Ask();
      ASSERT_EQ(lease.kind, bus::LeaseKind::kWork);
      EXPECT_EQ(lease.attempt, 0u) << "death " << death;
      worker.Report(lease, running->id(), SpecHash(spec), kReleased,
                    R"({"reason": "child_crashed", "by_attempt": true, "ended_by": "signal SIGSEGV"})");
    }
    EXPECT_EQ(worker.Ask().attempt, 1u);
    EXPECT_EQ(running->progress().failures.at(kKillsWorkers), 1u);
    EXPECT_EQ(running->progress().failures.at(kChildCrashed), 3u);
  }
  EXPECT_THAT(ReadTextFile(folder_ / "data/attempts.jsonl").value(), testing::HasSubstr("SIGSEGV"));
}

// More of them than an index has attempts.
TEST_F(CollectorControl, ForgedReportsGiveNothingUp) {
  CampaignSpec spec = Spec("forged", 2);
  spec.max_attempts = 2;
  Running running(std::move(*Open(spec, folder_ / "data")));
  RawWorker holder(*participant_, spec, running->id(), "holder"), thief(*participant_, spec, running->id(), "thief");
  const bus::Lease held = holder.Ask();
  ASSERT_EQ(held.kind, bus::LeaseKind::kWork);
  const bus::Lease own = thief.Ask();
  ASSERT_EQ(own.kind, bus::LeaseKind::kWork);

  constexpr int kForged = 20;
  for (int k = 1; k <= kForged; ++k) {
    thief.Report(held, running->id(), SpecHash(spec));  // with the token that it overheard
    thief.Report(held, running->id(), SpecHash(spec), kReleased);
    bus::Lease guess = held;  // in the holder's name
    guess.token = own.token + static_cast<std::uint64_t>(k);
    holder.Report(guess, running->id(), SpecHash(spec));
    guess.token = held.token + static_cast<std::uint64_t>(k);
    holder.Report(guess, running->id(), SpecHash(spec));
  }
  EXPECT_EQ(thief.Ask().token, own.token) << "the reports before it were seen before the request";
  EXPECT_EQ(holder.Ask().token, held.token);
  const CollectorProgress progress = running->progress();
  EXPECT_TRUE(progress.failures.empty());
  EXPECT_EQ(progress.given_up, 0u);
  EXPECT_EQ(progress.stale_results, std::uint64_t{4} * kForged);

  // a report that counted once counts no more when it is said again
  holder.Report(held, running->id(), SpecHash(spec));
  const bus::Lease next = holder.Ask();
  EXPECT_EQ(next.attempt, 1u);
  holder.Report(held, running->id(), SpecHash(spec));
  EXPECT_EQ(holder.Ask().token, next.token);
  EXPECT_EQ(running->progress().given_up, 0u);
}

// All that a worker says of its lease while it works, said again as reports in its own name.
TEST_F(CollectorControl, WhatIsOverheardOfAWorkerGivesNothingUp) {
  CampaignSpec spec = Spec("overheard", 2);
  spec.max_attempts = 2;
  Running running(std::move(*Open(spec, folder_ / "data")));
  auto statuses = bus::Reader<bus::WorkerStatus>::Open(*participant_, PartitionOf(running, spec));
  auto requests = bus::Reader<bus::WorkRequest>::Open(*participant_, PartitionOf(running, spec));
  ASSERT_TRUE(statuses && requests);
  Process worker = StartPrefetching(spec, folder_ / "w.log", 3'600'000);
  bus::WorkerStatus heard;
  std::uint64_t working_on = 0;
  ASSERT_TRUE(WaitFor([&] {
    for (const auto& status : statuses->Take())
      if (status.token != 0) heard = status;
    for (const auto& request : requests->Take()) working_on = std::max(working_on, request.working_on);
    return heard.token != 0 && working_on != 0;
  })) << ReadTextFile(folder_ / "w.log").value_or("");

  RawWorker forger(*participant_, spec, running->id(), heard.worker);
  bus::Lease lease;
  lease.index = heard.index;
  lease.attempt = heard.attempt;
  EXPECT_TRUE(WaitFor([&] {
    for (const std::uint64_t token : {heard.token, working_on}) {
      lease.token = token;
      forger.Report(lease, running->id(), SpecHash(spec));
      forger.Report(lease, running->id(), SpecHash(spec), kReleased);
    }
    return running->progress().stale_results >= 8;
  }));
  EXPECT_TRUE(running->progress().failures.empty());
  EXPECT_EQ(running->progress().given_up, 0u);
  EXPECT_EQ(running->progress().lost_leases, 0u) << "its own heartbeats renew it";
}

TEST_F(CollectorControl, AHostsLeasesAreNotSeenByOthers) {
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
TEST_F(CollectorControl, TwoWorkersOfOneHostAndNameDoNotBothWork) {
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
TEST_F(CollectorControl, AWorkerThatNamesNoHostIsRefused) {
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
    EXPECT_TRUE(WaitFor([&] {
      EXPECT_TRUE(requests->Write(request));
      if (everybody->Wait(200ms)) told = everybody->Take();
      return !told.empty();
    }));
    ASSERT_FALSE(told.empty()) << host;
    EXPECT_EQ(told.front().kind, bus::LeaseKind::kRefused) << host;
    EXPECT_NE(told.front().reason.find("host"), std::string::npos) << told.front().reason;
  }
}

TEST_F(CollectorControl, WorkersThatAreReadyForAnotherSpecWaitAndThoseOfAnotherWireAreRefused) {
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

TEST_F(CollectorControl, WorkersWithOtherFilesOfTheUserAreRefusedAlsoAfterARestart) {
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
TEST_F(CollectorControl, FilesThatWereMendedBeforeTheFirstEpisodeBeginAnew) {
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
    EXPECT_TRUE(WaitFor([&] { return running->progress().given_up == 1; }));
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

TEST_F(CollectorControl, HostsWhoseBytesDifferFromTheFirstOnesAreRefusedUnlessTheCampaignAllowsThem) {
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

TEST_F(CollectorControl, AWorkerMayHoldItsNextLeaseUnlessTheCampaignIsPaused) {
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
  EXPECT_TRUE(WaitFor([&] {
    statuses->Wait(200ms);
    const auto taken = statuses->Take();
    return std::ranges::any_of(taken, [](const bus::CampaignStatus& status) { return status.state == "paused"; });
  }));
  other.request.working_on = MarkOf(of_other.token);
  EXPECT_EQ(other.Ask().kind, bus::LeaseKind::kWait) << "nothing new";
  EXPECT_EQ(IndexAhead(worker, lease), 1u) << "what it holds it goes on with";
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
    status_.token = MarkOf(lease.token);
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

TEST_F(CollectorControl, AWorkerThatBeatsAndDoesNotMoveLosesItsLease) {
  CampaignSpec spec = Spec("stall", 2);
  spec.stall_timeout_s = 3;
  Running running(std::move(*Open(spec, folder_ / "data")));
  RawWorker hung(*participant_, spec, running->id(), "hung"), moving(*participant_, spec, running->id(), "moving");
  const bus::Lease stuck = hung.Ask(), at_work = moving.Ask();
  Beating still(*participant_, running, spec, stuck, "hung"), moves(*participant_, running, spec, at_work, "moving");

  std::vector<std::string> silent;
  std::uint32_t step = 0;
  EXPECT_TRUE(WaitFor([&] {
    still.Beat(7);
    moves.Beat(++step);
    for (const auto& name : running->TakeSilent()) silent.push_back(name);
    return !silent.empty();
  }));

  EXPECT_EQ(silent, std::vector<std::string>{"hung"}) << "its supervisor is told; the other one moves";
  EXPECT_EQ(running->progress().lost_leases, 1u);
  EXPECT_EQ(running->progress().failures.at("stalled"), 1u);
  RawWorker next(*participant_, spec, running->id(), "next");
  const bus::Lease again = next.Ask();
  EXPECT_EQ(again.index, stuck.index);
  EXPECT_EQ(again.attempt, stuck.attempt) << "the attempt is not counted";
  EXPECT_NE(again.token, stuck.token);
}

TEST_F(CollectorControl, AWorkerThatWasAwayAtTheEndIsSentHomeWhenItComesBack) {
  const CampaignSpec spec = Spec("away", 1);
  CollectorOptions options = QuickOptions();
  options.drain = 2s;
  options.away = 60s;
  Running running(std::move(*Collector::Open(*participant_, spec, folder_ / "data", options)));
  RawWorker away(*participant_, spec, running->id(), "away");
  const bus::Lease lost = away.Ask();
  ASSERT_EQ(lost.kind, bus::LeaseKind::kWork);
  Process worker = StartWorker(spec, folder_ / "w.log", 0);
  ASSERT_TRUE(WaitFor([&] { return running->progress().complete; })) << "with the lease that the other one lost";
  const Stopwatch since;
  ASSERT_TRUE(WaitFor([&] { return running->progress().workers == 0 && since.Seconds() > 3; })) << "nobody is heard";

  // it beats before it asks again
  Beating back(*participant_, running, spec, lost, "away");
  back.Beat(1);
  ASSERT_TRUE(WaitFor([&] { return running->progress().workers == 1; }));
  EXPECT_EQ(away.Ask().kind, bus::LeaseKind::kDone);
  running.Join();
}

TEST_F(CollectorControl, WhoWasToldOrSaidGoodbyeDelaysNoEnd) {
  const CampaignSpec spec = Spec("told", 2);
  CollectorOptions options = QuickOptions();
  options.away = CollectorOptions().away;
  ASSERT_GE(options.away, 60s) << "an outage of a minute";
  Running running(std::move(*Collector::Open(*participant_, spec, folder_ / "data", options)));
  {
    Process leaves = StartWorker(spec, folder_ / "leaves.log", 3'600'000);
    ASSERT_TRUE(WaitFor([&] { return running->progress().workers == 1; }));
    EXPECT_EQ(leaves.Stop(20s), 0);
  }
  Process told = StartWorker(spec, folder_ / "told.log", 0);
  ASSERT_TRUE(WaitFor([&] { return running->progress().complete; }));
  const Stopwatch ending;
  running.Join();
  EXPECT_LT(ending.Seconds(), 30);
  EXPECT_EQ(told.Wait(10s), 0);
}

TEST_F(CollectorControl, APolicyThatDoesNotAnswerDropsNoRolloutAndEndsTheEvaluationWithWords) {
  CampaignSpec spec = Spec("outage", 1);
  spec.mode = "rollout";
  spec.rollout.run = "run";
  spec.max_attempts = 2;
  CollectorOptions options = QuickOptions();
  options.policy_patience = 5s;  // the failures before its end come within it
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

  const auto outage = MonotonicClock::now() + options.policy_patience;
  ASSERT_TRUE(WaitFor([&] { return MonotonicClock::now() > outage; }));
  fail();
  running.Join();
  ASSERT_FALSE(running.status());
  EXPECT_EQ(running.status().error().code, Code::kUnavailable);
  EXPECT_NE(running.status().error().message.find("no answer of 'run'"), std::string::npos)
      << running.status().error().message;

  EXPECT_FALSE(KnownStopped(folder_ / "data")) << "nobody stopped it";

  // and the next start begins where it was
  owner.reset();
  auto again = Collector::Open(*participant_, spec, folder_ / "data", options);
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(again->progress().given_up, 0u);
}

TEST_F(CollectorControl, APolicyThatIsForSomethingElseEndsTheEvaluationAtOnce) {
  CampaignSpec spec = Spec("unfit_policy", 1);
  spec.mode = "rollout";
  spec.rollout.run = "run";
  CollectorOptions options = QuickOptions();
  options.policy_patience = 1h;
  auto collector = Collector::Open(*participant_, spec, folder_ / "data", options);
  ASSERT_TRUE(collector) << collector.error().message;
  Running running(std::move(*collector));
  RawWorker worker(*participant_, spec, running->id(), "raw");
  worker.Report(worker.Ask(), running->id(), SpecHash(spec), kPolicyError,
                R"({"reason": "robot: ur5 here, panda there", "refused": true})");
  running.Join();
  ASSERT_FALSE(running.status());
  EXPECT_EQ(running.status().error().code, Code::kInvalidArgument);
  EXPECT_NE(running.status().error().message.find("ur5 here, panda there"), std::string::npos)
      << running.status().error().message;
  EXPECT_FALSE(KnownStopped(folder_ / "data"));
}

}  // namespace collector_control_test
}  // namespace etude::campaign
