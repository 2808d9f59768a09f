// SPDX-License-Identifier: Apache-2.0
// Tests services/campaign/worker_client.cc with a collector, in this process and in others.
#include "services/campaign/worker_client.h"

#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <cstdlib>
#include <functional>
#include <list>
#include <map>
#include <thread>
#include <vector>

#include "services/bus/topic.h"
#include "services/campaign/history.h"
#include "services/campaign/process.h"
#include "services/core/command.h"
#include "services/spec/attempt_outcome.h"
#include "services/spec/task_name.h"
#include "tests/services/campaign/collector_fixture.h"
#include "tests/support/wait_until.h"

namespace etude::campaign {
namespace worker_client_test {

class WorkerClientTest : public CollectorTest {};

/// A worker on a thread of its own, until it goes home; `seen` is told of each campaign that its work is made for.
class StandingWorker {
 public:
  StandingWorker(
      const bus::Participant& participant, const WorkerOptions& options,
      std::function<void(const JoinedCampaign&)> seen = [](const JoinedCampaign&) {})
      : thread_([&participant, options, seen = std::move(seen)] {
          auto client = WorkerClient::Open(participant, options);
          ASSERT_TRUE(client) << client.error().message;
          EXPECT_TRUE(client->Run([&](const JoinedCampaign& joined) -> Result<WorkFunction> {
            seen(joined);
            return [spec = joined.spec](const WorkItem& item) -> Result<WorkResult> { return FakeAttempt(spec, item); };
          }));
        }) {}
  void Join() { thread_.join(); }

