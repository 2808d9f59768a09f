// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/api with something on the bus: fleet, home, metrics, topics, events, insight, actions.
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <set>
#include <sstream>

#include "tests/dashboard/server/api/api_fixture.h"
#include "tests/dashboard/server/api/json_schema.h"
#include "tests/support/matchers.h"

namespace etude::api {
namespace live_test {

using testing::HasSubstr;
using testing::IsEmpty;

class LiveApiTest : public ApiFixture {
 protected:
  LiveApiTest() {
    const auto dataset = sources_.Dataset("lab.data").value()->View().value();
    live::LiveModel& model = model_;
    model.view().enabled = true;
    const auto now = MonotonicClock::now();
    bus::Presence campaign;
    campaign.id = dataset->info.identity;
    campaign.name = "lab";
    bus::Presence policy;
    policy.kind = bus::PresenceKind::kPolicy;
    policy.id = sources_.Run("lab.run").value()->View().value()->identity;
    policy.name = "demo";
    if (policy.id.empty()) policy.id = "00112233445566778899aabbccddeeff";
    policy_name_ = BusId(policy);
    model.Directory({campaign, policy}, now);
    bus::CampaignStatus status;
    status.committed = 6, status.total = 20, status.state = "paused", status.workers = 1;
    model.On(campaign.id, status, now);
    bus::WorkerStatus worker;
    worker.worker = "w0", worker.host = "lab-7", worker.phase = "play", worker.stage = "reach", worker.step = 212;
    worker.token = 1, worker.index = 7, worker.last_outcome = "plan_failed";
    worker.plan_histogram.assign(bus::kPlanBins, 0);
    worker.plan_histogram[3] = 9;
    model.On(campaign.id, worker, now);
    bus::WorkRequest request;
    request.worker = "w0", request.campaign_id = campaign.id;
    request.fingerprint_json = R"({"libm": "aa"})";
    model.On(campaign.id, request);
    bus::ProcessStatus process;
    process.process = "lab-7-1", process.host = "lab-7", process.role = "worker", process.version = "0.1.0";
    process.rss_bytes = 50'000'000, process.cpu = 0.5, process.participant = "aa";
    process.topics_json = R"([{"topic": "etude/campaign/worker", "kind": "writer", "samples": 3, "bytes": 900}])";
    model.On(process, now);
    bus::PolicyStatus server;
    server.server = "s", server.run = policy.name, server.run_id = policy.id, server.host = "lab-9";
    server.step = 200, server.control_trained = true, server.sessions = 2, server.p50_ms = 4, server.p95_ms = 9;
    model.On(server, now);
    bus::ProcessEvent event;
    event.process = "lab-7-1", event.role = "worker", event.host = "lab-7", event.level = "warn";
    event.text = "the disk is slow", event.time_ms = 1'795'369'600'000;
    model.On(std::vector<bus::ProcessEvent>{event});
    model.Topics({{.topic = "etude/campaign/worker",
                   .type = "WorkerStatus",
                   .is_writer = true,
                   .partitions = {"lab/1"},
                   .participant = "aa",
                   .reliable = true}},
                 "me", now);
    live_ = std::make_shared<const live::LiveView>(model.view());
    context_.domain = 60;
    context_.bus_flags = [](security::Role) { return std::vector<std::string>{"--domain", "60"}; };
  }
  http::Answer Post(const std::string& target, const OrderedJson& body) {
    http::Request request;
    request.method = "POST";
    request.content_type = "application/json";
    request.body = body.dump();
    return Ask(request, kPrefix + target);
  }
  std::vector<std::string> Problems(const char* schema, const OrderedJson& value) {
    const auto document = OrderedJson::parse(dashboard::OpenApiText());
    std::vector<std::string> problems;
    CheckSchema(document, document["components"]["schemas"][schema], value, "", problems);
    return problems;
  }
  live::LiveModel model_;
  std::string policy_name_;
};

TEST_F(LiveApiTest, AHostHasWorkersWithStageAndStepAndItsProcesses) {
  const auto fleet = GetJson(kPrefix + "/fleet");
  EXPECT_THAT(Problems("Fleet", fleet), IsEmpty());
  ASSERT_EQ(fleet["hosts"].size(), 1u) << fleet.dump(1);
  const auto& host = fleet["hosts"][0];
  EXPECT_EQ(host["rss_mb"], 50.0);
  EXPECT_EQ(host["cpu"], 0.5);
  EXPECT_EQ(host["version"], "0.1.0");
  EXPECT_EQ(host["fingerprint"].get<std::string>().size(), 12u);
  EXPECT_EQ(host["plan_p95_s"], 0.08) << "the upper edge of the bin";
  EXPECT_EQ(host["processes"][0]["role"], "worker");
  EXPECT_EQ(host["workers"][0]["stage"], "reach");
  EXPECT_EQ(host["workers"][0]["step"], 212);
  EXPECT_EQ(host["workers"][0]["last"], "plan_failed");
}

TEST_F(LiveApiTest, WhoeverReadsWhatARunPublishesIsSubscribed) {
  const auto subscribers = [&] {
    const auto json = GetJson(kPrefix + "/runs/lab.run/checkpoints");
    EXPECT_THAT(Problems("Checkpoints", json), IsEmpty());
    return json["subscribers"];
  };
  EXPECT_EQ(subscribers(), OrderedJson::array());
  const std::string identity = sources_.Run("lab.run").value()->View().value()->identity;
  ASSERT_FALSE(identity.empty());
  const bus::PeerEndpoint reads{.topic = "etude/blob/published_manifest",
                                .partitions = {"demo/" + identity, "demo/" + identity + "/relay"},
                                .participant = "aa"};
  bus::PeerEndpoint stranger = reads, own = reads, writes = reads, other_run = reads, other_topic = reads;
  stranger.participant = "bb";
  own.participant = "me";
  writes.participant = "cc", writes.is_writer = true;
  other_run.participant = "dd", other_run.partitions = {"demo/0123"};
  other_topic.participant = "ee", other_topic.topic = "etude/train/status";
  live::LiveView view = *live_;
  view.endpoints = std::make_shared<const std::vector<bus::PeerEndpoint>>(
      std::vector<bus::PeerEndpoint>{reads, reads, stranger, own, writes, other_run, other_topic});
  live_ = std::make_shared<const live::LiveView>(view);
  const auto found = subscribers();
  ASSERT_EQ(found.size(), 2u) << found.dump(1);
  EXPECT_EQ(found[0], OrderedJson({{"peer", "worker 0@lab-7"}, {"participant", "aa"}}));
  EXPECT_EQ(found[1], OrderedJson({{"peer", nullptr}, {"participant", "bb"}}));
}

TEST_F(LiveApiTest, HomeSaysWhatStandsAndWhatIsServed) {
  const auto home = GetJson(kPrefix + "/home");
  EXPECT_THAT(Problems("Home", home), IsEmpty());
  EXPECT_THAT(home["sentence"].get<std::string>(), HasSubstr("paused at 6 of 20"));
  EXPECT_THAT(home["sentence"].get<std::string>(), HasSubstr("step 200 serves 2 sessions"));
  EXPECT_EQ(home["tiles"]["policy"]["p95_ms"], 9.0);
  EXPECT_EQ(home["tiles"]["policy"]["may_drive"], true);
  const auto& newest = home["tiles"]["checkpoint"];
  EXPECT_EQ(newest["source"], "lab.run");
  EXPECT_EQ(newest["step"], 200);
  EXPECT_EQ(newest["file"], "00000200.safetensors");
  EXPECT_GE(newest["age_ms"], 0);
  ASSERT_EQ(newest["servers"].size(), 1u);
  EXPECT_EQ(newest["servers"][0]["host"], "lab-9");
  EXPECT_EQ(newest["servers"][0]["step"], 200);
}

TEST_F(LiveApiTest, AHostSaysHowManyWorkersItHasWhenNotAllAreListed) {
  live::LiveModel model;
  const auto now = MonotonicClock::now();
  bus::Presence campaign;
  campaign.id = "1111222233334444";
  campaign.name = "wide";
  model.Directory({campaign}, now);
  for (int i = 0; i < 5; ++i) {
    bus::WorkerStatus worker;
    worker.worker = "w" + std::to_string(i), worker.host = "lab-7", worker.phase = "play";
    worker.episodes = 10, worker.failures = 2;
    model.On(campaign.id, worker, now);
  }
  live_ = std::make_shared<const live::LiveView>(model.view());
  const auto fleet = GetJson(kPrefix + "/fleet?workers=2");
  EXPECT_THAT(Problems("Fleet", fleet), IsEmpty());
  ASSERT_EQ(fleet["hosts"].size(), 1u) << fleet.dump(1);
  const auto& host = fleet["hosts"][0];
  EXPECT_EQ(host["workers"].size(), 2u);
  EXPECT_EQ(host["slots"], 5);
  EXPECT_EQ(host["episodes"], 50) << "of all of them";
  EXPECT_EQ(host["failures"], 10);
  EXPECT_EQ(GetJson(kPrefix + "/fleet")["hosts"][0]["workers"].size(), 5u);
  EXPECT_EQ(Get(kPrefix + "/fleet?workers=0").status, 400);
}

TEST_F(LiveApiTest, AHostsCollectorIsListedHoweverManyWorkersAreBesideIt) {
  live::LiveModel model;
  for (const char* role : {"worker", "worker", "collector", "worker"}) {
    bus::ProcessStatus process;
    process.process = fmt::format("lab-7-{}", model.view().processes.size());
    process.host = "lab-7", process.role = role, process.rss_bytes = 1'000'000;
    model.On(process, MonotonicClock::now());
  }
  live_ = std::make_shared<const live::LiveView>(model.view());
  const auto host = GetJson(kPrefix + "/fleet?workers=1")["hosts"][0];
  ASSERT_EQ(host["processes"].size(), 1u) << host.dump(1);
  EXPECT_EQ(host["processes"][0]["role"], "collector");
  EXPECT_EQ(host["rss_mb"], 4.0) << "of all of them";
}

// Collectors and trainers whose folders are on other hosts.
TEST_F(LiveApiTest, SeveralThatAreOnTheBusAloneAreListed) {
  std::vector<bus::Presence> there;
  for (const auto kind : {bus::PresenceKind::kCampaign, bus::PresenceKind::kRun})
    for (const char* id : {"1111222233334444", "5555666677778888"}) {
      bus::Presence presence;
      presence.kind = kind;
      presence.id = id;
      presence.name = "elsewhere";
      there.push_back(presence);
    }
  model_.Directory(there, MonotonicClock::now());
  live_ = std::make_shared<const live::LiveView>(model_.view());
  const auto home = GetJson(kPrefix + "/home");
  EXPECT_THAT(Problems("Home", home), IsEmpty());
  std::set<std::string> listed;
  for (const auto& source : home["sources"]) listed.insert(source["id"].get<std::string>());
  for (const auto& presence : there) EXPECT_TRUE(listed.contains(BusId(presence))) << BusId(presence);
}

// Before, its figures were nowhere, all of its seeds were open, and its run was said not to be there.
TEST_F(LiveApiTest, OfWhatIsOnTheBusAloneFiguresAreServedAndFilesAreSaidToBeElsewhere) {
  bus::Presence campaign, run;
  campaign.id = "1111222233334444", campaign.name = "elsewhere";
  run.kind = bus::PresenceKind::kRun, run.id = "5555666677778888", run.name = "away";
  const auto now = MonotonicClock::now();
  model_.Directory({campaign, run}, now);
  bus::CampaignStatus status;
  status.committed = 30, status.total = 600, status.workers = 3, status.failures_json = R"({"slip": 4})";
  model_.On(campaign.id, status, now);
  bus::TrainStatus training;
  training.step = 6000, training.loss = 0.5;
  model_.On(run.id, training, now);
  live_ = std::make_shared<const live::LiveView>(model_.view());
  const auto text = Get("/metrics").body;
  EXPECT_THAT(text, HasSubstr("etude_demonstrations_total{campaign=\"elsewhere@1111222233334444\"} 30\n"));
  EXPECT_THAT(text, HasSubstr("etude_workers{campaign=\"elsewhere@1111222233334444\"} 3\n"));
  EXPECT_THAT(text, HasSubstr("{campaign=\"elsewhere@1111222233334444\",reason=\"slip\",task=\"\"} 4\n"));
  EXPECT_THAT(text, HasSubstr("etude_train_step{run=\"away@5555666677778888\"} 6000\n"));
  const auto cells = GetArrays(kPrefix + "/campaigns/elsewhere@1111222233334444/cells");
  EXPECT_TRUE(cells.tensors.at("cells").data.empty()) << "not one is known to be open";
  EXPECT_EQ(cells.metadata.at("total"), "600");
  EXPECT_EQ(GetJson(kPrefix + "/runs/away@5555666677778888")["folder"], nullptr);
  for (const char* part : {"/series", "/checkpoints", "/curriculum", "/graph"}) {
    const auto answer = Get(kPrefix + "/runs/away@5555666677778888" + part);
    EXPECT_EQ(answer.status, 404) << part;
    EXPECT_THAT(answer.body, HasSubstr("its files are not below this gateway's folders")) << part;
  }
  EXPECT_THAT(Get(kPrefix + "/datasets/elsewhere@1111222233334444").body, HasSubstr("on the bus alone"));
  EXPECT_THAT(Get(kPrefix + "/runs/nowhere@5555666677778888").body, testing::Not(HasSubstr("on the bus")));
}

// Before, a page that was opened while nothing but the bus knew of it said for ever that its files are elsewhere.
TEST_F(LiveApiTest, AFolderThatHasComeAnswersForItsNameOnTheBus) {
  bus::Presence campaign, run;
  campaign.id = sources_.Dataset("lab.data").value()->View().value()->info.identity, campaign.name = "lab";
  run.kind = bus::PresenceKind::kRun, run.name = "base";
  run.id = sources_.Run("lab.run").value()->View().value()->identity;
  model_.Directory({campaign, run}, MonotonicClock::now());
  live_ = std::make_shared<const live::LiveView>(model_.view());

  const std::string of_campaign = BusId(campaign);
  const auto answer = GetJson(kPrefix + "/campaigns/" + of_campaign);
  EXPECT_EQ(answer["id"], of_campaign) << "the page goes on with it";
  EXPECT_EQ(answer["dataset"], "lab.data");
  EXPECT_EQ(answer["status"]["workers"], 1) << "what is heard of it, too";
  EXPECT_EQ(GetArrays(kPrefix + "/campaigns/" + of_campaign + "/cells").tensors.at("cells").data.size(), 20u);
  EXPECT_EQ(GetJson(kPrefix + "/campaigns/" + of_campaign + "/attempts")["total"], kEpisodes + 2);
  EXPECT_EQ(GetJson(kPrefix + "/datasets/" + of_campaign)["id"], "lab.data");
  EXPECT_EQ(GetJson(kPrefix + "/datasets/" + of_campaign + "/episodes/1")["index"], 1);
  const auto attempts = LatestAttempts(context_, of_campaign);
  ASSERT_THAT(attempts, IsOk());
  EXPECT_EQ((*attempts)["campaign"], of_campaign);
  EXPECT_EQ((*attempts)["total"], kEpisodes + 2);

  const std::string of_run = BusId(run);
  const auto json = GetJson(kPrefix + "/runs/" + of_run);
  EXPECT_THAT(Problems("Run", json), IsEmpty());
  EXPECT_EQ(json["id"], of_run);
  EXPECT_EQ(json["folder"], "lab/run");
  EXPECT_EQ(GetJson(kPrefix + "/runs/" + of_run + "/checkpoints")["checkpoints"].size(), 1u);
  EXPECT_FALSE(GetArrays(kPrefix + "/runs/" + of_run + "/series?keys=train/loss").tensors.empty());
  const auto news = TrainNews(context_, of_run, 0);
  ASSERT_THAT(news, IsOk());
  EXPECT_EQ((*news)["run"], of_run);
  EXPECT_FALSE((*news)["lines"].empty());

  EXPECT_EQ(Get(kPrefix + "/datasets/lab@").status, 404) << "no id is no folder's";
  EXPECT_EQ(Get(kPrefix + "/datasets/" + of_run).status, 404) << "another kind's";
}

TEST_F(LiveApiTest, ACampaignThatIsPausedSaysSo) {
  const auto campaign = GetJson(kPrefix + "/campaigns/lab.data");
  EXPECT_THAT(Problems("Campaign", campaign), IsEmpty());
  EXPECT_EQ(campaign["state"], "running");
  EXPECT_EQ(campaign["status"]["control"], "paused");
  live_ = std::make_shared<const live::LiveView>();
  EXPECT_EQ(GetJson(kPrefix + "/campaigns/lab.data")["status"]["control"], "") << "nobody says so any more";
}

TEST_F(LiveApiTest, MetricsHavePoliciesProcessesAndTheBus) {
  const auto text = Get("/metrics").body;
  EXPECT_THAT(text, HasSubstr("etude_bus_bytes_total{host=\"lab-7\",topic=\"etude/campaign/worker\"} 900\n"));
  EXPECT_THAT(text, HasSubstr("etude_process_resident_bytes{host=\"lab-7\",role=\"worker\"} 50000000\n"));
  EXPECT_THAT(text, HasSubstr("host=\"lab-9\"} 0.009\n"));
}

TEST_F(LiveApiTest, SeveralServersOfARunOnAHostAreOneSeries) {
  bus::PolicyStatus second = model_.view().servers.begin()->second.status;
  second.server = "t", second.sessions = 3, second.p95_ms = 20;
  model_.On(second, MonotonicClock::now());
  live_ = std::make_shared<const live::LiveView>(model_.view());
  const auto text = Get("/metrics").body;
  EXPECT_THAT(text, HasSubstr("host=\"lab-9\"} 5\n")) << "sessions are added up";
  EXPECT_THAT(text, HasSubstr("host=\"lab-9\"} 0.02\n")) << "the slowest";
  std::set<std::string> series;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);)
    if (!line.starts_with('#')) {
      EXPECT_TRUE(series.insert(line.substr(0, line.rfind(' '))).second) << line;
    }
}

