// SPDX-License-Identifier: Apache-2.0
// Tests services/spec/task_spec.cc, task_rules.cc, task_name.cc and the files in deploy/tasks
#include "services/spec/task_spec.h"

#include <gmock/gmock.h>

#include "services/spec/campaign_spec.h"
#include "services/spec/task_name.h"
#include "services/spec/task_roles.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude {
namespace {

constexpr const char* kGood = R"(
name: pick_well
words: {verbs: [take]}
avoid: [others]
stages: [approach, reach, grasp, {lift: {room: 0.2}}, hold]
success: {risen: {by: 3 cm}}
)";

Result<TaskSpec> Parse(const std::string& text) { return ParseTaskSpec(*ParseYaml(text, "my.yaml"), "my.yaml"); }

// kGood with one line replaced, or one added.
Result<TaskSpec> With(const std::string& key, const std::string& value) {
  OrderedJson json = *ParseYaml(kGood, "my.yaml");
  json[key] = *ParseYaml(value, "value");
  return ParseTaskSpec(json, "my.yaml");
}

TEST(TaskSpec, ReadsStagesWithTheirParameters) {
  const auto task = Parse(kGood);
  ASSERT_THAT(task, IsOk());
  ASSERT_EQ(task->stages.size(), 5u);
  EXPECT_EQ(NameOf(task->stages[1]), "reach");
  EXPECT_EQ(std::get<LiftSpec>(task->stages[3]).room, 0.2);
  EXPECT_EQ(std::get<GraspSpec>(task->stages[2]).max_steps, GraspSpec{}.max_steps);
  EXPECT_FALSE(task->carries());
}

TEST(TaskSpec, TheHashIsOfTheMeaning) {
  const std::string hash = Parse(kGood)->sha256;
  EXPECT_EQ(Parse(std::string("# a comment\n") + kGood)->sha256, hash);
  EXPECT_EQ(With("summary", "words for people")->sha256, hash);
  EXPECT_EQ(With("stages", "[approach: {to: grasp}, reach: {}, grasp, lift: {room: 0.2}, hold: {steps: 20}]")->sha256,
            hash)
      << "what is left out is the default";
  EXPECT_NE(With("stages", "[approach, reach, grasp, lift: {room: 0.21}, hold]")->sha256, hash);
  EXPECT_NE(With("success", "{risen: {by: 4 cm}}")->sha256, hash);
  EXPECT_NE(With("words", "{verbs: [fetch]}")->sha256, hash);
}

TEST(TaskSpec, NamesTheNearestKeyAndPrimitive) {
  EXPECT_THAT(With("stagse", "[]"), MessageHas("did you mean 'stages'"));
  EXPECT_THAT(With("stages", "[aproach, reach, grasp, hold]"), MessageHas("did you mean 'approach'"));
  EXPECT_THAT(With("stages", "[approach, reach, grasp, lift: {rom: 1}, hold]"), MessageHas("did you mean 'room'"));
  EXPECT_THAT(With("stages", "[approach: {to: gras}, reach, grasp, hold]"), MessageHas("did you mean 'grasp'"));
  EXPECT_THAT(With("avoid", "[obstacles]"), MessageHas("obstacle, others"));
}

TEST(TaskSpec, AllProblemsAtOnce) {
  const auto task = Parse("{name: Bad Name, stages: [reach, lift: {room: 7}], words: {places: [on]}}");
  ASSERT_THAT(task, HasCode(Code::kInvalidArgument));
  for (const char* part : {"name:", "words.verbs", "words.places", "stages[0].reach: cannot come here", "room: 7",
                           "must be hold", "success"})
    EXPECT_THAT(task, MessageHas(part));
}

TEST(TaskSpec, StagesMustFollowFromOneAnother) {
  const std::vector<std::pair<std::string, std::string>> wrong{
      {"[approach, grasp, hold]", "stages[1].grasp: cannot come here"},
      {"[approach: {to: push}, reach, hold]", "stages[1].reach: cannot come here"},
      {"[approach, reach, grasp, lift, retreat, hold]", "stages[4].retreat: cannot come here"},
      {"[approach, reach, grasp, lift, carry: {to: left}, hold]", "reference: {needed: true}"},
      {"[approach, reach, grasp, lift, release]", "must be hold"},
      {"[]", "at least one"}};
  for (const auto& [stages, message] : wrong) EXPECT_THAT(With("stages", stages), MessageHas(message)) << stages;
}

