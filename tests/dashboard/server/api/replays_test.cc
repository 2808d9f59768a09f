// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/api/replays.cc and the action replay: attempts that were made again.
#include "dashboard/server/api/replays.h"

#include <gmock/gmock.h>

#include "tests/dashboard/server/api/api_fixture.h"
#include "tests/dashboard/server/api/json_schema.h"
#include "tests/support/matchers.h"

namespace etude::api {
namespace replays_test {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

const OrderedJson& PoseJson() {
  static const OrderedJson pose{0.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0};
  return pose;
}

OrderedJson PlanJson() {
  return {
      {"index", 2},
      {"attempt", 0},
      {"seed", kLargeSeed},
      {"robot", "ur5"},
      {"task", "pick"},
      {"target", "coke"},
      {"reference", ""},
      {"outcome", "plan_failed"},
      {"reason", "reach: no path"},
      {"steps", kSteps},
      {"scene", {{"draws", 1}}},
      {"details", OrderedJson::object()},
      {"motions", {{{"step", 0}, {"stages", {"reach"}}, {"disturbance", false}, {"poses", {PoseJson(), PoseJson()}}}}},
      {"nearest",
       {{{"step", 0},
         {"distance_m", 0.1},
         {"a", "hand"},
         {"b", "coke"},
         {"a_m", {0.0, 0.0, 0.1}},
         {"b_m", {0.0, 0.0, 0.0}}},
        {{"step", 10}, {"distance_m", 0.0}, {"a", "hand"}, {"b", "world"}}}}};
}

OrderedJson GeometryJson() {
  const OrderedJson box{
      {"name", "b"}, {"body", "hand"}, {"shape", "box"}, {"size", {0.1, 0.1, 0.1}}, {"pose", PoseJson()}};
  return {{"bodies", {"hand", "coke"}},
          {"poses", {{"file", "poses.f32"}, {"shape", {kSteps, 2, 7}}}},
          {"geometry", OrderedJson::array({box})}};
}

class ReplaysTest : public ApiFixture {
 protected:
  OrderedJson State(const std::string& dataset = "lab.data", const std::string& attempt = "0") {
    const auto json = GetJson(kPrefix + "/datasets/" + dataset + "/episodes/2/replay?attempt=" + attempt);
    EXPECT_THAT(Problems("Replay", json), IsEmpty());
    return json;
  }
  std::vector<std::string> Problems(const std::string& schema, const OrderedJson& value) {
    static const OrderedJson document = OrderedJson::parse(dashboard::OpenApiText());
    std::vector<std::string> problems;
    CheckSchema(document, document["components"]["schemas"][schema], value, "", problems);
    return problems;
  }
  http::Answer Act(OrderedJson body) {
    http::Request request;
    request.method = "POST";
    request.content_type = "application/json";
    request.authorization = fmt::format("Bearer {}", kTestToken);
    body["action"] = "replay";
    request.body = body.dump();
    return Ask(request, kPrefix + "/actions");
  }
  // What the worker leaves of attempt 0 at episode 2; returns its id.
  std::string WriteReplay() {
    const std::string id = State()["id"];
    const Path place = cache_ / "replays" / id.substr(id.find('.') + 1);
    const CampaignSpec spec = store::DatasetReader::Open(lab_.root() / "data")->spec();
    {
      auto writer = store::DatasetWriter::Open(place, spec);
      EXPECT_THAT(writer, IsOk());
      EXPECT_THAT(writer->Commit(MakeSyntheticEpisode(spec, 2, kSteps)), IsOk());
    }
    EXPECT_THAT(WriteFileAtomically(place / "plan.json", PlanJson().dump()), IsOk());
    EXPECT_THAT(WriteFileAtomically(place / "geometry.json", GeometryJson().dump()), IsOk());
    EXPECT_THAT(WriteFileAtomically(place / "poses.f32", std::string(kSteps * 2 * 7 * 4, '\0')), IsOk());
    return id;
  }
};

TEST_F(ReplaysTest, IsMadeOnceIntoTheCacheByTheCommandThatIsShown) {
  EXPECT_EQ(State()["state"], "none");
  const OrderedJson wish{{"dataset", "lab.data"}, {"index", 2}, {"attempt", 0}};
  OrderedJson dry = wish;
  dry["dry_run"] = true;
  EXPECT_THAT(Act(dry).body, HasSubstr("--index 2 --attempt 0 --out attempt-2-0")) << "for a folder of one's own";

  const auto first = Act(wish), second = Act(wish);
  ASSERT_EQ(first.status, 202) << first.body;
  const auto job = OrderedJson::parse(first.body)["job"];
  EXPECT_EQ(OrderedJson::parse(second.body)["job"], job) << "one at a time";
  const auto state = State();
  EXPECT_EQ(state["state"], "running");
  EXPECT_EQ(state["job"], job);
  const std::string id = state["id"], key = id.substr(id.find('.') + 1);
  EXPECT_THAT(first.body, HasSubstr("--out " + (cache_ / "replays" / ("." + key)).string()))
      << "also of a dataset that is itself the root of what was given: never beside it";
  EXPECT_NE(State("lab.data", "1")["id"], id) << "another attempt";
  EXPECT_EQ(State("lab.data", "1")["state"], "none");

  jobs_.Pump();  // no etude lies beside this test
  EXPECT_EQ(State()["state"], "none") << "it failed, and may be asked for again";
  EXPECT_NE(OrderedJson::parse(Act(wish).body)["job"], job);
}

TEST_F(ReplaysTest, OneThatIsThereIsADatasetOfItsOwnAndInNoList) {
  const std::string id = WriteReplay();
  const auto state = State();
  EXPECT_EQ(state["state"], "ready");
  EXPECT_EQ(state["has_episode"], true);
  EXPECT_TRUE(state["job"].is_null());
  EXPECT_EQ(Act({{"dataset", "lab.data"}, {"index", 2}}).status, 200) << "nothing to do";

  const auto episode = GetJson(kPrefix + "/datasets/" + id + "/episodes/2");
  EXPECT_EQ(episode["dataset"], id);
  EXPECT_EQ(episode["steps"], kSteps);
  EXPECT_EQ(Get(kPrefix + "/datasets/" + id + "/episodes/2/pictures/front/0.png").status, 200);
  EXPECT_EQ(GetArrays(kPrefix + "/datasets/" + id + "/episodes/2/tracks?names=eef_pos").tensors.size(), 2u);

  const auto home = GetJson(kPrefix + "/home");
  for (const auto& source : home["sources"]) EXPECT_NE(source["id"], id);
  EXPECT_EQ(home["tiles"]["demonstrations"]["source"], "lab.data");
}

// before, the list of attempts had pictures of successes alone
TEST_F(ReplaysTest, AFailedAttemptsPicturesAreThoseOfItsReplay) {
  const auto failed = [&] { return GetJson(kPrefix + "/campaigns/lab.data/attempts?outcome=failed")["rows"]; };
  for (const auto& row : failed()) EXPECT_TRUE(row["replay"].is_null()) << row.dump();
  const std::string id = WriteReplay();
  std::size_t pictured = 0;
  for (const auto& row : failed()) {
    const bool made_again = row["index"] == 2 && row["attempt"] == 0;
    EXPECT_EQ(row["replay"], made_again ? OrderedJson(id) : OrderedJson()) << row.dump();
    pictured += made_again;
  }
  ASSERT_EQ(pictured, 1u);
  EXPECT_EQ(Get(kPrefix + "/datasets/" + id + "/episodes/2/strip.webp").status, 200);
  for (const auto& row : GetJson(kPrefix + "/campaigns/lab.data/attempts?outcome=success")["rows"])
    EXPECT_TRUE(row["replay"].is_null()) << "it has pictures of its own";

  const Path place = cache_ / "replays" / id.substr(id.find('.') + 1);
  const auto long_ago = std::filesystem::file_time_type::clock::now() - std::chrono::hours(50);
  std::filesystem::last_write_time(place, long_ago);
  (void)failed();
  EXPECT_EQ(std::filesystem::last_write_time(place), long_ago) << "to list it is no use of it";
  std::filesystem::remove(place / "dataset.json");
  for (const auto& row : failed()) EXPECT_TRUE(row["replay"].is_null()) << "it ended before anything moved";
}

TEST_F(ReplaysTest, ItsFilesAreServedAsDescribed) {
  const std::string base = kPrefix + "/replays/" + WriteReplay();
  const auto plan = GetJson(base + "/plan.json");
  EXPECT_THAT(Problems("ReplayPlan", plan), IsEmpty());
  EXPECT_EQ(plan["seed"], std::to_string(kLargeSeed));
  const auto geometry = GetJson(base + "/geometry.json");
  EXPECT_THAT(Problems("ReplayGeometry", geometry), IsEmpty());
  const auto poses = Get(base + "/poses.f32");
  ASSERT_TRUE(poses.file) << poses.body;
  EXPECT_EQ(poses.file->size, kSteps * geometry["bodies"].size() * 7 * 4);
  for (const char* address : {"/replays/lab.data/plan.json", "/replays/replay.x/plan.json", "/replays/..%2Fx/poses.f32",
                              "/replays/replay.00000000000000000000000000000000/geometry.json",
                              "/datasets/replay.00000000000000000000000000000000/episodes/2"})
    EXPECT_EQ(Get(kPrefix + address).status, 404) << address;
}

TEST_F(ReplaysTest, ARolloutIsItsPolicys) {
  const auto state = State("lab.eval_a.rollouts");
  EXPECT_EQ(state["state"], "impossible");
  EXPECT_TRUE(state["id"].is_null());
  EXPECT_THAT(state["why_not"].get<std::string>(), HasSubstr("expert"));
  EXPECT_EQ(Act({{"dataset", "lab.eval_a.rollouts"}, {"index", 2}}).status, 400);
  EXPECT_EQ(Act({{"dataset", "lab.data"}, {"index", 99}}).status, 404);
  EXPECT_EQ(Get(kPrefix + "/datasets/lab.data/episodes/99/replay").status, 404);
  EXPECT_EQ(Get(kPrefix + "/datasets/lab.data/episodes/2/replay?attempt=-1").status, 400);
}

}  // namespace replays_test
}  // namespace etude::api