 private:
  std::jthread thread_;
};

TEST_F(WorkerClientTest, WorkersOfAnotherContentNumberAreRefusedWithTheReason) {
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

// It used to refuse the other folder's campaign for ever, because its epoch was smaller, and to make episode 0 of the
// old one again each second.
TEST_F(WorkerClientTest, AStandingWorkerGoesOnWithTheNextCampaignOfItsName) {
  const CampaignSpec old = Spec("standing", 1000);
  Process worker = StartWorker(old, folder_ / "w.log", 1);
  for (int start = 0; start < 3; ++start) {
    auto collector = Open(old, folder_ / "old");
    ASSERT_TRUE(collector) << collector.error().message;
    Running running(std::move(*collector));
    const auto before = running->progress().committed;
    ASSERT_TRUE(WaitUntil([&] { return running->progress().committed > before; }));
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

// It kept what the file said when the first campaign began, and said that its spec had another hash here.
TEST_F(WorkerClientTest, AStandingWorkerReadsTheTaskFilesOfTheNextCampaign) {
  CampaignSpec spec = Spec("retold", 6);
  spec.tasks = {(folder_ / "own.yaml").string()};
  spec.task_weights.clear();
  const auto say = [&](const std::string& rise) {
    ASSERT_TRUE(WriteFileAtomically(spec.tasks[0],
                                    "name: own\nwords: {verbs: [take]}\nstages: [approach, reach, grasp, "
                                    "lift, hold]\nsuccess: {risen: {by: " +
                                        rise + "}}\n"));
    ForgetTaskFiles();  // this process is both campaigns' collector
  };
  say("3 cm");
  Process worker = StartWorker(spec, folder_ / "w.log", 1);
  {
    CampaignSpec first = spec;
    first.episodes = 1000;
    Running running(std::move(*Open(first, folder_ / "first")));
    ASSERT_TRUE(WaitUntil([&] { return running->progress().committed > 0; }))
        << ReadTextFile(folder_ / "w.log").value_or("");
  }
  say("5 cm");
  Running running(std::move(*Open(spec, folder_ / "second")));
  ASSERT_TRUE(WaitUntil([&] { return running->progress().complete || !worker.running(); }));
  ASSERT_TRUE(running->progress().complete) << ReadTextFile(folder_ / "w.log").value_or("");
  running.Join();

  ExpectWhole(spec, folder_ / "second");
  EXPECT_EQ(worker.Wait(10s), 0);
}

// Some episodes would have the robot as it was, and others as it is.
TEST_F(WorkerClientTest, AWorkerEndsWhenItsFilesChangeAndWhatItMadeOfThemIsNotKept) {
  const CampaignSpec spec = Spec("edited", 8);
  Running running(std::move(*Open(spec, folder_ / "data")));
  std::string content = std::string(64, 'a');
  WorkerOptions options;
  options.campaign = spec.name;
  options.files_sha256 = [&](const CampaignSpec&) -> Result<std::string> { return content; };
  constexpr std::uint64_t kEditedAt = 3;
  std::uint64_t made = 0;
  const auto work = [&] {
    auto client = WorkerClient::Open(*participant_, options);
    EXPECT_TRUE(client) << client.error().message;
    return client->Run([&](const JoinedCampaign& joined) -> Result<WorkFunction> {
      return [&, spec = joined.spec](const WorkItem& item) -> Result<WorkResult> {
        WorkResult result = FakeAttempt(spec, item);
        if (!result.episode.empty() && ++made == kEditedAt) content = std::string(64, 'b');
        return result;
      };
    });
  };
  const Status ended = work();
  ASSERT_FALSE(ended);
  EXPECT_EQ(ended.error().code, Code::kUnavailable);
  EXPECT_NE(ended.error().message.find("have changed"), std::string::npos) << ended.error().message;
  EXPECT_EQ(made, 3u);
  EXPECT_EQ(running->progress().committed, 2u);
  const Status refused = work();
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("other robot or object files"), std::string::npos) << refused.error().message;

  content = std::string(64, 'a');
  EXPECT_TRUE(work());
  running.Join();
  ExpectWhole(spec, folder_ / "data");
}

// The key is no part of the spec's hash: a standing worker went on with what it had heard first.
TEST_F(WorkerClientTest, AStandingWorkerIsAsPatientAsTheCollectorThatWasStartedAgain) {
  CampaignSpec spec = Spec("patience", 1000);
  spec.stall_timeout_s = 120;
  std::vector<double> patience;  // that its work was made with
  WorkerOptions options;
  options.campaign = spec.name;
  StandingWorker worker(*participant_, options,
                        [&](const JoinedCampaign& joined) { patience.push_back(joined.spec.stall_timeout_s); });
  const auto commit_some = [&](const CampaignSpec& now) {
    Running running(std::move(*Open(now, folder_ / "data")));
    const auto before = running->progress().committed;
    EXPECT_TRUE(WaitUntil([&] { return running->progress().committed > before; }));
  };
  commit_some(spec);
  spec.stall_timeout_s = 600;
  commit_some(spec);
  spec.episodes = 6;
  Running running(std::move(*Open(spec, folder_ / "data")));
  running.Join();
  worker.Join();
  EXPECT_EQ(patience, (std::vector<double>{120, 600})) << "and more or fewer episodes make nothing anew";
}

// before, it asked the server of the evaluation before, which had gone: each of its rollouts failed
TEST_F(WorkerClientTest, AStandingWorkerAsksThePolicyServerOfTheEvaluationThatGoesOn) {
  const CampaignSpec spec = Spec("policy", 1000);
  std::vector<std::string> asked;  // whom its work was made to ask
  WorkerOptions options;
  options.campaign = spec.name;
  StandingWorker worker(*participant_, options, [&](const JoinedCampaign& joined) {
    asked.push_back(joined.policy.substr(joined.policy.find('@') + 1));
  });
  const std::vector<std::string> servers{"aaaa000000000001", "bbbb000000000002"};
  CampaignSpec now = spec;
  const auto open = [&](const std::string& server) {
    CollectorOptions of_start;
    of_start.policy_id = server;
    return std::move(*Collector::Open(*participant_, now, folder_ / "data", of_start));
  };
  for (const auto& server : servers) {
    Running running(open(server));
    const auto before = running->progress().committed;
    EXPECT_TRUE(WaitUntil([&] { return running->progress().committed > before; }));
  }
  now.episodes = 6;  // it is complete, and the worker goes home
  Running running(open(servers.back()));
  running.Join();
  worker.Join();
  EXPECT_EQ(asked, servers);
}

TEST_F(WorkerClientTest, EachEpisodeIsRecordedWithItsHostsFingerprint) {
  CampaignSpec spec = Spec("printed", 40);
  spec.determinism = "physics";
  Running running(std::move(*Open(spec, folder_ / "data")));
  const auto print_of = [](const std::string& picture) { return Fingerprint{{"picture", picture}, {"physics", "cc"}}; };
  std::list<StandingWorker> hosts;
  for (const std::string picture : {"aa", "bb"}) {
    WorkerOptions options;
    options.campaign = spec.name;
    options.name = "host-" + picture;
    options.fingerprint = [=](const CampaignSpec&) -> Result<Fingerprint> { return print_of(picture); };
    hosts.emplace_back(*participant_, options);
  }
  running.Join();
  hosts.clear();
  std::size_t lines = 0;
  const auto check = [&](const store::CommitRow& row) {
    ++lines;
    EXPECT_EQ(row.facts.fingerprint, ShortHash(print_of(row.facts.worker.substr(5))));
  };
  ASSERT_TRUE(store::CommitTail(folder_ / "data").Refresh([] {}, check));
  EXPECT_EQ(lines, spec.episodes);
}

TEST_F(WorkerClientTest, TerminatedWorkerReleasesItsWork) {
  const CampaignSpec spec = Spec("drain", 4);
  auto collector = Open(spec, folder_ / "data");
  ASSERT_TRUE(collector);
  Running running(std::move(*collector));
  Process worker = StartWorker(spec, folder_ / "w.log", 3'600'000);
  ASSERT_TRUE(WaitUntil([&] { return running->progress().workers == 1; }));
  auto statuses = bus::Reader<bus::WorkerStatus>::Open(*participant_, PartitionOf(running, spec));
  ASSERT_TRUE(statuses);
  ASSERT_TRUE(WaitUntil([&] {
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

TEST_F(WorkerClientTest, AnIdleWorkerEndsWhenNobodyWantsItForAsLongAsItWasTold) {
  const CampaignSpec spec = Spec("idle", 1);  // and no collector of it
  ::setenv("FAKE_IDLE_TIMEOUT_MS", "500", 1);
  Process worker = StartWorker(spec, folder_ / "w.log", 0);
  ::unsetenv("FAKE_IDLE_TIMEOUT_MS");
  EXPECT_EQ(worker.Wait(20s), 0);
  EXPECT_NE(ReadTextFile(folder_ / "w.log").value_or("").find("nobody had work"), std::string::npos);
}

TEST_F(WorkerClientTest, WorkersThatLeaseAheadMakeTheSameEpisodes) {
  const CampaignSpec spec = Spec("prefetch", 40);
  Running running(std::move(*Open(spec, folder_ / "data")));
  auto requests = bus::Reader<bus::WorkRequest>::Open(*participant_, PartitionOf(running, spec));
  ASSERT_TRUE(requests);
  std::vector<Process> workers;
  for (int k = 0; k < 3; ++k) workers.push_back(StartPrefetching(spec, folder_ / "w.log", 20));
  std::size_t ahead = 0;
  std::uint64_t next_kill = 5;
  while (!running->progress().complete) {
    requests->Wait(20ms);
    for (const auto& request : requests->Take()) ahead += request.working_on != 0;
    if (running->progress().committed < next_kill || next_kill > 25) continue;
    next_kill += 10;
    workers.front().Signal(SIGKILL);
    workers.front().Wait(5s);
    workers.erase(workers.begin());
    workers.push_back(StartPrefetching(spec, folder_ / "w.log", 20));
  }
  running.Join();
  EXPECT_GT(ahead, 0u);
  ExpectWhole(spec, folder_ / "data");
}

TEST_F(WorkerClientTest, AStoppedWorkerHandsBackWhatItHadLeasedAhead) {
  const CampaignSpec spec = Spec("handback", 8);
  CollectorOptions options = QuickOptions();
  options.lease = 60s;  // nothing comes back by itself
  Running running(std::move(*Collector::Open(*participant_, spec, folder_ / "data", options)));
  const bus::Owner owner{spec.name, running->id()};
  auto leases = bus::Reader<bus::Lease>::Open(*participant_, owner.address_partition("overheard"));
  ASSERT_TRUE(leases);
  ::setenv("FAKE_ADDRESS", "overheard", 1);
  Process worker = StartPrefetching(spec, folder_ / "w.log", 60'000);
  ::unsetenv("FAKE_ADDRESS");
  EXPECT_TRUE(WaitUntil([&] {
    leases->Wait(200ms);
    const auto taken = leases->Take();
    return std::ranges::any_of(
        taken, [](const bus::Lease& lease) { return lease.kind == bus::LeaseKind::kWork && lease.index == 1; });
  })) << "it has begun with 0, and holds 1";
  worker.Signal(SIGTERM);
  EXPECT_EQ(worker.Wait(10s), 0);
  RawWorker one(*participant_, spec, running->id(), "one"), two(*participant_, spec, running->id(), "two");
  EXPECT_EQ(one.Ask().index, 0u);
  EXPECT_EQ(two.Ask().index, 1u);
  EXPECT_EQ(running->progress().lost_leases, 0u);
}

// Whether another index than that was leased; from the second look on, when the worker itself has heard of it, too.
bool BeginsToLeaseAhead(bus::Reader<bus::Lease>& leases, std::uint64_t index, bool& seen) {
  if (seen) return true;
  const auto taken = leases.Take();
  seen = std::ranges::any_of(
      taken, [&](const bus::Lease& lease) { return lease.kind == bus::LeaseKind::kWork && lease.index != index; });
  return false;
}

// As a slot of a host does whose child crashed: another one takes seconds to be ready.
TEST_F(WorkerClientTest, WhatALostChildWouldHaveDoneNextIsHandedBackAtOnce) {
  const CampaignSpec spec = Spec("lostchild", 8);
  CollectorOptions collector_options = QuickOptions();
  collector_options.lease = 60s;
  Running running(std::move(*Collector::Open(*participant_, spec, folder_ / "data", collector_options)));
  const bus::Owner owner{spec.name, running->id()};
  auto leases = bus::Reader<bus::Lease>::Open(*participant_, owner.address_partition(participant_->address()));
  auto reports = bus::Reader<bus::AttemptReport>::Open(*participant_, owner.partition());
  ASSERT_TRUE(leases && reports);
  WorkerOptions options;
  options.campaign = spec.name + "@" + running->id();
  options.name = "host-s0";
  options.prefetch = true;
  auto client = WorkerClient::Open(*participant_, options);
  ASSERT_TRUE(client);
  int attempts = 0;
  bool leased_ahead = false;
  const Status ended = client->Run([&](const JoinedCampaign&) -> Result<WorkFunction> {
    return [&](const WorkItem& item) -> Result<WorkResult> {
      if (++attempts == 2) return Fail(Code::kUnavailable, "enough");
      std::uint32_t step = 0;
      EXPECT_TRUE(WaitUntil([&] {
        item.progress("reach", ++step);
        return BeginsToLeaseAhead(*leases, item.index, leased_ahead);
      }));
      return WorkResult{.outcome = kReleased, .details_json = R"({"reason":"child_crashed"})"};
    };
  });
  ASSERT_FALSE(ended);
  EXPECT_EQ(ended.error().message, "enough");
  std::map<std::uint64_t, int> handed_back;
  for (const auto& report : reports->Take()) handed_back[report.index] += report.outcome == kReleased;
  EXPECT_EQ(handed_back, (std::map<std::uint64_t, int>{{0, 1}, {1, 2}})) << "1 ahead, and again when it had begun";
  RawWorker next(*participant_, spec, running->id(), "next");
  EXPECT_EQ(next.Ask().index, 1u) << "and 0, which lost its child, comes behind the others";
}

}  // namespace worker_client_test
}  // namespace etude::campaign