TEST_F(LiveApiTest, CountersDoNotFallWhenAProcessLeaves) {
  const char* const before = "etude_bus_bytes_total{host=\"lab-7\",topic=\"etude/campaign/worker\"} 900\n";
  EXPECT_THAT(Get("/metrics").body, HasSubstr(before));
  const auto process = model_.view().processes;
  model_.view().processes.clear();
  live_ = std::make_shared<const live::LiveView>(model_.view());
  EXPECT_THAT(Get("/metrics").body, HasSubstr(before));
  model_.view().processes = process;  // it was only silent
  live_ = std::make_shared<const live::LiveView>(model_.view());
  EXPECT_THAT(Get("/metrics").body, HasSubstr(before));
}

TEST_F(LiveApiTest, WarningsOfProcessesAreDescribed) {
  const auto long_ago = MonotonicClock::now() - std::chrono::seconds(20);
  bus::ProcessStatus silent;
  silent.process = "lab-7-2", silent.host = "lab-7", silent.role = "collector";
  model_.On(silent, long_ago);
  model_.view().prints["w0"].work = "aaaaaaaa";
  model_.view().prints["w1"].work = "bbbbbbbb";
  auto& campaign = model_.view().campaigns.begin()->second;
  campaign.workers["w1"] = campaign.workers["w0"];
  live_ = std::make_shared<const live::LiveView>(model_.view());
  const auto home = GetJson(kPrefix + "/home");
  EXPECT_THAT(Problems("Home", home), IsEmpty());
  std::set<std::string> codes;
  for (const auto& warning : home["warnings"]) codes.insert(warning["code"]);
  EXPECT_TRUE(codes.contains("process_silent")) << home["warnings"].dump(1);
  EXPECT_TRUE(codes.contains("fingerprint")) << home["warnings"].dump(1);
}

