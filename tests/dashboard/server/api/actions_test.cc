// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/api/actions.cc: the commands that actions are.
#include <gmock/gmock.h>

#include "services/store/filter_keys.h"
#include "tests/dashboard/server/api/api_fixture.h"
#include "tests/support/matchers.h"

namespace etude::api {
namespace actions_test {

using testing::EndsWith;
using testing::HasSubstr;

class ActionsTest : public ApiFixture {
 protected:
  http::Answer Post(OrderedJson body, bool dry = true, const std::string& token = "") {
    http::Request request;
    request.method = "POST";
    request.content_type = "application/json";
    if (dry) body["dry_run"] = true;
    if (!token.empty()) request.authorization = "Bearer " + token;
    request.body = body.dump();
    return Ask(request, kPrefix + "/actions");
  }
  std::string CommandOf(const OrderedJson& body) {
    const auto answer = Post(body);
    EXPECT_EQ(answer.status, 200) << answer.body;
    return answer.status == 200 ? OrderedJson::parse(answer.body)["command"].get<std::string>() : "";
  }
};

// before, it waited for what nobody publishes, under an id by which no page found it
TEST_F(ActionsTest, ARunIsFollowedWhileItIsTrainedAndElseServedUnderItsOwnId) {
  context_.domain = 66;
  const OrderedJson body{{"action", "serve"}, {"run", "lab.run"}};
  const Path folder = lab_.root() / "run";
  const auto identity = OpenIdentity(folder);
  ASSERT_THAT(identity, IsOk());
  const std::string served = CommandOf(body);
  EXPECT_THAT(served, HasSubstr("etude policy --checkpoint " + (folder / "checkpoints").string()));
  EXPECT_THAT(served, HasSubstr(" --run " + folder.string()));
  live::LiveModel model;
  model.view().enabled = true;
  bus::Presence run;
  run.kind = bus::PresenceKind::kRun, run.id = identity->id, run.name = "live";
  model.Directory({run}, MonotonicClock::now());
  live_ = std::make_shared<const live::LiveView>(model.view());
  EXPECT_THAT(CommandOf(body), HasSubstr("etude policy --subscribe live@" + identity->id));
}

TEST_F(ActionsTest, TickedEpisodesGetAFilterKeyByTheCommandThatWritesIt) {
  context_.bus_flags = [](security::Role role) {
    return std::vector<std::string>{"--domain", "66", "--security", "ids/" + ToString(role)};
  };
  const OrderedJson body{{"action", "mask"}, {"dataset", "lab.data"}, {"key", "good"}, {"indices", "4,0-2,1"}};
  EXPECT_THAT(CommandOf(body), HasSubstr("etude dataset filter " + (lab_.root() / "data").string() +
                                         " --index 0-2 4 --as good --domain 66 --security ids/gateway"));
  EXPECT_EQ(Post(body, false).status, 401);
  EXPECT_EQ(Post(body, false, kTestToken).status, 202);
}

TEST_F(ActionsTest, AFilterKeyIsAPlainNameOfEpisodes) {
  const auto status = [&](const OrderedJson& key, const OrderedJson& indices) {
    return Post({{"action", "mask"}, {"dataset", "lab.data"}, {"key", key}, {"indices", indices}}).status;
  };
  EXPECT_EQ(status("good", "1"), 200);
  for (const char* key : {"", "--yes", "-x", "a b", "../x", "A"}) EXPECT_EQ(status(key, "1"), 400) << key;
  for (const char* indices : {"", "x", "3-1", "1;2", "--task", "0-10000", "18446744073709551616"})
    EXPECT_EQ(status("good", indices), 400) << indices;
  EXPECT_EQ(status("good", 1), 400);
  std::string many;
  for (int i = 0; i < 1001; ++i) many += std::to_string(2 * i) + ",";
  EXPECT_EQ(status("good", many), 400) << "each span is an argument";
  EXPECT_EQ(Post({{"action", "mask"}, {"dataset", "lab.none"}, {"key", "good"}, {"indices", "1"}}).status, 404);
}

TEST_F(ActionsTest, EvaluationsLieInTheFoldersGiven) {
  const OrderedJson body{{"action", "evaluate"}, {"file", "00000200.safetensors"}, {"dry_run", true}};
  OrderedJson in_lab = body;
  in_lab["run"] = "lab.run";
  EXPECT_THAT(CommandOf(in_lab), HasSubstr("--out " + (lab_.root() / "run-eval-00000200-9001").string()));

  // a run that is itself what was given has nothing beside it
  sources::Sources alone({lab_.root() / "run"});
  Context context(
      alone, [this] { return live_; }, [](http::Lane, const std::function<void()>&) {}, security_, jobs_);
  const http::Router router = MakeRouter(context);
  http::Request request;
  request.method = "POST";
  request.content_type = "application/json";
  request.path = http::SplitPath(kPrefix + "/actions").value();
  OrderedJson of_root = body;
  of_root["run"] = "run";
  request.body = of_root.dump();
  std::vector<std::string> allowed;
  const http::Route* route = router.Find(request, allowed);
  ASSERT_NE(route, nullptr);
  const auto answer = route->handler(request);
  ASSERT_THAT(answer, IsOk());
  EXPECT_THAT(answer->body, HasSubstr("--out " + (lab_.root() / "run" / "eval-00000200-9001").string()));
}

// the report there is of the run that was removed: the command would refuse to go on with it, for ever
TEST_F(ActionsTest, AnEvaluationOfARunMadeAnewLiesBesideThatOfTheOneBefore) {
  const auto identity = OpenIdentity(lab_.root() / "run");
  ASSERT_THAT(identity, IsOk());
  const OrderedJson body{{"action", "evaluate"}, {"run", "lab.run"}, {"file", "00000200.safetensors"}};
  const Path before = lab_.root() / "run-eval-00000200-9001";
  const auto write = [&](const std::string& run_id) {
    std::filesystem::create_directories(before);
    ASSERT_THAT(WriteFileAtomically(before / "eval.json", OrderedJson{{"policy", {{"run_id", run_id}}}}.dump()),
                IsOk());
  };
  write("00000000000000aa");
  EXPECT_THAT(CommandOf(body), HasSubstr("--out " + before.string() + "-2"));
  write(identity->id);
  EXPECT_THAT(CommandOf(body), testing::Not(HasSubstr(before.string() + "-2"))) << "its own goes on";
}

// what the command writes is what the page then offers
TEST_F(ActionsTest, AKeyThatWasWrittenIsAFilter) {
  ASSERT_THAT(store::WriteFilterKey(lab_.root() / "data", "good", {0, 4}), IsOk());
  EXPECT_THAT(GetJson(kPrefix + "/datasets/lab.data")["keys"], testing::Contains("good"));
  EXPECT_EQ(GetJson(kPrefix + "/datasets/lab.data/episodes?key=good")["columns"]["index"], OrderedJson({4, 0}));
}

}  // namespace actions_test
}  // namespace etude::api
