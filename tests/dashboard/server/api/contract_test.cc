// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/api: every route answers as openapi.json says, with the numbers of the files.
#include <fmt/ranges.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <map>
#include <set>
#include <utility>

#include "services/codec/deflate.h"
#include "services/core/statistics.h"
#include "services/episode/frame_cursor.h"
#include "tests/dashboard/server/api/api_fixture.h"
#include "tests/dashboard/server/api/json_schema.h"
#include "tests/support/matchers.h"

namespace etude::api {
namespace contract_test {

using testing::ElementsAre;
using testing::IsEmpty;

class ContractTest : public ApiFixture {
 protected:
  const OrderedJson document_ = OrderedJson::parse(dashboard::OpenApiText());

  std::vector<std::string> Problems(const OrderedJson& schema, const OrderedJson& value) {
    std::vector<std::string> problems;
    CheckSchema(document_, schema, value, "", problems);
    return problems;
  }
  // the answer's schema
  const OrderedJson& SchemaOf(const std::string& pattern) {
    return document_.at("paths")
        .at(pattern)
        .at("get")
        .at("responses")
        .at("200")
        .at("content")
        .at("application/json")
        .at("schema");
  }
  static std::vector<double> Doubles(const store::Tensor& tensor) {
    std::vector<double> values(tensor.data.size() / sizeof(double));
    std::memcpy(values.data(), tensor.data.data(), tensor.data.size());
    return values;
  }
};

// what stands for {name} in an address
const std::map<std::string, std::string> kExamples{
    {"/home", "/home"},
    {"/fleet", "/fleet"},
    {"/campaigns/{id}", "/campaigns/lab.data"},
    {"/campaigns/{id}/attempts", "/campaigns/lab.data/attempts"},
    {"/datasets/{id}", "/datasets/lab.data"},
    {"/datasets/{id}/episodes", "/datasets/lab.data/episodes?task=pick&limit=2"},
    {"/datasets/{id}/summary", "/datasets/lab.data/summary"},
    {"/datasets/{id}/episodes/{n}", "/datasets/lab.data/episodes/1"},
    {"/datasets/{id}/episodes/{n}/replay", "/datasets/lab.data/episodes/2/replay?attempt=0"},
    {"/runs/{id}", "/runs/lab.run"},
    {"/runs/{id}/curriculum", "/runs/lab.run/curriculum"},
    {"/runs/{id}/graph", "/runs/lab.run/graph"},
    {"/runs/{id}/checkpoints", "/runs/lab.run/checkpoints"},
    {"/evals/{id}", "/evals/lab.eval_a"},
    {"/evals/{id}/rows", "/evals/lab.eval_a/rows"},
    {"/evals/{a}/pair/{b}", "/evals/lab.eval_a/pair/lab.eval_b"},
    {"/diff", "/diff?a=lab.eval_a&b=lab.eval_other"},
    {"/logs", "/logs"},
    {"/events", "/events"},
    {"/topics", "/topics"},
    {"/actions", "/actions"},
    {"/play/sessions", "/play/sessions"},
    {"/session", "/session"},
    {"/jobs", "/jobs"},
    {"/openapi.json", "/openapi.json"}};

TEST_F(ContractTest, EveryJsonRouteAnswersAsDescribed) {
  for (int pass = 0; pass < 2; ++pass) {  // before and after everything was read
    for (const auto& [pattern, address] : kExamples) {
      const auto json = GetJson(kPrefix + address);
      EXPECT_THAT(Problems(SchemaOf(pattern), json), IsEmpty()) << address;
    }
    RunLater();
  }
}

TEST_F(ContractTest, DescriptionAndRoutesAreTheSame) {
  std::set<std::string> described, served;
  for (const auto& [pattern, methods] : document_["paths"].items())
    for (const auto& [method, operation] : methods.items())
      if (method != "servers") described.insert(method + " " + (methods.contains("servers") ? "/" : "") + pattern);
  for (const auto& route : service_.router().routes()) {
    const bool below = route.pattern.starts_with(kPrefix);
    std::string method = route.method;
    for (char& c : method) c = static_cast<char>(std::tolower(c));
    // what is not below the prefix names the root as its server
    served.insert(method + " " + (below ? route.pattern.substr(kPrefix.size()) : "/" + route.pattern));
  }
  EXPECT_EQ(described, served);
}

TEST_F(ContractTest, UnknownThingsAreProblems) {
  for (const char* address :
       {"/runs/none", "/datasets/..%2Flab.data", "/datasets/lab.data/episodes/99", "/datasets/lab.data/episodes/x",
        "/datasets/lab.data/episodes/1/pictures/side/0.rgb", "/datasets/lab.data/episodes/1/pictures/front/999.rgb",
        "/runs/lab.run/checkpoints/evil.safetensors", "/runs/lab.run/checkpoints/..%2Fconfig.yaml",
        "/evals/lab.eval_a/videos/none.mp4", "/jobs/none", "/nothing"}) {
    const auto answer = Get(kPrefix + address);
    EXPECT_EQ(answer.status, 404) << address;
    EXPECT_EQ(answer.content_type, "application/problem+json") << address;
    EXPECT_THAT(Problems(document_["components"]["schemas"]["Problem"], OrderedJson::parse(answer.body)), IsEmpty());
  }
  for (const char* address :
       {"/datasets/lab.data/episodes?limit=0", "/datasets/lab.data/episodes?steps=many",
        "/datasets/lab.data/episodes?sort=colour", "/datasets/lab.data/episodes/1/tracks?names=nose",
        "/runs/lab.run/series?x=moon", "/logs?level=loud"})
    EXPECT_EQ(Get(kPrefix + address).status, 400) << address;
}

TEST_F(ContractTest, RolloutsComeInPagesFailuresFirst) {
  const auto rows = GetJson(kPrefix + "/evals/lab.eval_b/rows?sort=failures&limit=2");
  EXPECT_EQ(rows["total"], 4);
  EXPECT_EQ(rows["failed"], 1);
  EXPECT_EQ(rows["next"], 2);
  ASSERT_EQ(rows["rows"].size(), 2u);
  EXPECT_EQ(rows["rows"][0]["index"], 1) << "the one that failed";
  EXPECT_EQ(rows["rows"][1]["index"], 0);
  const auto one = GetJson(kPrefix + "/evals/lab.eval_b/rows?index=3");
  ASSERT_EQ(one["rows"].size(), 1u);
  EXPECT_EQ(one["rows"][0]["index"], 3);
  EXPECT_EQ(GetJson(kPrefix + "/evals/lab.eval_b/rows?index=9")["total"], 0);
}

TEST_F(ContractTest, SeedsAreText) {
  const auto episode = GetJson(kPrefix + "/datasets/lab.data/episodes/1");
  const auto dataset = GetJson(kPrefix + "/datasets/lab.data");
  EXPECT_EQ(dataset["spec"]["seed"], std::to_string(kLargeSeed));
  EXPECT_EQ(episode["seed"],
            std::to_string(PlanEpisode(sources_.Dataset("lab.data").value()->View().value()->info.spec, 1, 0).seed));
}

TEST_F(ContractTest, PicturesAreTheOnesOfTheFile) {
  const std::string base = kPrefix + "/datasets/lab.data/episodes/1/";
  const auto reader = store::DatasetReader::Open(lab_.root() / "data").value();
  const Episode episode = reader.ReadWhole(1).value();
  const auto rgb = Get(base + "pictures/front/3.rgb");
  EXPECT_EQ(rgb.content_encoding, "deflate");
  FrameCursor frames(episode);
  const auto stored = frames.Frame(3);
  ASSERT_THAT(stored, IsOk());
  std::vector<std::uint8_t> pixels(stored->size());
  ASSERT_THAT(codec::Inflate({reinterpret_cast<const std::uint8_t*>(rgb.body.data()), rgb.body.size()}, pixels),
              IsOk());
  EXPECT_TRUE(std::ranges::equal(pixels, *stored));
  EXPECT_TRUE(Get(base + "pictures/front/3.png").body.starts_with("\x89PNG"));
  EXPECT_EQ(Get(base + "pictures/front/3.webp?w=64").body.substr(8, 4), "WEBP");
  EXPECT_EQ(Get(base + "strip.webp").body.substr(8, 4), "WEBP");
  const auto video = Get(base + "video/front.mp4");
  ASSERT_TRUE(video.file) << video.body;
  EXPECT_GT(video.file->size, 500u);
  EXPECT_EQ(Get(base + "video/front.mp4").etag, video.etag) << "made once";
}

TEST_F(ContractTest, TracksAreWholeOrBucketsWithTheirExtremes) {
  const std::string base = kPrefix + "/datasets/lab.data/episodes/1/tracks?names=eef_pos,phase";
  const auto whole = GetArrays(base);
  ASSERT_TRUE(whole.tensors.contains("eef_pos"));
  EXPECT_THAT(whole.tensors.at("eef_pos").shape, ElementsAre(kSteps, 3));
  EXPECT_EQ(whole.metadata.at("bucketed"), "false");
  EXPECT_EQ(whole.tensors.size(), 3u);

  const auto part = GetArrays(base + "&points=10&from=5&to=45");
  ASSERT_TRUE(part.tensors.contains("eef_pos/max"));
  EXPECT_THAT(part.tensors.at("eef_pos/max").shape, ElementsAre(10, 3));
  float all[kSteps][3], high[10][3];
  std::memcpy(all, whole.tensors.at("eef_pos").data.data(), sizeof all);
  std::memcpy(high, part.tensors.at("eef_pos/max").data.data(), sizeof high);
  for (int bucket = 0; bucket < 10; ++bucket) {
    float most = -1e9f;
    for (int t = 5 + 4 * bucket; t < 9 + 4 * bucket; ++t) most = std::max(most, all[t][2]);
    EXPECT_EQ(high[bucket][2], most) << bucket;
  }
}

TEST_F(ContractTest, ListsFilterSortAndGoOn) {
  RunLater();
  (void)GetJson(kPrefix + "/datasets/lab.data/episodes");
  RunLater();
  const auto first = GetJson(kPrefix + "/datasets/lab.data/episodes?limit=4");
  EXPECT_EQ(first["total"], kEpisodes);
  EXPECT_EQ(first["columns"]["index"], OrderedJson({5, 4, 3, 2})) << "newest first";
  const auto rest = GetJson(kPrefix + "/datasets/lab.data/episodes?limit=4&before=" + first["next"].get<std::string>());
  EXPECT_EQ(rest["columns"]["index"], OrderedJson({1, 0}));
  EXPECT_TRUE(rest["next"].is_null());
  const auto pick = GetJson(kPrefix + "/datasets/lab.data/episodes?task=pick&sort=index");
  for (const auto& task : pick["columns"]["task"]) EXPECT_EQ(task, "pick");
  EXPECT_LT(pick["total"], kEpisodes);
  EXPECT_EQ(GetJson(kPrefix + "/datasets/lab.data/episodes?steps=51..")["total"], 0);
}

TEST_F(ContractTest, ANameWithQuotesAndLineEndsIsNoHeader) {
  const std::string name = "a\"b\r\nSet-Cookie: c.safetensors";
  const Path checkpoints = lab_.root() / "run" / "checkpoints";
  std::filesystem::copy_file(checkpoints / "00000200.safetensors", checkpoints / name);
  const auto answer = Get(kPrefix + "/runs/lab.run/checkpoints/a%22b%0D%0ASet-Cookie:%20c.safetensors");
  ASSERT_EQ(answer.status, 200) << answer.body;
  std::map<std::string, std::string> headers(answer.headers.begin(), answer.headers.end());
  EXPECT_EQ(headers["Content-Disposition"], "attachment; filename=\"lab.run-a_b__Set-Cookie__c.safetensors\"");
}

// a command that is copied runs from wherever somebody stands
TEST_F(ContractTest, PathsOfSourcesAreAbsolute) {
  const auto at = [&](const char* name) { return std::filesystem::canonical(lab_.root() / name).string(); };
  EXPECT_EQ(GetJson(kPrefix + "/datasets/lab.data")["path"], at("data"));
  EXPECT_EQ(GetJson(kPrefix + "/datasets/lab.data")["folder"], "lab/data") << "for people";
  EXPECT_EQ(GetJson(kPrefix + "/runs/lab.run")["path"], at("run"));
  EXPECT_EQ(GetJson(kPrefix + "/evals/lab.eval_a")["path"], at("eval_a"));
  const auto home = GetJson(kPrefix + "/home");
  for (const auto& source : home["sources"])
    EXPECT_EQ(source["path"], at(source["folder"].get<std::string>().substr(4).c_str())) << source["id"];
}

TEST_F(ContractTest, SeriesHaveTheLinesNumbers) {
  const auto arrays = GetArrays(kPrefix + "/runs/lab.run/series?keys=train/loss,valid/TAR3D.cm,none/none");
  EXPECT_THAT(Doubles(arrays.tensors.at("train/loss/x")), ElementsAre(50, 100, 150, 200));
  EXPECT_THAT(Doubles(arrays.tensors.at("train/loss/last")), ElementsAre(2, 1, testing::IsNan(), 0.5));
  EXPECT_THAT(Doubles(arrays.tensors.at("train/loss/step")), ElementsAre(50, 100, 150, 200));
  EXPECT_THAT(Doubles(arrays.tensors.at("valid/TAR3D.cm/max")), ElementsAre(0.5));
  EXPECT_EQ(OrderedJson::parse(arrays.metadata.at("nulls"))["train/loss"], 1);
  const auto run = GetJson(kPrefix + "/runs/lab.run");
  EXPECT_EQ(run["state"], "finished") << "it has the steps that it was to have";
  EXPECT_EQ(run["torn"], true);
  EXPECT_EQ(run["nulls"], OrderedJson::parse(R"([{"step":150,"key":"train/loss"}])"));
  EXPECT_EQ(run["nulls_total"], 1);
  EXPECT_EQ(run["goals"][1]["goal"], 1.2) << "m in the file, cm on the page";
  EXPECT_EQ(run["goals"][1]["reached"], true);
  EXPECT_EQ(run["goals"][0]["reached"], false);
  ASSERT_EQ(run["goals"].size(), 3u);
  EXPECT_EQ(run["goals"][2]["unit"], "cm") << "CTRL, which was not validated yet";
  EXPECT_EQ(run["goals"][2]["goal"], 1.5);
  EXPECT_TRUE(run["goals"][2]["value"].is_null());
}

TEST_F(ContractTest, CheckpointsAreHeadersAndFiles) {
  (void)GetJson(kPrefix + "/runs/lab.run/checkpoints");
  RunLater();
  const auto json = GetJson(kPrefix + "/runs/lab.run/checkpoints");
  ASSERT_EQ(json["checkpoints"].size(), 1u);
  EXPECT_EQ(json["checkpoints"][0]["channels"], OrderedJson({"latest"}));
  EXPECT_EQ(json["checkpoints"][0]["sha256"].get<std::string>().size(), 64u);
  EXPECT_EQ(json["checkpoints"][0]["parameters"]["LANG"], 6);
  EXPECT_EQ(json["checkpoints"][0]["modules"]["LANG"]["quantity"], "class") << "the unit of its error";
  const auto file = Get(kPrefix + "/runs/lab.run/checkpoints/00000200.safetensors");
  ASSERT_TRUE(file.file);
  EXPECT_EQ(file.file->size, json["checkpoints"][0]["bytes"]);
}

TEST_F(ContractTest, PairsCountAndRefuseOtherScenes) {
  const auto pair = GetJson(kPrefix + "/evals/lab.eval_a/pair/lab.eval_b");
  EXPECT_EQ(pair["both"], 2);
  EXPECT_EQ(pair["only_a"], 1);
  EXPECT_EQ(pair["only_b"], 1);
  EXPECT_EQ(pair["p"], 1.0);
  EXPECT_EQ(pair["rows"][0]["a"] == pair["rows"][0]["b"], false) << "those that differ come first";
  EXPECT_EQ(pair["latched"]["both"], 4);
  const auto refused = Get(kPrefix + "/evals/lab.eval_a/pair/lab.eval_other");
  EXPECT_EQ(refused.status, 409);
  EXPECT_NE(refused.body.find("seed"), std::string::npos) << "says which key differs";
}

TEST_F(ContractTest, PairsHaveTheirDifferenceAndWhetherItIsChance) {
  const auto pair = GetJson(kPrefix + "/evals/lab.eval_a/pair/lab.eval_b");
  EXPECT_EQ(pair["n"], 4);
  EXPECT_EQ(pair["neither"], 0);
  EXPECT_EQ(pair["share_a"], 0.75);
  EXPECT_EQ(pair["difference"], 0.0);
  const Interval interval = NewcombePairedInterval(2, 1, 1, 0);
  EXPECT_EQ(pair["low"], interval.low);
  EXPECT_EQ(pair["high"], interval.high);
  EXPECT_EQ(pair["latched"]["share_b"], 1.0);
}

// the same scenes, judged otherwise: their difference says nothing of the policies
TEST_F(ContractTest, PairsRefuseOtherRules) {
  for (const auto& [name, rollout] : {std::pair{"eval_a", 4}, {"eval_b", 5}}) {
    const Path file = lab_.root() / name / "eval.json";
    OrderedJson report = OrderedJson::parse(ReadTextFile(file).value());
    report["rules"] = {{"tasks", OrderedJson::object()}, {"content", 7}, {"rollout", rollout}};
    ASSERT_THAT(WriteFileAtomically(file, report.dump()), IsOk());
  }
  const auto refused = Get(kPrefix + "/evals/lab.eval_a/pair/lab.eval_b");
  EXPECT_EQ(refused.status, 409);
  EXPECT_NE(refused.body.find("rollout (4, now 5)"), std::string::npos) << refused.body;
}

TEST_F(ContractTest, TheVideoWithAnOverlayIsTheOneThatIsShown) {
  const Path videos = lab_.root() / "eval_b" / "videos";
  for (const char* name : {"000001-pick-timeout.mp4", "000001-pick-timeout-overlay.mp4", "000002-pick-success.mp4"})
    ASSERT_THAT(WriteFileAtomically(videos / name, "not really a video"), IsOk());
  const auto video = [&](const std::string& index) {
    return GetJson(kPrefix + "/evals/lab.eval_b/rows?index=" + index)["rows"][0]["video"].get<std::string>();
  };
  EXPECT_EQ(video("1"), kPrefix + "/evals/lab.eval_b/videos/000001-pick-timeout-overlay.mp4");
  EXPECT_EQ(video("2"), kPrefix + "/evals/lab.eval_b/videos/000002-pick-success.mp4") << "there is no other";
  EXPECT_EQ(Get(video("1")).status, 200);
}

TEST_F(ContractTest, AttemptsHaveCommittedAndFailedOnes) {
  const auto all = GetJson(kPrefix + "/campaigns/lab.data/attempts");
  EXPECT_EQ(all["total"], kEpisodes + 2);
  const auto failed = GetJson(kPrefix + "/campaigns/lab.data/attempts?reason=plan_failed");
  ASSERT_EQ(failed["total"], 1);
  EXPECT_EQ(failed["rows"][0]["stage"], "reach");
  EXPECT_EQ(failed["rows"][0]["has_pictures"], false);
  const auto cells = GetArrays(kPrefix + "/campaigns/lab.data/cells").tensors.at("cells").data;
  ASSERT_EQ(cells.size(), 20u);
  EXPECT_EQ(cells[0], 1);
  EXPECT_EQ(cells[2], 2) << "committed after a failed attempt";
  EXPECT_EQ(cells[9], 4);
  EXPECT_EQ(cells[10], 0);
}

TEST_F(ContractTest, HomeSpeaksOfAllThree) {
  const auto home = GetJson(kPrefix + "/home");
  const std::string sentence = home["sentence"];
  EXPECT_NE(sentence.find("6 of 20"), std::string::npos) << sentence;
  EXPECT_NE(sentence.find("stage 2/2 TAR3D"), std::string::npos) << sentence;
  EXPECT_NE(sentence.find("75.0 %"), std::string::npos) << sentence;
  std::set<std::string> codes;
  for (const auto& warning : home["warnings"]) codes.insert(warning["code"]);
  EXPECT_TRUE(codes.contains("stage_budget"));
  EXPECT_TRUE(codes.contains("loss_not_finite"));
}

TEST_F(ContractTest, LogsFilterByLevel) {
  const auto logs = GetJson(kPrefix + "/logs?source=lab.logs.trainer.log&level=warn");
  ASSERT_EQ(logs["lines"].size(), 2u);
  EXPECT_EQ(logs["lines"][0]["level"], "warn");
  EXPECT_EQ(logs["lines"][1]["text"], "end") << "a line without a level goes with the one before";
  EXPECT_EQ(GetJson(kPrefix + "/logs")["lines"].size(), 3u);
}

TEST_F(ContractTest, LogsOfALineLongerThanTheWindowGoOn) {
  const std::string filler(2'000'000, 'x');
  ASSERT_THAT(WriteFileAtomically(lab_.root() / "logs" / "trainer.log", "first\n" + filler + "\n"), IsOk());
  std::string before, text;
  int pages = 0;
  for (bool more = true; more && pages < 20; ++pages) {
    const auto logs = GetJson(kPrefix + "/logs?source=lab.logs.trainer.log" + before);
    more = !logs["next"].is_null();
    if (more)
      before = "&before=" + logs["next"].get<std::string>();
    else
      text = logs["lines"][0]["text"];
  }
  EXPECT_EQ(text, "first");
  EXPECT_EQ(pages, 4) << "of half a MiB each";
}

TEST_F(ContractTest, ActionsAreCommandsAndNeedTheToken) {
  http::Request request;
  request.method = "POST";
  request.content_type = "application/json";
  request.body = R"({"action":"evaluate","run":"lab.run","file":"00000200.safetensors","dry_run":true})";
  const auto shown = Ask(request, kPrefix + "/actions");
  EXPECT_EQ(shown.status, 200) << shown.body;
  EXPECT_NE(shown.body.find("etude eval --checkpoint"), std::string::npos);
  request.body = R"({"action":"evaluate","run":"lab.run","file":"00000200.safetensors"})";
  EXPECT_EQ(Ask(request, kPrefix + "/actions").status, 401);
  request.authorization = fmt::format("Bearer {}", kTestToken);
  const auto accepted = Ask(request, kPrefix + "/actions");
  EXPECT_EQ(accepted.status, 202) << accepted.body;
  const std::string id = OrderedJson::parse(accepted.body)["job"];
  EXPECT_THAT(Problems(SchemaOf("/jobs/{id}"), GetJson(kPrefix + "/jobs/" + id)), IsEmpty());
  EXPECT_EQ(Ask(request, kPrefix + "/actions").status, 503) << "one heavy job at a time";
  for (const char* body :
       {R"({"action":"rm"})", "[]", "x",
        R"({"action":"evaluate","run":"lab.run","file":"00000200.safetensors","seed":"1; rm -rf /"})"}) {
    request.body = body;
    EXPECT_EQ(Ask(request, kPrefix + "/actions").status, 400) << body;
  }
  request.content_type = "text/plain";
  EXPECT_EQ(Ask(request, kPrefix + "/actions").status, 400) << "what a form of another page can send";
}

TEST_F(ContractTest, PlayIsClosedWithoutTheTokenAndWithoutABus) {
  EXPECT_EQ(GetJson(kPrefix + "/play/sessions")["enabled"], false);
  EXPECT_FALSE(GetJson(kPrefix + "/play/sessions")["campaigns"].empty()) << "those that come along";
  EXPECT_EQ(Get(kPrefix + "/play/sessions/one").status, 503);
  http::Request request;
  request.method = "POST";
  request.content_type = "application/json";
  request.body = R"({"spec":"quickstart","run":"base"})";
  EXPECT_EQ(Ask(request, kPrefix + "/play/sessions").status, 401);
  EXPECT_EQ(Ask(request, kPrefix + "/play/sessions/one/commands").status, 401);
  request.authorization = fmt::format("Bearer {}", kTestToken);
  EXPECT_EQ(Ask(request, kPrefix + "/play/sessions").status, 503) << "no bus";
}

TEST_F(ContractTest, OpeningAPlaySessionStartsAWorkerAndTakesNoPath) {
  live::PlayWatch watch(bus::Arguments{.domain = 66});
  context_.play = &watch;
  context_.domain = 66;
  context_.bus_flags = [](security::Role role) {
    return std::vector<std::string>{"--domain", "66", "--security", "ids/" + ToString(role), "--profile", "net.xml"};
  };
  http::Request request;
  request.method = "POST";
  request.content_type = "application/json";
  request.authorization = fmt::format("Bearer {}", kTestToken);
  request.body = R"({"spec":"quickstart","run":"base","index":3})";
  const auto opened = Ask(request, kPrefix + "/play/sessions");
  ASSERT_EQ(opened.status, 202) << opened.body;
  const auto json = OrderedJson::parse(opened.body);
  EXPECT_NE(json["command"].get<std::string>().find("etude worker play"), std::string::npos);
  EXPECT_NE(json["command"].get<std::string>().find("--index 3 --domain 66 --security ids/worker --profile net.xml"),
            std::string::npos);
  EXPECT_EQ(GetJson(kPrefix + "/jobs/" + json["job"].get<std::string>())["action"], "play");
  request.body = R"({"spec":"quickstart","run":"base","index":3,"seed":"18446744073709551615","dry_run":true})";
  request.authorization.clear();
  const auto shown = Ask(request, kPrefix + "/play/sessions");
  ASSERT_EQ(shown.status, 200) << "what changes nothing needs no token: " << shown.body;
  const std::string command = OrderedJson::parse(shown.body)["command"].get<std::string>();
  EXPECT_NE(command.find("--run base --index 3 --seed 18446744073709551615 --domain 66"), std::string::npos) << command;
  EXPECT_EQ(GetJson(kPrefix + "/jobs")["jobs"].size(), 1u) << "only the one that was opened";
  request.authorization = fmt::format("Bearer {}", kTestToken);
  for (const char* body : {R"({"spec":"../../etc/passwd","run":"base"})", R"({"spec":"quickstart","run":"a b"})",
                           R"({"spec":"/tmp/x.yaml","run":"base"})", R"({"run":"base"})",
                           R"({"spec":"quickstart","run":"base","seed":"-1"})",
                           R"({"spec":"quickstart","run":"base","seed":"18446744073709551616"})"}) {
    request.body = body;
    const int status = Ask(request, kPrefix + "/play/sessions").status;
    EXPECT_TRUE(status == 400 || status == 404) << body << ": " << status;
  }
  EXPECT_EQ(Get(kPrefix + "/play/sessions/none").status, 404);
  context_.play = nullptr;
}

TEST_F(ContractTest, SigningInSetsACookieThatCounts) {
  http::Request request;
  request.method = "POST";
  request.content_type = "application/json";
  request.body = R"({"token":"wrong wrong wrong wrong"})";
  EXPECT_EQ(Ask(request, kPrefix + "/session").status, 401);
  request.body = OrderedJson{{"token", kTestToken}}.dump();
  const auto answer = Ask(request, kPrefix + "/session");
  ASSERT_EQ(answer.status, 204);
  const std::string cookie = answer.headers.at(0).second;
  EXPECT_NE(cookie.find("HttpOnly"), std::string::npos);
  EXPECT_NE(cookie.find("SameSite=Strict"), std::string::npos);
  http::Request next;
  next.cookie = cookie.substr(0, cookie.find(';'));
  EXPECT_NE(Ask(next, kPrefix + "/session").body.find("\"authorized\":true"), std::string::npos);
}

TEST_F(ContractTest, MetricsAreWhatPrometheusReads) {
  const auto text = Get("/metrics").body;
  EXPECT_NE(text.find("etude_demonstrations_total{campaign=\"lab.data\"} 6\n"), std::string::npos) << text;
  EXPECT_NE(text.find("reason=\"plan_failed\""), std::string::npos);
  EXPECT_NE(text.find("etude_plan_seconds_bucket{campaign=\"lab.data\",le=\"+Inf\"} 1\n"), std::string::npos);
  EXPECT_NE(text.find("etude_checkpoint_step{run=\"lab.run\",channel=\"latest\"} 200\n"), std::string::npos);
  EXPECT_EQ(Get("/healthz").body, "ok\n");
  http::Request probe;
  probe.path = {"healthz"};
  EXPECT_EQ(service_.LaneOf(probe), http::Lane::kAtOnce) << "behind no folder that is read";
  EXPECT_EQ(Get("/readyz").status, 200);
}

}  // namespace contract_test
}  // namespace etude::api