TEST_F(LiveApiTest, TopicsHavePeersAndEventsAreFiltered) {
  const auto topics = GetJson(kPrefix + "/topics");
  EXPECT_THAT(Problems("Topics", topics), IsEmpty());
  ASSERT_EQ(topics["topics"].size(), 1u);
  EXPECT_EQ(topics["topics"][0]["writers"][0]["peer"], "worker 0@lab-7");
  const auto events = GetJson(kPrefix + "/events?q=disk");
  EXPECT_THAT(Problems("Events", events), IsEmpty());
  EXPECT_EQ(events["total"], 1);
  EXPECT_EQ(GetJson(kPrefix + "/events?level=error")["total"], 0);
  EXPECT_EQ(Get(kPrefix + "/events?level=loud").status, 400);
}

TEST_F(LiveApiTest, ANewestSampleIsThatOfTheTopicThatWasAskedFor) {
  EXPECT_EQ(Get(kPrefix + "/topics/etude%2Fcampaign%2Fworker/newest").status, 503) << "without a bus";
  context_.newest = [](const std::string& topic) -> Result<std::vector<live::Sample>> {
    EXPECT_EQ(topic, "etude/campaign/worker");
    return std::vector<live::Sample>{{"lab/1", {{"seed", 5}, {"host", "h"}}, MonotonicClock::now()}};
  };
  const auto sample = GetJson(kPrefix + "/topics/etude%2Fcampaign%2Fworker/newest");
  EXPECT_THAT(Problems("Samples", sample), IsEmpty());
  EXPECT_EQ(sample["samples"][0]["message"]["host"], "h");
}

