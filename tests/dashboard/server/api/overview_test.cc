// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/api/overview.cc and overview_warnings.cc: GET /home with what is on the bus alone.
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "tests/dashboard/server/api/api_fixture.h"
#include "tests/support/matchers.h"

namespace etude::api {
namespace overview_test {

using namespace std::chrono_literals;
using testing::ElementsAre;

bus::Presence Present(bus::PresenceKind kind, const std::string& name, const std::string& id) {
  bus::Presence presence;
  presence.kind = kind;
  presence.name = name;
  presence.id = id;
  return presence;
}

class OverviewTest : public ApiFixture {
 protected:
  OverviewTest() { model_.view().enabled = true; }
  OrderedJson Home() {
    live_ = std::make_shared<const live::LiveView>(model_.view());
    return GetJson(kPrefix + "/home");
  }
  // By code, those that the folders alone do not give.
  std::map<std::string, std::string> Warnings() {
    live_ = std::make_shared<const live::LiveView>();
    std::set<std::string> of_folders;
    const auto without = GetJson(kPrefix + "/home"), with = Home();
    for (const auto& warning : without["warnings"]) of_folders.insert(warning["text"]);
    std::map<std::string, std::string> fresh;
    for (const auto& warning : with["warnings"])
      if (!of_folders.contains(warning["text"])) fresh[warning["code"]] = warning["text"];
    return fresh;
  }
  // One campaign whose two workers have committed 3 of 20 episodes by then.
  void Campaign(live::TimePoint then, std::uint64_t committed = 3) {
    model_.Directory({Present(bus::PresenceKind::kCampaign, "away", "aaaa0001")}, MonotonicClock::now());
    bus::CampaignStatus status;
    status.committed = committed;
    status.total = 20;
    status.workers = 2;
    model_.On("aaaa0001", status, then);
  }

