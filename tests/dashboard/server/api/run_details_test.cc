// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/api/curriculum.cc, graph.cc, runs.cc, run_figures.cc, series.cc, checkpoints.cc and
// differences.cc: what a run's files come to.
#include <gmock/gmock.h>

#include <cstring>
#include <set>

#include "dashboard/server/api/curriculum.h"
#include "dashboard/server/api/graph.h"
#include "tests/dashboard/server/api/api_fixture.h"
#include "tests/support/matchers.h"

namespace etude::api {
namespace run_details_test {

using testing::ElementsAre;

sources::RunView ViewOf(const std::string& config) {
  sources::RunView view;
  view.config = ParseYaml(config, "config.yaml").value_or(OrderedJson());
  return view;
}

OrderedJson Advance(int from, int to, int step, const char* cause) {
  return {{"from", from},   {"to", to},       {"step", step}, {"name", "stage " + std::to_string(to)},
          {"cause", cause}, {"reason", cause}};
}

std::vector<std::string> StatesOf(const OrderedJson& stages) {
  std::vector<std::string> states;
  for (const auto& stage : stages) states.push_back(stage["state"]);
  return states;
}

// ---- stages --------------------------------------------------------------------------------------

TEST(StagesJson, BeforeTheFirstLineAllAreAheadByTheirModulesNames) {
  RunState state;
  state.stages = 2;
  const auto stages = StagesJson(ViewOf(kExampleConfig), state);
  EXPECT_THAT(StatesOf(stages), ElementsAre("ahead", "ahead"));
  EXPECT_EQ(stages[0]["name"], "LANG");
  EXPECT_EQ(stages[1]["name"], "TAR3D");
  EXPECT_TRUE(stages[0]["from_step"].is_null());
}

TEST(StagesJson, AnAdvanceEndsOneStageAndBeginsTheNext) {
  auto view = ViewOf(kExampleConfig);
  view.curriculum = {Advance(1, 2, 100, "budget")};
  RunState state;
  state.state = "running", state.stage = 2, state.stages = 3;
  const auto stages = StagesJson(view, state);
  ASSERT_THAT(StatesOf(stages), ElementsAre("done", "current", "ahead"));
  EXPECT_EQ(stages[0]["from_step"], 0);
  EXPECT_EQ(stages[0]["to_step"], 100);
  EXPECT_EQ(stages[0]["cause"], "budget");
  EXPECT_EQ(stages[1]["from_step"], 100);
  EXPECT_TRUE(stages[1]["to_step"].is_null());
  EXPECT_EQ(stages[1]["name"], "stage 2") << "as the trainer calls it";
  state.state = "finished";
  state.step = 240;
  const auto over = StagesJson(view, state);
  EXPECT_THAT(StatesOf(over), ElementsAre("done", "done", "ahead"));
  EXPECT_EQ(over[1]["to_step"], 240) << "of which no line tells";
}

TEST(StagesJson, OfARunThatWasResumedTheLastWordCounts) {
  auto view = ViewOf(kExampleConfig);
  view.curriculum = {Advance(1, 2, 100, "goal"), Advance(2, 3, 150, "budget"), Advance(1, 2, 90, "budget")};
  RunState state;
  state.state = "running", state.stage = 2, state.stages = 3;
  const auto stages = StagesJson(view, state);
  EXPECT_EQ(stages[0]["to_step"], 90);
  EXPECT_EQ(stages[0]["cause"], "budget");
  EXPECT_EQ(stages[1]["from_step"], 90);
  // before, the stage that the life before had come to was under way, too
  EXPECT_THAT(StatesOf(stages), ElementsAre("done", "current", "ahead"));
}

TEST(StagesJson, LinesThatMakeNoSenseAreLeftOut) {
  auto view = ViewOf(kExampleConfig);
  view.curriculum = {Advance(-1, 2, 5, "x"), Advance(1, 5000, 5, "x"), OrderedJson::array(), OrderedJson(), "text"};
  RunState state;
  state.stages = 1'000'000;
  const auto stages = StagesJson(view, state);
  EXPECT_LE(stages.size(), 100u) << "whatever a file claims";
  EXPECT_EQ(stages[0]["state"], "current");
}

// ---- graph ---------------------------------------------------------------------------------------

TEST(GraphJson, HasEveryWayInWhichOneModuleUsesAnother) {
  const auto graph = GraphJson(ViewOf(kExampleConfig));
  ASSERT_THAT(graph, IsOk());
  std::set<std::vector<std::string>> edges;
  for (const auto& edge : (*graph)["edges"]) {
    std::vector<std::string> words;
    for (const char* key : {"from", "to", "kind"}) words.push_back(edge[key]);
    edges.insert(words);
  }
  const std::set<std::vector<std::string>> expected{{"LANG", "TAR3D", "decoded"},
                                                    {"LANG", "TAR3D", "query"},
                                                    {"LANG", "TAR3D", "register"},
                                                    {"image", "TAR3D", "register"},
                                                    {"language", "LANG", "register"}};
  EXPECT_EQ(edges, expected);
  EXPECT_EQ((*graph)["columns"], OrderedJson::parse(R"([["image","language","joints"],["LANG"],["TAR3D"]])"));
  EXPECT_TRUE((*graph)["checkpoint"].is_null());
  EXPECT_EQ((*graph)["nodes"][1]["trained"], false);
}

TEST(GraphJson, TakesWhatTheNewestReadableCheckpointSays) {
  auto view = ViewOf(kExampleConfig);
  sources::CheckpointHeader damaged, newest, older;
  damaged.file = "3", damaged.error = "cut";
  newest.file = "2", newest.metadata = {{"modules", R"({"LANG":{"trained_steps":7,"error":0.5}})"}};
  newest.parameters = {{"LANG", 6}};
  older.file = "1";
  view.checkpoints = {damaged, newest, older};
  const auto graph = GraphJson(view).value();
  EXPECT_EQ(graph["checkpoint"], "2");
  EXPECT_EQ(graph["nodes"][0]["trained_steps"], 7);
  EXPECT_EQ(graph["nodes"][0]["error"], 0.5);
  EXPECT_EQ(graph["nodes"][0]["parameters"], 6);
  EXPECT_TRUE(graph["nodes"][1]["trained_steps"].is_null());

  view.checkpoints[1].metadata["modules"] = "[1, 2";  // what a stranger wrote
  EXPECT_THAT(GraphJson(view), IsOk());
}

TEST(GraphJson, OfWhatIsNoPolicyIsSaid) {
  EXPECT_THAT(GraphJson(ViewOf("")), HasCode(Code::kNotFound));
  EXPECT_THAT(GraphJson(ViewOf("policy: {modules: {}}")), HasCode(Code::kNotFound));
  EXPECT_THAT(GraphJson(ViewOf("policy: {modules: []}")), HasCode(Code::kNotFound));
  EXPECT_THAT(GraphJson(ViewOf("policy: {modules: [3, {name: 4}, {decoder: x}, {reads: [a, [b]]}]}")), IsOk());
  std::string many = "policy: {modules: [{name: first}";
  for (int i = 0; i < 200; ++i) many += ", {name: m" + std::to_string(i) + "}";
  EXPECT_THAT(GraphJson(ViewOf(many + "]}")), HasCode(Code::kNotFound));
}

// ---- series, checkpoints, differences -------------------------------------------------------------

class RunDetails : public ApiFixture {};

TEST_F(RunDetails, TheCsvHasARowAStepAndNothingWhereThereIsNoNumber) {
  const std::string text = Get(kPrefix + "/runs/lab.run/series.csv?kind=train").body;
  const std::string expected =
      "run,kind,step,time,elapsed_s,LANG.decode,data_wait,loss,samples_per_second,stage\n"
      "lab.run,train,50,1795369650,5,0.5,0.01,2,900,2\n"
      "lab.run,train,100,1795369700,10,0.5,0.01,1,900,2\n"
      "lab.run,train,150,1795369750,15,0.5,0.01,,900,2\n"
      "lab.run,train,200,1795369800,20,0.5,0.01,0.5,900,2\n";
  EXPECT_EQ(text, expected);
  EXPECT_EQ(Get(kPrefix + "/runs/lab.run/series.csv?kind=valid").body,
            "run,kind,step,time,elapsed_s,LANG.accuracy,TAR3D.cm,loss\n"
            "lab.run,valid,200,1795369821,21,0.75,0.5,1\n");
  EXPECT_EQ(Get(kPrefix + "/runs/lab.run/series.csv?kind=none").body, "run,kind,step,time,elapsed_s\n");
}

TEST_F(RunDetails, TheCsvHasAllKindsAndRunsUnderTheSameColumns) {
  WriteExampleRun(lab_.root() / "run_b");
  const std::string alone = Get(kPrefix + "/runs/lab.run/series.csv").body;
  EXPECT_THAT(alone, testing::StartsWith("run,kind,step,time,elapsed_s,LANG.accuracy,LANG.decode,TAR3D.cm,data_wait,"
                                         "loss,samples_per_second,stage\n"
                                         "lab.run,train,50,1795369650,5,,0.5,,0.01,2,900,2\n"));
  EXPECT_THAT(alone, testing::EndsWith("lab.run,valid,200,1795369821,21,0.75,,0.5,,1,,\n"));
  const std::string both = Get(kPrefix + "/runs/lab.run/series.csv?run=lab.run_b").body;
  EXPECT_THAT(both, testing::StartsWith(alone));
  EXPECT_THAT(both, testing::HasSubstr("\nlab.run_b,valid,200,1795369821,21,0.75,,0.5,,1,,\n"));
  // a run that is named twice stands there once
  EXPECT_EQ(Get(kPrefix + "/runs/lab.run/series.csv?run=lab.run").body, alone);
  EXPECT_EQ(Get(kPrefix + "/runs/lab.run/series.csv?run=lab.none").status, 404);
}

// of a run that nobody trains no checkpoint is due
TEST_F(RunDetails, TheNextCheckpointIsOfARunThatIsTrained) {
  const Path metrics = lab_.root() / "run" / "metrics.jsonl";
  const std::string text = ReadTextFile(metrics).value() + "\n";  // behind the torn line
  ASSERT_THAT(WriteFileAtomically(
                  metrics, text + R"({"kind": "end", "cause": "stopped", "step": 200, "time": 1795369822})" + "\n"),
              IsOk());
  EXPECT_TRUE(GetJson(kPrefix + "/runs/lab.run/checkpoints")["next_step"].is_null());
}

TEST_F(RunDetails, SeriesTakeAnyAbscissaAndSpan) {
  const auto numbers = [&](const std::string& query, const std::string& tensor) {
    const auto arrays = GetArrays(kPrefix + "/runs/lab.run/series?keys=train/loss&" + query);
    std::vector<double> values(arrays.tensors.at(tensor).data.size() / sizeof(double));
    std::memcpy(values.data(), arrays.tensors.at(tensor).data.data(), arrays.tensors.at(tensor).data.size());
    return values;
  };
  EXPECT_THAT(numbers("x=elapsed", "train/loss/x"), ElementsAre(5, 10, 15, 20));
  // what is not finite stands for itself, whatever is finite beside it
  EXPECT_THAT(numbers("x=elapsed", "train/loss/last"), ElementsAre(2, 1, testing::IsNan(), 0.5));
  EXPECT_THAT(numbers("x=time&from=1795369690", "train/loss/x"), ElementsAre(1795369700, 1795369750, 1795369800));
  // 32 pictures a step, as samples_per_second counts them
  EXPECT_THAT(numbers("x=samples", "train/loss/x"), ElementsAre(1600, 3200, 4800, 6400));
  EXPECT_THAT(numbers("from=60&to=120", "train/loss/last"), ElementsAre(1));
  EXPECT_THAT(numbers("points=2", "train/loss/max"), ElementsAre(2, testing::IsNan(), 0.5)) << "buckets of equal width";
  EXPECT_THAT(numbers("x=elapsed", "train/loss/step"), ElementsAre(50, 100, 150, 200));
  EXPECT_THAT(numbers("x=elapsed&points=2", "train/loss/step"), ElementsAre(100, 150, 200)) << "of the last one";
  EXPECT_EQ(Get(kPrefix + "/runs/lab.run/series?from=early").status, 400);
  std::string keys;
  for (int i = 0; i < 33; ++i) keys += "k" + std::to_string(i) + ",";
  EXPECT_EQ(Get(kPrefix + "/runs/lab.run/series?keys=" + keys).status, 400) << "at most 32";
}

TEST_F(RunDetails, DifferencesAreTheKeysThatDiffer) {
  const auto same = GetJson(kPrefix + "/diff?a=lab.run&b=lab.run");
  EXPECT_EQ(same["total"], 0);
  const auto other = GetJson(kPrefix + "/diff?a=lab.eval_a&b=lab.eval_other");
  ASSERT_EQ(other["total"], 1) << other.dump(1);
  EXPECT_EQ(other["keys"][0]["key"], "seed");
  EXPECT_EQ(other["keys"][0]["a"], 9001);
  EXPECT_EQ(other["keys"][0]["b"], 9002);

  // of different kinds of things: keys of the one alone, modules by their names
  const auto kinds = GetJson(kPrefix + "/diff?a=lab.run&b=lab.data");
  std::set<std::string> keys;
  for (const auto& key : kinds["keys"]) keys.insert(key["key"]);
  EXPECT_TRUE(keys.contains("policy.modules[TAR3D].level")) << kinds.dump(1);
  EXPECT_TRUE(keys.contains("camera.width"));
  EXPECT_EQ(Get(kPrefix + "/diff?a=lab.run&b=lab.none").status, 404);
  EXPECT_EQ(Get(kPrefix + "/diff?a=lab.run").status, 404);
}

}  // namespace run_details_test
}  // namespace etude::api