TEST_F(LiveApiTest, AnInsightIsOfTheRecordedPictureAndItsWhatIf) {
  const OrderedJson source{{"dataset", "lab.data"}, {"episode", 1}, {"picture", 3}};
  OrderedJson body{{"run", policy_name_}, {"source", source}, {"what_if", {{"sentence", "push the coke"}}}};
  EXPECT_EQ(Post("/insight", body).status, 503) << "without a bus";
  std::string asked_run, asked_what_if;
  const Episode episode = store::DatasetReader::Open(lab_.root() / "data").value().ReadWhole(1).value();
  context_.look = [&](const std::string& run, const policy::Question& question,
                      const std::string& what_if) -> Result<policy::Insight> {
    asked_run = run, asked_what_if = what_if;
    EXPECT_EQ(question.instruction, episode.instruction);
    EXPECT_EQ(question.joints[0], episode.joint_pos.row(3 * episode.image_stride)[0]);
    EXPECT_EQ(question.rgb.size(), static_cast<std::size_t>(question.width * question.height * 3));
    policy::Insight insight;
    insight.checkpoint_step = 200;
    insight.modules["TAR2D"] = {{"quantity", "pixel"}, {"unit", "px"}, {"value", {1.5, 2.5}}};
    insight.what_if = insight.modules;
    insight.attention["TAR2D"] = {1, 2, {"language"}, {{0.25, 0.5}, {0.25}}, {{{0, 0.5}, {0.5}}, {{0.5, 0.5}, {0}}}};
    insight.waypoints.resize(2);
    insight.words = {{"push", 0.25}};
    insight.joints.assign(question.joints.size(), 0.125);
    return insight;
  };
  const auto answer = Post("/insight", body);
  ASSERT_EQ(answer.status, 200) << answer.body;
  const auto json = OrderedJson::parse(answer.body);
  EXPECT_THAT(Problems("Insight", json), IsEmpty());
  const auto& attention = json["attention"]["TAR2D"];
  EXPECT_EQ(attention["share"], 0.75);
  EXPECT_EQ(attention["keys"], OrderedJson::parse(R"(["language"])"));
  EXPECT_EQ(attention["key_weights"], OrderedJson::parse("[0.25]"));
  EXPECT_EQ(attention["heads"], OrderedJson::parse(R"([{"weights": [0.0, 0.5], "key_weights": [0.5]},
                                                       {"weights": [0.5, 0.5], "key_weights": [0.0]}])"));
  EXPECT_TRUE(json["truth"]["pixels"].contains(episode.target));
  EXPECT_EQ(json["words"], OrderedJson::parse(R"([{"word": "push", "moves_m": 0.25}])"));
  const auto arm = static_cast<std::size_t>(episode.joint_pos.columns);
  ASSERT_EQ(json["joints"].size(), arm + static_cast<std::size_t>(episode.gripper_qpos.columns));
  EXPECT_EQ(json["joints"][0]["name"], "joint 1");
  EXPECT_EQ(json["joints"][0]["value"], episode.joint_pos.row(3 * episode.image_stride)[0]);
  EXPECT_EQ(json["joints"][0]["moves_m"], 0.125);
  EXPECT_THAT(json["joints"][arm]["name"].get<std::string>(), HasSubstr("gripper"));
  EXPECT_EQ(asked_run, policy_name_);
  EXPECT_EQ(asked_what_if, R"({"sentence":"push the coke"})");
  body["run"] = "lab.none";
  EXPECT_EQ(Post("/insight", body).status, 409);
  body["run"] = policy_name_;
  body["what_if"] = {{"drive", true}};
  EXPECT_EQ(Post("/insight", body).status, 400);
  body.erase("what_if");
  body["source"]["picture"] = 9999;
  EXPECT_EQ(Post("/insight", body).status, 404);
  body["source"]["picture"] = -1;
  EXPECT_EQ(Post("/insight", body).status, 400) << "before, it was of the first one";
}