  live::LiveModel model_;
};

// The second one of a kind used to end the gateway.
TEST_F(OverviewTest, CampaignsAndRunsThatNoFolderHasAreSources) {
  using bus::PresenceKind;
  model_.Directory(
      {Present(PresenceKind::kCampaign, "one", "aaaa0001"), Present(PresenceKind::kCampaign, "two", "bbbb0002"),
       Present(PresenceKind::kRun, "left", "cccc0003"), Present(PresenceKind::kRun, "right", "dddd0004")},
      MonotonicClock::now());
  std::map<std::string, std::string> kinds;
  const auto home = Home();
  for (const auto& source : home["sources"]) kinds[source["id"]] = source["kind"];
  EXPECT_EQ(kinds["one@aaaa0001"], "campaign");
  EXPECT_EQ(kinds["two@bbbb0002"], "campaign");
  EXPECT_EQ(kinds["left@cccc0003"], "run");
  EXPECT_EQ(kinds["right@dddd0004"], "run");
}

// a colleague's `etude eval` was what every page called its demonstrations
TEST_F(OverviewTest, AnEvaluationWhoseFilesLieElsewhereIsNoDemonstrations) {
  auto away = Present(bus::PresenceKind::kCampaign, "eval-0123", "aaaa0001");
  away.since = 4'000'000'000u;
  model_.Directory({away}, MonotonicClock::now());
  bus::CampaignAnnouncement said;
  said.spec_json = R"({"mode": "rollout"})";
  model_.On(away.id, said, MonotonicClock::now());
  const auto home = Home();
  EXPECT_EQ(home["tiles"]["demonstrations"]["source"], "lab.data");
  EXPECT_THAT(home["sentence"].get<std::string>(), testing::Not(testing::HasSubstr("eval-")));
  for (const auto& source : home["sources"]) {
    if (source["id"] != "eval-0123@aaaa0001") continue;
    EXPECT_EQ(source["role"], "rollouts");
  }
}

// before, all that was live had changed now, and took the first place from each other with every look
TEST_F(OverviewTest, OfWhatRunsThatWhichWasBegunLastIsFirstWhoeverWroteLast) {
  const auto ids = [](const OrderedJson& home, const char* kind) {
    std::vector<std::string> of_kind;
    for (const auto& source : home["sources"])
      if (source["kind"] == kind && source["role"] != "rollouts") of_kind.push_back(source["id"]);
    return of_kind;
  };
  using bus::PresenceKind;
  auto newer = Present(PresenceKind::kCampaign, "newer", "aaaa0001");
  auto older = Present(PresenceKind::kCampaign, "older", "bbbb0002");
  newer.since = 2000, older.since = 1000;
  auto left = Present(PresenceKind::kRun, "left", "cccc0003"), right = Present(PresenceKind::kRun, "right", "dddd0004");
  model_.Directory({newer, older, right, left}, MonotonicClock::now());
  for (const auto& presence : {newer, older, newer}) {
    bus::CampaignStatus status;
    status.total = 20;
    model_.On(presence.id, status, MonotonicClock::now());
    const auto home = Home();
    EXPECT_THAT(ids(home, "campaign"), ElementsAre("newer@aaaa0001", "older@bbbb0002"));
    EXPECT_THAT(ids(home, "run"), ElementsAre("lab.run", "left@cccc0003", "right@dddd0004")) << "with files first";
    EXPECT_EQ(home["tiles"]["training"]["source"], "left@cccc0003") << "what runs";
  }
}

TEST_F(OverviewTest, DatasetsThatGrowSideBySideKeepTheirOrder) {
  const Path folders[] = {lab_.root() / "one", lab_.root() / "two"};
  for (const auto& folder : folders) {
    WriteExampleDataset(folder);
    const OrderedJson identity{{"id", folder == folders[0] ? std::string(16, '1') : std::string(16, '2')},
                               {"since", folder == folders[0] ? 4'000'000'000u : 3'900'000'000u}};
    ASSERT_THAT(WriteFileAtomically(folder / "identity.json", identity.dump()), IsOk());
  }
  for (const auto& folder : {folders[1], folders[0], folders[1]}) {
    const auto text = ReadTextFile(folder / "attempts.jsonl");
    ASSERT_THAT(text, IsOk());
    ASSERT_THAT(WriteFileAtomically(folder / "attempts.jsonl", *text), IsOk());  // it changed last
    const auto home = Home();
    EXPECT_EQ(home["tiles"]["demonstrations"]["source"], "lab.one");
    EXPECT_EQ(home["sources"][0]["id"], "lab.one") << home["sources"].dump(1);
  }
}

TEST_F(OverviewTest, WarnsOfACampaignThatCommitsNothing) {
  const auto now = MonotonicClock::now();
  Campaign(now);
  EXPECT_FALSE(Warnings().contains("no_commits"));
  Campaign(now - 90s, 4);
  EXPECT_THAT(Warnings()["no_commits"], testing::HasSubstr("away: no commit for 9"));
  Campaign(now - 90s, 20);
  EXPECT_FALSE(Warnings().contains("no_commits")) << "it is complete";
}

TEST_F(OverviewTest, WarnsOfWhatACampaignSaysAndOfWorkersThatAreSilent) {
  const auto now = MonotonicClock::now();
  Campaign(now);
  bus::CampaignStatus status;
  status.total = 20;
  status.error = "write 'x': No space left on device";
  model_.On("aaaa0001", status, now);
  bus::WorkerStatus worker;
  worker.worker = "quiet";
  model_.On("aaaa0001", worker, now - 7s);
  worker.worker = "lively";
  model_.On("aaaa0001", worker, now);
  auto warnings = Warnings();
  EXPECT_EQ(warnings["campaign_error"], "away: write 'x': No space left on device");
  EXPECT_THAT(warnings["worker_silent"], testing::StartsWith("worker quiet silent for "));
}

TEST_F(OverviewTest, SaysWhatEtudeUpIsAt) {
  EXPECT_EQ(Home()["ups"], OrderedJson::array()) << "no up.json";
  const auto write = [&](const OrderedJson& ended, const OrderedJson& exit) {
    const OrderedJson said{{"pids", {{"up", 1}}}, {"phase", "roll out"}, {"goal", "20 rollouts"},
                           {"started", 1.8e9},    {"ended", ended},      {"exit", exit}};
    ASSERT_THAT(WriteFileAtomically(lab_.root() / "up.json", said.dump()), IsOk());
  };
  write(nullptr, nullptr);
  const auto silent = Home()["ups"];
  ASSERT_EQ(silent.size(), 1u);
  EXPECT_EQ(silent[0]["state"], "silent") << "nobody on the bus says that it runs";
  EXPECT_EQ(silent[0]["phase"], "roll out");
  EXPECT_EQ(silent[0]["goal"], "20 rollouts");
  bus::ProcessStatus process;
  process.process = "up-1", process.role = "etude up", process.folder = silent[0]["folder"];
  model_.On(process, MonotonicClock::now());
  EXPECT_EQ(Home()["ups"][0]["state"], "running");
  write(1.8e9 + 60, 0);
  EXPECT_EQ(Home()["ups"][0]["state"], "finished");
  write(1.8e9 + 60, 3);
  EXPECT_EQ(Home()["ups"][0]["state"], "failed");
  EXPECT_EQ(Home()["ups"][0]["exit"], 3);
  ASSERT_THAT(WriteFileAtomically(lab_.root() / "up.json", std::string_view("torn {")), IsOk());
  EXPECT_EQ(Home()["ups"], OrderedJson::array());
}

TEST_F(OverviewTest, WorkersThatWentHomeAreNeitherSilentNorSlots) {
  const auto now = MonotonicClock::now();
  Campaign(now);
  bus::WorkerStatus worker;
  worker.worker = "home", worker.host = "lab-7", worker.phase = "send";
  model_.On("aaaa0001", worker, now - 8s);
  worker.phase = bus::kGonePhase;
  model_.On("aaaa0001", worker, now - 7s);
  worker.worker = "stays", worker.phase = "play";
  model_.On("aaaa0001", worker, now);
  EXPECT_FALSE(Warnings().contains("worker_silent"));
  const auto fleet = GetJson(kPrefix + "/fleet");
  ASSERT_EQ(fleet["hosts"].size(), 1u);
  EXPECT_EQ(fleet["hosts"][0]["slots"], 1);
  EXPECT_EQ(fleet["hosts"][0]["busy"], 1);
}

TEST_F(OverviewTest, WarnsOfProcessesThatAreSilentAndNotOfThoseThatEnded) {
  const auto now = MonotonicClock::now();
  for (const char* role : {"etude collect", "trainer", "gateway"}) {
    bus::ProcessStatus process;
    process.process = role, process.host = "lab-7", process.role = role;
    process.participant = std::string("participant of ") + role;
    model_.On(process, now - 4s);
  }
  bus::PeerEndpoint there;
  there.participant = "participant of trainer";
  EXPECT_TRUE(Warnings().contains("process_silent"));
  model_.Topics({there}, "me", now);
  EXPECT_THAT(Warnings()["process_silent"], testing::StartsWith("trainer on lab-7 silent for "));
  model_.view().processes.erase("trainer");
  EXPECT_FALSE(Warnings().contains("process_silent"));
  bus::ProcessStatus collect;
  collect.process = "killed", collect.host = "lab-8", collect.role = "etude collect";
  model_.On(collect, now - 30s);
  EXPECT_THAT(Warnings()["process_silent"], testing::StartsWith("etude collect on lab-8 silent for "));
}

TEST_F(OverviewTest, WarnsOfDisksThatAreNearlyFullAndOfServersThatRefuse) {
  const auto now = MonotonicClock::now();
  bus::ProcessStatus process;
  process.process = "roomy-1", process.host = "roomy", process.role = "collector";
  process.disk_total_bytes = 1000, process.disk_free_bytes = 500;
  model_.On(process, now);
  EXPECT_FALSE(Warnings().contains("disk"));
  process.process = "full-1", process.host = "full";
  process.disk_free_bytes = 50;
  model_.On(process, now);
  bus::PolicyStatus server;
  server.server = "s", server.run = "demo", server.run_id = "cccc0003", server.host = "rack";
  server.last_refusal = "crop does not fit";
  model_.On(server, now);
  auto warnings = Warnings();
  EXPECT_EQ(warnings["disk"], "disk of collector on full 5 % free");
  EXPECT_EQ(warnings["policy_refuses"], "policy on rack refused: crop does not fit");
}

// before, one observation that was refused was warned of until its server ended
TEST_F(OverviewTest, ARefusalIsWarnedOfForTenMinutes) {
  const auto now = MonotonicClock::now();
  bus::PolicyStatus server;
  server.server = "s", server.run = "demo", server.run_id = "cccc0003", server.host = "rack";
  server.last_refusal = "crop does not fit", server.refused = 1;
  for (auto then = now - 11min; then < now; then += 5s) model_.On(server, then);
  EXPECT_FALSE(Warnings().contains("policy_refuses"));
  server.refused = 2;
  model_.On(server, now);
  EXPECT_EQ(Warnings()["policy_refuses"], "policy on rack refused: crop does not fit") << "it does so again";
}

// before, a stage that ended by its budget was warned of for ever, though its run was resumed and reached the goal
TEST_F(OverviewTest, TheLastWordOnAStageCounts) {
  WriteExampleRun(lab_.root() / "once");
  const Path file = lab_.root() / "run" / "curriculum.jsonl";
  const std::string resumed = R"({"step":120,"from":1,"to":2,"name":"TAR3D","cause":"goal","reason":"reached"})";
  ASSERT_THAT(WriteFileAtomically(file, ReadTextFile(file).value() + resumed + "\n"), IsOk());
  std::set<std::string> warned;
  const auto home = Home();
  for (const auto& warning : home["warnings"])
    if (warning["code"] == "stage_budget") warned.insert(warning["text"]);
  EXPECT_THAT(warned, ElementsAre("once: stage 1 ended by its budget, not by its goal"));
}

// before, they led to whichever campaign came first
TEST_F(OverviewTest, WarningsAndEventsOfACampaignLeadToIt) {
  const auto now = MonotonicClock::now();
  Campaign(now);
  bus::CampaignStatus status;
  status.total = 20, status.error = "no space";
  model_.On("aaaa0001", status, now);
  bus::AttemptReport report;
  report.index = 7, report.outcome = "slip";
  model_.On("aaaa0001", report, now, WallSeconds());
  const auto home = Home();
  std::set<std::string> links;
  for (const auto& warning : home["warnings"]) links.insert(warning["link"]);
  EXPECT_TRUE(links.contains("/generation?dataset=away@aaaa0001")) << home["warnings"].dump(1);
  for (const auto& event : home["tiles"]["events"]) links.insert(event["link"]);
  EXPECT_TRUE(links.contains("/generation?dataset=away@aaaa0001&index=7")) << home["tiles"]["events"].dump(1);
  EXPECT_FALSE(links.contains("/generation"));
}

TEST_F(OverviewTest, WarnsOfACheckpointThatNoServerTakesForAMinute) {
  const auto identity = ReadIdentity(lab_.root() / "run");
  ASSERT_THAT(identity, IsOk());
  bus::PolicyStatus server;
  server.server = "s", server.run = "example", server.run_id = identity->id, server.host = "rack", server.step = 150;
  server.channel = "latest";
  model_.On(server, MonotonicClock::now());
  const Path file = lab_.root() / "run" / "checkpoints" / "00000200.safetensors";
  std::filesystem::last_write_time(file, std::filesystem::last_write_time(file) - 90s);
  EXPECT_THAT(Warnings()["checkpoint_unserved"], testing::HasSubstr("policy on rack serves 150"));
  server.step = 200;
  model_.On(server, MonotonicClock::now());
  EXPECT_FALSE(Warnings().contains("checkpoint_unserved"));
}

TEST_F(OverviewTest, ACheckpointThatWasSavedJustNowNeedNotBeServed) {
  const auto identity = ReadIdentity(lab_.root() / "run");
  ASSERT_THAT(identity, IsOk());
  bus::PolicyStatus server;
  server.server = "s", server.run_id = identity->id, server.step = 150, server.channel = "latest";
  model_.On(server, MonotonicClock::now());
  EXPECT_FALSE(Warnings().contains("checkpoint_unserved"));
}

// before, every server was held against the newest file, and a good one was warned of for ever
TEST_F(OverviewTest, AServerIsHeldAgainstTheChannelThatItFollows) {
  const auto identity = ReadIdentity(lab_.root() / "run");
  ASSERT_THAT(identity, IsOk());
  const Path checkpoints = lab_.root() / "run" / "checkpoints", newest = checkpoints / "00000200.safetensors";
  store::Safetensors older;
  older.metadata = {{"step", "150"}, {"refused", ""}};
  older.tensors["modules.LANG.w"] = {store::DType::kF32, {2, 3}, std::vector<std::uint8_t>(24)};
  ASSERT_THAT(store::WriteSafetensors(checkpoints / "00000150.safetensors", older), IsOk());
  std::filesystem::create_symlink("00000150.safetensors", checkpoints / "best.safetensors");
  for (const Path& file : {newest, checkpoints / "00000150.safetensors"})
    std::filesystem::last_write_time(file, std::filesystem::last_write_time(file) - 90s);
  const auto warned = [&](const std::string& channel, std::uint64_t step) {
    bus::PolicyStatus server;
    server.server = "s", server.run_id = identity->id, server.step = step, server.channel = channel;
    model_.On(server, MonotonicClock::now());
    return Warnings().contains("checkpoint_unserved");
  };
  EXPECT_TRUE(warned("latest", 150));
  EXPECT_FALSE(warned("best", 150)) << "the best one is an older one";
  EXPECT_TRUE(warned("best", 100));
  EXPECT_FALSE(warned("", 100)) << "one file, whatever comes";
  EXPECT_FALSE(warned("gone", 100));
}

TEST_F(OverviewTest, WarnsOfTwoOfOneNameThatAreNoShardsOfOne) {
  using bus::PresenceKind;
  auto one = Present(PresenceKind::kCampaign, "twin", "aaaa0001"),
       two = Present(PresenceKind::kCampaign, "twin", "bbbb");
  one.shard = 1, two.shard = 2;
  one.shards = two.shards = 2;
  one.spec_sha256 = two.spec_sha256 = "5a";
  model_.Directory({one, two}, MonotonicClock::now());
  EXPECT_FALSE(Warnings().contains("same_name")) << "shards";
  two.spec_sha256 = "6b";
  model_.Directory({one, two}, MonotonicClock::now());
  EXPECT_EQ(Warnings()["same_name"], "2 campaigns are named twin: say which by NAME@ID");
}

TEST_F(OverviewTest, ACampaignThatWasStoppedStaysSo) {
  ASSERT_THAT(WriteFileAtomically(lab_.root() / "data" / "collector.json",
                                  std::string_view(R"({"epoch": 3, "ended": "stopped"})")),
              IsOk());
  EXPECT_EQ(GetJson(kPrefix + "/campaigns/lab.data")["state"], "stopped") << "long after the bus forgot it";
}

TEST_F(OverviewTest, ACampaignThatWasStoppedIsNotSilent) {
  const std::string id = sources_.Dataset("lab.data").value()->View().value()->info.identity;
  const auto present = Present(bus::PresenceKind::kCampaign, "lab", id);
  const auto state = [&] {
    live_ = std::make_shared<const live::LiveView>(model_.view());
    return GetJson(kPrefix + "/campaigns/lab.data")["state"];
  };
  model_.Directory({present}, MonotonicClock::now());
  bus::CampaignStatus status;
  status.committed = 6, status.total = 20, status.state = "stopping";
  model_.On(id, status, MonotonicClock::now());
  EXPECT_EQ(state(), "running");
  model_.Directory({}, MonotonicClock::now());
  EXPECT_EQ(state(), "stopped");
  status.committed = 20;
  model_.On(id, status, MonotonicClock::now());
  EXPECT_EQ(state(), "finished");
}

class EvaluationState : public OverviewTest {
 protected:
  // One rollout of four is missing, and nothing was written for an hour; or was by a clock that is as much ahead.
  void Write(const std::string& name, std::chrono::hours ago, int failed_attempts = 0) {
    const Path folder = lab_.root() / name;
    auto report = OrderedJson::parse(ReadTextFile(folder / "eval.json").value());
    report["per_episode"].erase(std::size_t{3});
    ASSERT_THAT(WriteFileAtomically(folder / "eval.json", report.dump()), IsOk());
    std::string attempts;
    for (int i = 0; i < failed_attempts; ++i)
      attempts += fmt::format("{{\"index\":3,\"attempt\":{},\"outcome\":\"plan_failed\"}}\n", i);
    ASSERT_THAT(WriteFileAtomically(folder / "rollouts" / "attempts.jsonl", attempts), IsOk());
    const auto identity = OpenIdentity(folder / "rollouts");
    ASSERT_THAT(identity, IsOk());
    id_ = identity->id;
    const auto then = std::filesystem::file_time_type::clock::now() - ago;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(folder))
      std::filesystem::last_write_time(entry.path(), then);
  }
  std::string Of(const std::string& name) {
    live_ = std::make_shared<const live::LiveView>(model_.view());
    return GetJson(kPrefix + "/evals/lab." + name)["state"];
  }
  std::string id_;  // of the rollouts that were written last
};

// before, one at work was silent whenever nothing was committed for half a minute
TEST_F(EvaluationState, RunsWhileItsCollectorIsHeard) {
  Write("eval_a", 1h);
  EXPECT_EQ(Of("eval_a"), "silent");
  model_.Directory({Present(bus::PresenceKind::kCampaign, "eval-0123", id_)}, MonotonicClock::now());
  EXPECT_EQ(Of("eval_a"), "running");
  const auto home = Home();
  for (const auto& source : home["sources"])
    if (source["id"] == "lab.eval_a") {
      EXPECT_EQ(source["state"], "running");
    }
  model_.Directory({}, MonotonicClock::now());
  EXPECT_EQ(Of("eval_a"), "silent");
}

// before, it waited for ever for the one that nobody makes any more
TEST_F(EvaluationState, HasEndedWhenWhatIsMissingIsGivenUp) {
  const int most = SyntheticSpec().max_attempts;
  Write("eval_a", 1h, most - 1);
  EXPECT_EQ(Of("eval_a"), "silent");
  Write("eval_b", 1h, most);
  EXPECT_EQ(Of("eval_b"), "finished");
}

TEST_F(EvaluationState, AClockThatIsAheadMakesNothingRun) {
  Write("eval_a", -1h);
  EXPECT_EQ(Of("eval_a"), "silent");
}

// Until it writes a line its files speak of the time before.
TEST_F(OverviewTest, ARunThatIsResumedRunsWhateverItsFilesSayOfItsLastEnd) {
  const Path file = lab_.root() / "run" / "metrics.jsonl";
  const double ended = WallSeconds() - 100;
  const std::string end = fmt::format(R"({{"kind": "end", "step": 150, "time": {}, "cause": "failed"}})", ended);
  ASSERT_THAT(WriteFileAtomically(file, *ReadTextFile(file) + "\n" + end + "\n"), IsOk());
  EXPECT_EQ(GetJson(kPrefix + "/runs/lab.run")["state"], "failed");
  const auto run = sources_.Run("lab.run").value()->View().value();
  auto present = Present(bus::PresenceKind::kRun, "lab", run->identity);
  const auto state = [&](double since) {
    present.since = static_cast<std::uint64_t>(since);
    model_.Directory({present}, MonotonicClock::now());
    live_ = std::make_shared<const live::LiveView>(model_.view());
    return GetJson(kPrefix + "/runs/lab.run")["state"];
  };
  EXPECT_EQ(state(ended - 500), "failed") << "the process that has just failed is still there";
  EXPECT_EQ(state(ended + 50), "running");
}

// before, its last words stood there for ten minutes
TEST_F(OverviewTest, ARunThatIsNotHeardAnyMoreHasNoTimeLeft) {
  live::LiveRun heard;
  heard.present = true;
  heard.status.emplace().eta_s = 600;
  heard.heard = MonotonicClock::now();
  EXPECT_EQ(StateOf(nullptr, &heard).eta_s, 600.0);
  heard.heard -= 1min;
  const RunState state = StateOf(nullptr, &heard);
  EXPECT_EQ(state.state, "silent");
  EXPECT_FALSE(state.eta_s.has_value());
}

// Who pauses a campaign knows that nothing is committed.
TEST_F(OverviewTest, APausedCampaignIsNoAlarm) {
  const auto long_ago = MonotonicClock::now() - std::chrono::seconds(70);
  model_.Directory({Present(bus::PresenceKind::kCampaign, "away", "aaaa0001")}, MonotonicClock::now());
  bus::CampaignStatus status;
  status.committed = 3, status.total = 20, status.workers = 2, status.state = "running";
  model_.On("aaaa0001", status, long_ago);
  EXPECT_TRUE(Warnings().contains("no_commits"));
  status.state = "paused";
  model_.On("aaaa0001", status, long_ago);
  EXPECT_FALSE(Warnings().contains("no_commits"));
  status.state = "running";
  model_.On("aaaa0001", status, MonotonicClock::now());
  EXPECT_FALSE(Warnings().contains("no_commits")) << "its time begins anew";
}

}  // namespace overview_test
}  // namespace etude::api
