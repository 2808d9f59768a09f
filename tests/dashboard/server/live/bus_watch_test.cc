// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/live: live_model.cc, bus_watch.cc and sample_tap.cc
#include "dashboard/server/live/bus_watch.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <thread>

#include "dashboard/server/live/sample_tap.h"
#include "services/bus/access.h"
#include "services/bus/process_reporter.h"
#include "services/bus/topic.h"
#include "services/core/clock.h"
#include "services/core/log.h"
#include "services/core/thread_annotations.h"
#include "services/security/authority.h"
#include "tests/services/bus/two_processes.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/wait_until.h"

namespace etude::live {
namespace bus_watch_test {

using namespace std::chrono_literals;

bus::Presence Campaign() {
  bus::Presence presence;
  presence.id = "0123456789abcdef";
  presence.name = "quickstart";
  return presence;
}

bus::WorkerStatus Worker(std::uint64_t episodes, const std::string& phase = "play") {
  bus::WorkerStatus status;
  status.worker = "w0";
  status.host = "lab-7";
  status.phase = phase;
  status.episodes = episodes;
  return status;
}

class LiveModelTest : public testing::Test {
 protected:
  LiveModelTest() { model_.Directory({Campaign()}, start_); }
  LiveCampaign& campaign() { return model_.view().campaigns.at(id_); }
  const std::string id_ = Campaign().id;
  const TimePoint start_ = MonotonicClock::now();
  LiveModel model_;
};

TEST_F(LiveModelTest, AWorkersRateIsOfTheLastMinute) {
  for (int i = 0; i <= 240; ++i) model_.On(id_, Worker(static_cast<std::uint64_t>(i / 4)), start_ + i * 500ms);
  const auto& worker = campaign().workers.at("w0");
  EXPECT_NEAR(worker.PerMinute(start_ + 120s).value(), 30, 1) << "one every two seconds";
  EXPECT_LE(worker.episodes.size(), 123u);
  EXPECT_EQ(worker.last, "success");
}

// before, it kept its rate and its slot for as long as no other worker of its campaign spoke
TEST_F(LiveModelTest, AWorkerThatFellSilentHasNoRateAndIsForgotten) {
  for (int i = 0; i <= 20; ++i) model_.On(id_, Worker(static_cast<std::uint64_t>(i)), start_ + i * 500ms);
  const auto& worker = campaign().workers.at("w0");
  EXPECT_TRUE(worker.PerMinute(start_ + 19s));
  EXPECT_FALSE(worker.Silent(start_ + 19s));
  EXPECT_TRUE(worker.Silent(start_ + 21s));
  EXPECT_FALSE(worker.PerMinute(start_ + 21s)) << "the last one was heard at 10 s";
  model_.Directory({Campaign()}, start_ + 9min);
  EXPECT_TRUE(campaign().workers.contains("w0")) << "it is shown as silent";
  model_.Directory({Campaign()}, start_ + 11min);
  EXPECT_TRUE(campaign().workers.empty()) << "though its collector lives";
}

TEST_F(LiveModelTest, ASilenceIsToldOnceAndStaysAmongTheEvents) {
  bus::CampaignStatus status;
  status.committed = 3, status.total = 20;
  model_.On(id_, status, start_);
  model_.On(id_, Worker(1), start_);
  model_.Directory({Campaign()}, start_ + 9s);
  EXPECT_TRUE(model_.view().events->empty());
  for (const auto later : {11s, 12s, 700s}) model_.Directory({Campaign()}, start_ + later);
  ASSERT_EQ(model_.view().events->size(), 1u) << "also when the worker is long forgotten";
  const auto& event = model_.view().events->front().event;
  EXPECT_EQ(event.code, "worker_silent");
  EXPECT_EQ(event.host, "lab-7");
  EXPECT_EQ(event.text, "quickstart: w0 silent");
  model_.On(id_, Worker(1), start_ + 800s);
  model_.Directory({Campaign()}, start_ + 820s);
  EXPECT_EQ(model_.view().events->size(), 2u) << "it came again and fell silent again";
}

// before, it was forgotten first, and the event that was then made of it ended the process
TEST_F(LiveModelTest, ASilenceThatIsSeenLateIsToldOfAForgottenWorker) {
  model_.On(id_, Worker(1), start_);
  model_.Directory({Campaign()}, start_ + 11min);
  ASSERT_EQ(model_.view().events->size(), 1u);
  EXPECT_EQ(model_.view().events->front().event.text, "quickstart: w0 silent");
  EXPECT_EQ(model_.view().events->front().event.host, "lab-7");
  EXPECT_TRUE(campaign().workers.empty());
}

TEST_F(LiveModelTest, WorkersOfAFinishedCampaignMayBeSilent) {
  bus::CampaignStatus status;
  status.committed = 19, status.given_up = 1, status.total = 20;
  model_.On(id_, status, start_);
  model_.On(id_, Worker(1), start_);
  model_.Directory({Campaign()}, start_ + 1min);
  EXPECT_TRUE(model_.view().events->empty());
}

TEST_F(LiveModelTest, TheStripShowsPhasesAndSilence) {
  model_.On(id_, Worker(0, "plan"), start_);
  model_.On(id_, Worker(0, "play"), start_ + 500ms);
  model_.On(id_, Worker(0, "send"), start_ + 3500ms);
  EXPECT_EQ(campaign().workers.at("w0").strip, "py....s");
  for (int i = 0; i < 500; ++i) model_.On(id_, Worker(0), start_ + 4s + i * 500ms);
  EXPECT_EQ(campaign().workers.at("w0").strip, std::string(120, 'y'));
}

TEST_F(LiveModelTest, RememberedThingsAreBounded) {
  bus::AttemptReport report;
  report.worker = "w0";
  report.outcome = "plan_failed";
  for (std::uint64_t i = 0; i < 1000; ++i) {
    report.index = i;
    model_.On(id_, report, start_, 0);
    bus::CampaignStatus status;
    status.committed = i;
    model_.On(id_, status, start_ + i * 10s);
  }
  EXPECT_EQ(campaign().attempts.size(), 200u);
  EXPECT_EQ(campaign().attempts.front().report.index, 999u) << "newest first";
  EXPECT_EQ(campaign().per_minute.size(), 60u);
}

TEST_F(LiveModelTest, WhatWentAwayIsKeptForAWhile) {
  model_.Directory({}, start_ + 1min);
  EXPECT_FALSE(campaign().present);
  model_.Directory({}, start_ + 1h);
  EXPECT_FALSE(model_.view().campaigns.contains(id_));
}

// before, it was warned of as silent for ten minutes, and counted as a busy slot
TEST_F(LiveModelTest, AWorkerThatWentHomeIsNoWorker) {
  model_.On(id_, Worker(3), start_);
  ASSERT_TRUE(campaign().workers.contains("w0"));
  model_.On(id_, Worker(3, bus::kGonePhase), start_ + 500ms);
  EXPECT_FALSE(campaign().workers.contains("w0"));
  model_.On(id_, Worker(0), start_ + 60s);
  EXPECT_EQ(campaign().workers.at("w0").strip, "y") << "it came again, as a new one";
}

bus::ProcessStatus Process(const std::string& name, int samples) {
  bus::ProcessStatus status;
  status.process = name;
  status.role = "collector";
  status.topics_json =
      fmt::format(R"([{{"topic": "t", "kind": "writer", "samples": {}, "bytes": {}}}])", samples, 100 * samples);
  return status;
}

TEST_F(LiveModelTest, ProcessesGiveRatesAndAreForgotten) {
  model_.On(Process("p", 10), start_);
  model_.Topics({}, "me", start_);
  model_.On(Process("p", 50), start_ + 4s);
  model_.Topics({}, "me", start_ + 5s);
  EXPECT_DOUBLE_EQ(model_.view().rates.at("t").samples_per_second, 10);
  EXPECT_DOUBLE_EQ(model_.view().rates.at("t").bytes_per_second, 1000);
  model_.Topics({}, "me", start_ + 2min);
  EXPECT_TRUE(model_.view().processes.empty());
}

std::vector<bus::PeerEndpoint> EndpointsOf(const std::string& participant) {
  bus::PeerEndpoint endpoint;
  endpoint.topic = "etude/process/status";
  endpoint.participant = participant;
  return {endpoint};
}

TEST_F(LiveModelTest, AProcessThatEndsIsForgottenAndOneThatIsKilledIsSilent) {
  for (const char* name : {"ends", "killed"}) {
    auto status = Process(name, 0);
    status.participant = std::string("participant of ") + name;
    model_.On(status, start_);
  }
  auto both = EndpointsOf("participant of ends");
  both.push_back(EndpointsOf("participant of killed").front());
  model_.Topics(both, "me", start_ + 1s);
  EXPECT_EQ(model_.view().processes.size(), 2u);
  model_.Topics(EndpointsOf("participant of killed"), "me", start_ + 2s);
  EXPECT_FALSE(model_.view().processes.contains("ends"));
  EXPECT_TRUE(model_.view().processes.contains("killed"));
  model_.Topics(EndpointsOf("another participant"), "me", start_ + 11s);
  EXPECT_TRUE(model_.view().processes.contains("killed")) << "DDS gave it up; it did not say that it goes";
  model_.Topics(EndpointsOf("another participant"), "me", start_ + 62s);
  EXPECT_TRUE(model_.view().processes.empty());
}

TEST_F(LiveModelTest, APolicyServersAnswersAreCountedOverSeconds) {
  bus::PolicyStatus status;
  status.server = "s";
  for (int i = 0; i <= 30; ++i) {
    status.answered = static_cast<std::uint64_t>(8 * i);
    model_.On(status, start_ + i * 1s);
  }
  const auto& server = model_.view().servers.at("s");
  EXPECT_NEAR(server.AnswersPerSecond().value(), 8, 1e-9);
  EXPECT_LE(server.answered.size(), 12u);
  model_.Topics({}, "me", start_ + 1min);
  EXPECT_TRUE(model_.view().servers.empty()) << "it is silent";
}

TEST_F(LiveModelTest, EventsComeOnceNewestFirstAndAreBounded) {
  std::vector<bus::ProcessEvent> events;
  for (std::uint64_t i = 0; i < 700; ++i) {
    bus::ProcessEvent event;
    event.process = "p";
    event.number = i;
    event.time_ms = i;
    events.push_back(event);
  }
  model_.On(events);
  model_.On(std::vector<bus::ProcessEvent>{events.back()});
  const auto& kept = *model_.view().events;
  ASSERT_EQ(kept.size(), 500u);
  EXPECT_EQ(kept[0].event.number, 699u);
  EXPECT_EQ(kept[1].event.number, 698u) << "heard twice, kept once";
}

// before, an event of a clock that is an hour ahead stood first for an hour
TEST_F(LiveModelTest, AnEventOfTheFutureIsNoNewerThanWhenItWasHeard) {
  bus::ProcessEvent ahead, later;
  ahead.process = "ahead";
  ahead.time_ms = static_cast<std::uint64_t>((WallSeconds() + 3600) * 1000);
  model_.On(std::vector<bus::ProcessEvent>{ahead});
  std::this_thread::sleep_for(5ms);
  later.process = "later";
  later.time_ms = static_cast<std::uint64_t>(WallSeconds() * 1000);
  model_.On(std::vector<bus::ProcessEvent>{later});
  const auto& kept = *model_.view().events;
  ASSERT_EQ(kept.size(), 2u);
  EXPECT_EQ(kept[0].event.process, "later");
  EXPECT_EQ(kept[1].event.time_ms, ahead.time_ms) << "as it says itself";
}

TEST_F(LiveModelTest, WhatWorkersAreReadyForIsCompared) {
  bus::WorkRequest request;
  request.campaign_id = id_;
  request.spec_sha256 = "aa";
  for (const char* worker : {"w0", "w1", "w2"}) {
    request.worker = worker;
    request.content = worker == std::string("w2") ? 2 : 1;
    model_.On(id_, request);
  }
  const auto& prints = model_.view().prints;
  EXPECT_EQ(prints.at("w0").work, prints.at("w1").work);
  EXPECT_NE(prints.at("w0").work, prints.at("w2").work);
}

// before, the page of the fleet called hosts with other drivers or another libm equal
TEST_F(LiveModelTest, HostsAreToldApartByTheirFingerprints) {
  bus::WorkRequest request;
  request.campaign_id = id_;
  for (const char* worker : {"w0", "w1"}) {
    request.worker = worker;
    request.fingerprint_json = fmt::format(R"({{"libm": "{}"}})", worker);
    model_.On(id_, request);
  }
  const auto& prints = model_.view().prints;
  EXPECT_EQ(prints.at("w0").work, prints.at("w1").work) << "they are ready for the same work";
  EXPECT_NE(prints.at("w0").host, prints.at("w1").host);
  EXPECT_EQ(prints.at("w0").host.size(), 12u);
}

// What is warned of while it lives.
class Warned {
 public:
  Warned() { InitLog("test", "info"); }
  std::size_t Count(const std::string& words) const {
    const MutexLock lock(mutex_);
    const auto has = [&](const std::string& text) { return text.find(words) != std::string::npos; };
    return static_cast<std::size_t>(std::ranges::count_if(texts_, has));
  }