TEST(TaskSpec, APlaceIsStraightBelowWhereItWasCarriedTo) {
  OrderedJson json = *ParseYaml(kGood, "my.yaml");
  json["reference"]["needed"] = true;
  json["words"]["places"] = {"beside"};
  json["stages"] =
      *ParseYaml("[approach, reach, grasp, lift, carry: {to: left}, place: {to: right}, release, hold]", "");
  EXPECT_THAT(ParseTaskSpec(json, "my.yaml"), MessageHas("`carry: {to: right}` has to come just before"));
  json["stages"][5]["place"]["to"] = "left";
  EXPECT_THAT(ParseTaskSpec(json, "my.yaml"), IsOk());
}

TEST(TaskName, BuiltInTasksAreRead) {
  EXPECT_THAT(BaseTasks(), testing::IsSupersetOf({"pick", "push", "put_down", "rotate", "place_left", "place_right",
                                                  "place_front", "place_behind"}));
  for (const auto& name : KnownTasks()) {
    const auto task = ParseTask(name);
    ASSERT_THAT(task, IsOk()) << name;
    EXPECT_EQ(task->text(), name);
    EXPECT_EQ(task->relation(), !task->spec->words.places.empty()) << name;
    EXPECT_FALSE(task->spec->summary.empty()) << name;
  }
}

TEST(TaskName, VariantsAreOfTheTasksThatHaveThem) {
  EXPECT_EQ(ParseTask("push+obstacle")->avoid, "obstacle");
  EXPECT_THAT(ParseTask("place_left+obstacle"), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(ParseTask("pick+"), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(ParseTask("pusch"), MessageHas("did you mean 'push'"));
}

TEST(TaskName, AFileOfTheUsersIsNamedByItsPath) {
  TemporaryFolder folder;
  const std::string path = (folder.path() / "my+own.yaml").string();
  ASSERT_THAT(WriteFileAtomically(path, std::string_view(kGood)), IsOk());
  const auto task = ParseTask(path + "+others");
  ASSERT_THAT(task, IsOk());
  EXPECT_EQ(task->base, path);
  EXPECT_EQ(task->avoid, "others");
  EXPECT_EQ(task->spec->name, "pick_well");
  EXPECT_EQ(ParseTask(path)->spec, task->spec) << "read once";
  EXPECT_THAT(ParseTask(path + "+obstacle"), MessageHas("+others"));
  EXPECT_THAT(ParseTask((folder.path() / "none.yaml").string()), HasCode(Code::kNotFound));
}

TEST(TaskRoles, OnlyWhatATaskAllowsIsItsReference) {
  TaskSpec task;
  task.reference = {.needed = true, .only = {"box"}};
  const std::vector<std::string> objects{"cube", "things/box", "coke"};
  EXPECT_THAT(PossibleTargets(task, objects), testing::ElementsAre("cube", "coke"));
  EXPECT_THAT(PossibleReferences(task, "cube", objects), testing::ElementsAre("things/box"));
  EXPECT_THAT(WithReference(task, {"cube", "coke"}, objects), testing::ElementsAre("cube", "things/box"));
  EXPECT_THAT(WithReference(task, {"things/box", "coke"}, objects), testing::ElementsAre("things/box", "coke"));
  task.reference = {.needed = true};
  EXPECT_EQ(PossibleTargets(task, objects), objects);
  task.reference = {};
  EXPECT_EQ(PossibleTargets(task, objects), objects);
}

TEST(TaskName, ACampaignsHashDependsOnWhatItsTaskFilesSay) {
  TemporaryFolder folder;
  CampaignSpec spec;
  spec.tasks = {(folder.path() / "later.yaml").string()};
  const std::string without = SpecHash(spec);
  ASSERT_THAT(WriteFileAtomically(spec.tasks[0], std::string_view(kGood)), IsOk());
  EXPECT_NE(SpecHash(spec), without);
}

}  // namespace
}  // namespace etude
