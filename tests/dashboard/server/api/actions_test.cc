// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/api/actions.cc: the commands that actions are.
#include <gmock/gmock.h>

#include <filesystem>
#include <string>
#include <vector>

#include "services/store/dataset.h"
#include "services/store/filter_keys.h"
#include "services/store/safetensors.h"
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

// before, whatever a run was trained on, it was measured on pick, push and put_down with the UR5
TEST_F(ActionsTest, ARunIsEvaluatedInTheScenesThatAreAskedFor) {
  OrderedJson body{{"action", "evaluate"}, {"run", "lab.run"}, {"file", "00000200.safetensors"}};
  const auto plain = Post(body);
  EXPECT_THAT(plain.body, testing::Not(HasSubstr("--scenes")));
  EXPECT_EQ(OrderedJson::parse(plain.body)["scenes"], "default");
  body["scenes"] = "obstacle";
  const auto other = Post(body);
  ASSERT_EQ(other.status, 200) << other.body;
  EXPECT_THAT(other.body, HasSubstr("campaigns/obstacle.yaml"));
  EXPECT_THAT(other.body, HasSubstr("run-eval-00000200-9001-obstacle")) << "one folder has one kind of scenes";
  EXPECT_EQ(OrderedJson::parse(other.body)["scenes"], "obstacle");
  for (const OrderedJson& wrong : {OrderedJson("none"), OrderedJson(""), OrderedJson("../x"), OrderedJson(3)}) {
    body["scenes"] = wrong;
    EXPECT_EQ(Post(body).status, 400) << wrong.dump();
  }
}

// before, it was measured in those of `etude eval` whatever they were, unless one knew and chose others
TEST_F(ActionsTest, ARunIsEvaluatedInTheScenesOfItsDataset) {
  const Path data = lab_.root() / "my data";
  std::filesystem::rename(lab_.root() / "data", data);
  const auto reader = store::DatasetReader::Open(data);
  ASSERT_THAT(reader, IsOk());
  const std::string hash = reader->spec_sha256(), another(64, 'b');
  const auto trained_on = [&](const std::vector<std::string>& hashes) {
    OrderedJson said;
    said["datasets"] = hashes;
    store::Safetensors state;
    state.metadata = {{"run", said.dump()}};
    state.tensors["rng"] = {store::DType::kU8, {1}, std::vector<std::uint8_t>(1)};
    ASSERT_THAT(store::WriteSafetensors(lab_.root() / "run" / "training_state.safetensors", state), IsOk());
  };
  OrderedJson body{{"action", "evaluate"}, {"run", "lab.run"}, {"file", "00000200.safetensors"}};
  const auto scenes = [&] { return OrderedJson::parse(Post(body).body)["scenes"]; };
  trained_on({hash});
  EXPECT_THAT(CommandOf(body), HasAll({"--scenes '" + data.string() + "'", "run-eval-00000200-9001-my data'"}));
  EXPECT_EQ(scenes(), "my data");
  trained_on({hash, hash});
  EXPECT_EQ(scenes(), "my data") << "two shards of one campaign";
  trained_on({hash, another});
  EXPECT_EQ(scenes(), "default") << "of several, none is the one";
  trained_on({another});
  EXPECT_EQ(scenes(), "default") << "it is elsewhere";
  trained_on({hash});
  body["scenes"] = "obstacle";
  EXPECT_EQ(scenes(), "obstacle");
  body["scenes"] = "default";
  EXPECT_THAT(CommandOf(body), testing::Not(HasSubstr("--scenes")));
}

// before, every question was refused, and who had asked for it learnt that after an hour
TEST_F(ActionsTest, ACheckpointOfAnotherRobotOrCameraNeedsScenesOfItsKind) {
  const auto save = [&](const std::string& name, const OrderedJson& embodiment) {
    store::Safetensors content;
    content.metadata = {{"step", "300"}, {"refused", ""}, {"embodiment", embodiment.dump()}};
    content.tensors["modules.LANG.w"] = {store::DType::kF32, {2, 3}, std::vector<std::uint8_t>(24)};
    const Path file = lab_.root() / "run" / "checkpoints" / (name + ".safetensors");
    ASSERT_THAT(store::WriteSafetensors(file, content), IsOk());
  };
  save("panda", {{"robot", "panda"}, {"fovy", 1.047198}});
  save("narrow", {{"robot", "ur5"}, {"fovy", 0.785398}});
  save("anything", OrderedJson::object());
  const auto ask = [&](const std::string& name, const char* scenes = nullptr) {
    OrderedJson body{{"action", "evaluate"}, {"run", "lab.run"}, {"file", name + ".safetensors"}};
    if (scenes) body["scenes"] = scenes;
    return Post(body);
  };
  const auto refused = ask("panda");
  EXPECT_EQ(refused.status, 400);
  EXPECT_THAT(refused.body, HasAll({"robot panda", "franka_transfer"}));
  EXPECT_EQ(ask("panda", "obstacle").status, 400);
  EXPECT_EQ(ask("panda", "franka_transfer").status, 200);
  EXPECT_THAT(ask("narrow").body, HasSubstr("45.0 degrees"));
  EXPECT_EQ(ask("narrow", "real_world_stand_in").status, 200);
  EXPECT_EQ(ask("anything").status, 200) << "an older one does not say";
}

// before, they were taken for what is the default, and something else was done than was asked for
TEST_F(ActionsTest, NumbersOfAWrongKindAreRefusedByName) {
  for (const OrderedJson& wrong : {OrderedJson(-1), OrderedJson("7"), OrderedJson(1.5), OrderedJson(nullptr)}) {
    const auto episodes =
        Post({{"action", "evaluate"}, {"run", "lab.run"}, {"file", "00000200.safetensors"}, {"episodes", wrong}});
    EXPECT_EQ(episodes.status, 400) << wrong.dump();
    EXPECT_THAT(episodes.body, HasSubstr("episodes: a whole number"));
    const auto attempt = Post({{"action", "replay"}, {"dataset", "lab.data"}, {"index", 2}, {"attempt", wrong}});
    EXPECT_EQ(attempt.status, 400) << wrong.dump();
    EXPECT_THAT(attempt.body, HasSubstr("attempt: a whole number"));
  }
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
