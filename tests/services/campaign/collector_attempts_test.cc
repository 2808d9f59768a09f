// SPDX-License-Identifier: Apache-2.0
// What reports, heartbeats and silence do.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "services/bus/topic.h"
#include "services/campaign/lease_table.h"
#include "services/campaign/process.h"
#include "services/campaign/worker_client.h"
#include "services/core/clock.h"
#include "services/core/file.h"
#include "services/spec/attempt_outcome.h"
#include "tests/services/campaign/collector_fixture.h"
#include "tests/services/campaign/says_stopped.h"
#include "tests/support/wait_until.h"

namespace etude::campaign {
namespace collector_attempts_test {

class CollectorAttempts : public CollectorTest {};

// A worker's report may hold any bytes, and its outcome becomes a key of JSON.
TEST_F(CollectorAttempts, AnOutcomeOfAnyBytesIsCountedAndEndsNothing) {
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
  ASSERT_TRUE(WaitUntil([&] { return running->progress().failures.contains("unnamed"); }));
  // also where nothing is committed afterwards, what failed is in what is derived
  const auto in_index = [&] {
    const auto text = ReadTextFile(folder_ / "data/dataset.json");
    const auto json = OrderedJson::parse(text.value_or("{}"));
    return json.contains("statistics") && json["statistics"].contains("failed_attempts") &&
           json["statistics"]["failed_attempts"].contains("unnamed");
  };
  EXPECT_TRUE(WaitUntil(in_index));
  EXPECT_EQ(worker.Ask().kind, bus::LeaseKind::kWork) << "it goes on";
}

TEST_F(CollectorAttempts, OnlyReportsOfThisCampaignAndSpecCount) {
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
TEST_F(CollectorAttempts, AnAttemptThatCrashesWorkersHasFailed) {
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

// A rollout's scene and policy are what they were: before, the next attempt's was made and refused for ever.
TEST_F(CollectorAttempts, ARolloutThatCrashesWorkersIsGivenUp) {
  CampaignSpec spec = Spec("deadly-rollout", 1);
  spec.mode = "rollout";
  spec.rollout.run = "run";
  Running running(std::move(*Open(spec, folder_ / "data")));
  RawWorker worker(*participant_, spec, running->id(), "worker");
  for (int death = 1; death <= 3; ++death) {
    const bus::Lease lease = worker.Ask();
    ASSERT_EQ(lease.kind, bus::LeaseKind::kWork);
    worker.Report(lease, running->id(), SpecHash(spec), kReleased,
                  R"({"reason": "child_crashed", "by_attempt": true, "ended_by": "signal SIGBUS"})");
  }
  EXPECT_EQ(worker.Ask().kind, bus::LeaseKind::kDone);
  EXPECT_EQ(running->progress().given_up, 1u);
}

// More of them than an index has attempts.
TEST_F(CollectorAttempts, ForgedReportsGiveNothingUp) {
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
TEST_F(CollectorAttempts, WhatIsOverheardOfAWorkerGivesNothingUp) {
  CampaignSpec spec = Spec("overheard", 2);
  spec.max_attempts = 2;
  Running running(std::move(*Open(spec, folder_ / "data")));
  auto statuses = bus::Reader<bus::WorkerStatus>::Open(*participant_, PartitionOf(running, spec));
  auto requests = bus::Reader<bus::WorkRequest>::Open(*participant_, PartitionOf(running, spec));
  ASSERT_TRUE(statuses && requests);
  Process worker = StartPrefetching(spec, folder_ / "w.log", 3'600'000);
  bus::WorkerStatus heard;
  std::uint64_t working_on = 0;
  ASSERT_TRUE(WaitUntil([&] {
    for (const auto& status : statuses->Take())
      if (status.token != 0) heard = status;
    for (const auto& request : requests->Take()) working_on = std::max(working_on, request.working_on);
    return heard.token != 0 && working_on != 0;
  })) << ReadTextFile(folder_ / "w.log").value_or("");

  RawWorker forger(*participant_, spec, running->id(), heard.worker);
  bus::Lease lease;
  lease.index = heard.index;
  lease.attempt = heard.attempt;
  EXPECT_TRUE(WaitUntil([&] {
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
  void SayGoodbye() {
    status_.phase = bus::kGonePhase;
    EXPECT_TRUE(writer_.Write(status_));
  }

 private:
  bus::Writer<bus::WorkerStatus> writer_;
  bus::WorkerStatus status_;
};

// a driver that hangs while the first picture is drawn: the thread that beats goes on
TEST_F(CollectorAttempts, AWorkerThatBeatsAndNeverAsksIsNamedToItsSupervisor) {
  CampaignSpec spec = Spec("unready", 2);
  spec.stall_timeout_s = 1;
  CollectorOptions soon;
  soon.ready = 5s;
  Running running(std::move(*Collector::Open(*participant_, spec, folder_ / "data", soon)));
  Beating hung(*participant_, running, spec, bus::Lease{}, "hung");
  std::vector<std::string> silent;
  EXPECT_TRUE(WaitUntil([&] {
    hung.Beat(0);
    for (const auto& name : running->TakeSilent()) silent.push_back(name);
    return !silent.empty();
  }));
  EXPECT_EQ(silent, std::vector<std::string>{"hung"});
  EXPECT_EQ(running->progress().lost_leases, 0u);
}

TEST_F(CollectorAttempts, AWorkerThatBeatsAndDoesNotMoveLosesItsLease) {
  CampaignSpec spec = Spec("stall", 2);
  spec.stall_timeout_s = 3;
  Running running(std::move(*Open(spec, folder_ / "data")));
  RawWorker hung(*participant_, spec, running->id(), "hung"), moving(*participant_, spec, running->id(), "moving");
  const bus::Lease stuck = hung.Ask(), at_work = moving.Ask();
  Beating still(*participant_, running, spec, stuck, "hung"), moves(*participant_, running, spec, at_work, "moving");

  std::vector<std::string> silent;
  std::uint32_t step = 0;
  EXPECT_TRUE(WaitUntil([&] {
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

TEST_F(CollectorAttempts, AWorkerThatWasAwayAtTheEndIsSentHomeWhenItComesBack) {
  const CampaignSpec spec = Spec("away", 1);
  CollectorOptions options = QuickOptions();
  options.drain = 2s;
  options.away = 60s;
  Running running(std::move(*Collector::Open(*participant_, spec, folder_ / "data", options)));
  RawWorker away(*participant_, spec, running->id(), "away");
  const bus::Lease lost = away.Ask();
  ASSERT_EQ(lost.kind, bus::LeaseKind::kWork);
  Process worker = StartWorker(spec, folder_ / "w.log", 0);
  ASSERT_TRUE(WaitUntil([&] { return running->progress().complete; })) << "with the lease that the other one lost";
  const Stopwatch since;
  ASSERT_TRUE(WaitUntil([&] { return running->progress().workers == 0 && since.Seconds() > 3; })) << "nobody is heard";

  // it beats before it asks again
  Beating back(*participant_, running, spec, lost, "away");
  back.Beat(1);
  ASSERT_TRUE(WaitUntil([&] { return running->progress().workers == 1; }));
  EXPECT_EQ(away.Ask().kind, bus::LeaseKind::kDone);
  running.Join();
}

TEST_F(CollectorAttempts, WhoWasToldOrSaidGoodbyeDelaysNoEnd) {
  const CampaignSpec spec = Spec("told", 2);
  CollectorOptions options = QuickOptions();
  options.away = CollectorOptions().away;
  ASSERT_GE(options.away, 60s) << "an outage of a minute";
  Running running(std::move(*Collector::Open(*participant_, spec, folder_ / "data", options)));
  {
    Process leaves = StartWorker(spec, folder_ / "leaves.log", 3'600'000);
    ASSERT_TRUE(WaitUntil([&] { return running->progress().workers == 1; }));
    EXPECT_EQ(leaves.Stop(20s), 0);
  }
  Process told = StartWorker(spec, folder_ / "told.log", 0);
  ASSERT_TRUE(WaitUntil([&] { return running->progress().complete; }));
  const Stopwatch ending;
  running.Join();
  EXPECT_LT(ending.Seconds(), 30);
  EXPECT_EQ(told.Wait(10s), 0);
}

TEST_F(CollectorAttempts, APolicyThatDoesNotAnswerDropsNoRolloutAndEndsTheEvaluationWithWords) {
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
  ASSERT_TRUE(WaitUntil([&] { return !running->progress().error.empty(); }));
  EXPECT_NE(running->progress().error.find("no answer of 'run'"), std::string::npos) << running->progress().error;
  EXPECT_EQ(running->progress().given_up, 0u);

  const auto outage = MonotonicClock::now() + options.policy_patience;
  ASSERT_TRUE(WaitUntil([&] { return MonotonicClock::now() > outage; }));
  fail();
  running.Join();
  ASSERT_FALSE(running.status());
  EXPECT_EQ(running.status().error().code, Code::kUnavailable);
  EXPECT_NE(running.status().error().message.find("no answer of 'run'"), std::string::npos)
      << running.status().error().message;

  EXPECT_FALSE(SaysStopped(folder_ / "data")) << "nobody stopped it";

  // and the next start begins where it was
  owner.reset();
  auto again = Collector::Open(*participant_, spec, folder_ / "data", options);
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(again->progress().given_up, 0u);
}

// A night without workers is no night without the policy: before, the first late answer of the morning ended it.
TEST_F(CollectorAttempts, WhileNobodyAsksThePolicyItsSilenceSaysNothing) {
  CampaignSpec spec = Spec("night", 1);
  spec.mode = "rollout";
  spec.rollout.run = "run";
  CollectorOptions options = QuickOptions();
  options.policy_patience = 4s;
  Running running(std::move(*Collector::Open(*participant_, spec, folder_ / "data", options)));
  RawWorker worker(*participant_, spec, running->id(), "raw");
  const auto fail = [&] {
    const bus::Lease lease = worker.Ask();
    ASSERT_EQ(lease.kind, bus::LeaseKind::kWork);
    worker.Report(lease, running->id(), SpecHash(spec), kPolicyError, R"({"reason": "no answer of 'run'"})");
  };
  fail();
  ASSERT_TRUE(WaitUntil([&] { return !running->progress().error.empty(); }));
  const Stopwatch outage;
  Beating(*participant_, running, spec, {}, "raw").SayGoodbye();
  EXPECT_TRUE(WaitUntil([&] { return running->progress().error.empty(); })) << "nobody waits for it";
  ASSERT_TRUE(WaitUntil([&] { return outage.Seconds() > 4; }));
  fail();
  EXPECT_EQ(worker.Ask().kind, bus::LeaseKind::kWork) << "it is waited for again";
}

TEST_F(CollectorAttempts, APolicyThatIsForSomethingElseEndsTheEvaluationAtOnce) {
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
  EXPECT_FALSE(SaysStopped(folder_ / "data"));
}

}  // namespace collector_attempts_test
}  // namespace etude::campaign