TEST_F(LiveApiTest, ActionsOnWhatIsLiveAreTheCommandsOfAUser) {
  const auto command = [&](OrderedJson body) {
    body["dry_run"] = true;
    return Post("/actions", body);
  };
  for (const char* action : {"pause", "drain", "resume", "stop"}) {
    const auto shown = command({{"action", action}, {"campaign", "lab.data"}});
    ASSERT_EQ(shown.status, 200) << shown.body;
    EXPECT_THAT(shown.body, HasSubstr(std::string("etude campaign ") + action + " lab@"));
    EXPECT_THAT(shown.body, HasSubstr("--domain 60"));
  }
  EXPECT_EQ(command({{"action", "pause"}, {"campaign", "lab.eval_a"}}).status, 404);
  const std::string file = "00000200.safetensors";
  EXPECT_THAT(command({{"action", "promote"}, {"run", "lab.run"}, {"file", file}}).body,
              HasSubstr("etude checkpoint promote "));
  EXPECT_THAT(command({{"action", "serve"}, {"run", "lab.run"}, {"file", file}}).body,
              HasSubstr("etude policy --checkpoint "));
  EXPECT_THAT(command({{"action", "serve"}, {"run", "lab.run"}}).body, HasSubstr("etude policy --checkpoint "))
      << "nobody trains it";
  EXPECT_EQ(command({{"action", "promote"}, {"run", "lab.run"}, {"file", "../config.yaml"}}).status, 404);
}

}  // namespace live_test
}  // namespace etude::api