 private:
  mutable Mutex mutex_;
  std::vector<std::string> texts_ ETUDE_GUARDED_BY(mutex_);
  const LogListener listener_{[this](const LogRecord& record) {
    const MutexLock lock(mutex_);
    texts_.push_back(record.text);
  }};
};

TEST(BusWatch, HearsProcessesAndReadsATopicWhileSomebodyLooks) {
  constexpr std::uint32_t kDomain = 60;
  auto participant = bus::Participant::Open({kDomain, ""});
  ASSERT_THAT(participant, IsOk());
  auto reporter = bus::ProcessReporter::Start(*participant, {.role = "collector", .every = 50ms});
  ASSERT_THAT(reporter, IsOk());
  BusWatch watch({kDomain, "", "text"});
  EXPECT_TRUE(WaitUntil([&] {
    const auto view = watch.View();
    return view->processes.contains((*reporter)->process()) && !view->endpoints->empty();
  }));
  EXPECT_TRUE(WaitUntil([&] {
    const auto samples = watch.Newest("etude/process/status");
    return samples && !samples->empty() && samples->front().message["role"].is_string();
  }));
  EXPECT_THAT(watch.Newest("etude/blob/chunk"), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(watch.Newest("etude/none"), HasCode(Code::kNotFound));

  const std::string process = (*reporter)->process();
  ASSERT_TRUE(watch.View()->processes.contains(process));
  reporter->reset();
  participant = Fail(Code::kUnavailable, "it has ended");
  EXPECT_TRUE(WaitUntil([&] { return !watch.View()->processes.contains(process); }, 20s)) << "long before the minute";
}

// a gateway that began before its network had no live data until somebody started it again
TEST(BusWatch, JoinsTheBusWhereItCannotAtFirst) {
  const TemporaryFolder folder;
  const Path profile = folder / "profile.xml";
  BusWatch watch({60, profile.string(), "text"});
  ASSERT_TRUE(WaitUntil([&] { return !watch.View()->error.empty(); }));
  EXPECT_TRUE(watch.View()->enabled);
  ASSERT_THAT(WriteFileAtomically(profile, std::string_view("<CycloneDDS/>")), IsOk());
  EXPECT_TRUE(WaitUntil([&] { return watch.View()->error.empty(); }));
}

// before, readers of a run were made for it and ended again every second
TEST(BusWatch, OfARelayNothingIsRead) {
  Warned warned;
  const auto participant = bus::Participant::Open({60, ""});
  ASSERT_THAT(participant, IsOk());
  auto presences = bus::Writer<bus::Presence>::Open(*participant, bus::kDirectoryPartition);
  ASSERT_THAT(presences, IsOk());
  // where the name is no partition's, no reader can be made, and that is warned of
  for (const auto kind : {bus::PresenceKind::kRelay, bus::PresenceKind::kRun}) {
    bus::Presence presence;
    presence.kind = kind;
    presence.id = presence.instance = kind == bus::PresenceKind::kRelay ? "aaaa000000000001" : "bbbb000000000002";
    presence.name = "no partition";
    ASSERT_THAT(presences->Write(presence), IsOk());
  }
  BusWatch watch({60, "", "text"});
  ASSERT_TRUE(WaitUntil([&] { return warned.Count("run no partition@") >= 2; }));
  EXPECT_EQ(warned.Count("relay no partition@"), 0u);
}

// before, who looked at it waited for ever, and each round of its reader was warned of
TEST(SampleTap, ATopicThatItsIdentityMayNotReadIsAnErrorThatIsSaidOnce) {
  Warned warned;
  const TemporaryFolder authority;
  ASSERT_THAT(security::InitAuthority(authority.path(), security::Protection::kEncrypt), IsOk());
  const std::vector roles{security::Role::kGateway};
  const auto now = static_cast<std::int64_t>(WallSeconds());
  const auto identity = security::Issue(authority.path(), {.name = "gateway",
                                                           .roles = roles,
                                                           .grants = bus::GrantsFor(roles, "gateway", {}, {}),
                                                           .not_before = now - 60,
                                                           .not_after = now + 86'400});
  ASSERT_THAT(identity, IsOk());
  const auto participant = bus::Participant::Open(
      {150, bus::LocalProfileWith("<ExternalDomainId>104</ExternalDomainId>"), identity->string()});
  ASSERT_THAT(participant, IsOk());
  const auto writer = bus::Writer<bus::CampaignControl>::Open(*participant, "lab/1");  // collectors read it alone
  ASSERT_THAT(writer, IsOk());
  const std::string topic = "etude/campaign/control";
  SampleTap tap(*participant);
  ASSERT_TRUE(WaitUntil([&] { return !tap.Read({topic}).at(topic).has_value(); }));
  for (int round = 0; round < 40; ++round)
    EXPECT_THAT(tap.Read({topic}).at(topic), MessageHas("Not Allowed By Security"));
  EXPECT_EQ(warned.Count("topic=" + topic), 1u);
}

}  // namespace bus_watch_test
}  // namespace etude::live
