// SPDX-License-Identifier: Apache-2.0
// Tests services/spec/task_spec.cc, task_rules.cc, task_name.cc and the files in deploy/tasks
#include "services/spec/task_spec.h"

#include <gmock/gmock.h>

#include <functional>
#include <regex>
#include <set>
#include <tuple>

#include "services/spec/campaign_spec.h"
#include "services/spec/task_name.h"
#include "services/spec/task_roles.h"
#include "services/spec/task_rules.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude {
namespace task_spec_test {

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

TEST(TaskSpec, EveryOtherMeaningIsAnotherHash) {
  std::set<std::string> hashes{Parse(kGood)->sha256};
  const std::vector<std::pair<const char*, const char*>> changes{
      {"name", "other"},
      {"words", "{verbs: [take, fetch]}"},
      {"avoid", "[]"},
      {"avoid", "[obstacle]"},
      {"start", "{boxes: roomy}"},
      {"start", "{not_already: lying}"},
      {"start", "{keep_clear: [[0, 0.07]]}"},
      {"start", "{keep_clear: [[0.07, 0]]}"},
      {"stages", "[approach, reach, grasp: {min_steps: 13}, lift: {room: 0.2}, hold]"},
      {"stages", "[approach, reach, grasp: {max_steps: 81}, lift: {room: 0.2}, hold]"},
      {"stages", "[approach, reach, grasp, lift: {room: 0.2}, hold: {steps: 21}]"},
      {"stages", "[approach, reach, grasp, lift: {room: 0.2}, turn, hold]"},
      {"stages", "[approach, reach, grasp, hold]"},
      {"success", "{all: [{risen: {by: 3 cm}}]}"},
      {"success", "risen"},
      {"latched", "{risen: {by: 3 cm}}"}};
  for (const auto& [key, value] : changes) {
    const auto task = With(key, value);
    ASSERT_THAT(task, IsOk()) << key << " " << value;
    EXPECT_TRUE(hashes.insert(task->sha256).second) << key << " " << value;
  }
  EXPECT_EQ(With("success", "{risen: {by: 0.03 m}}")->sha256, Parse(kGood)->sha256) << "one length, two units";
}

TEST(TaskSpec, NamesTheNearestKeyAndPrimitive) {
  EXPECT_THAT(With("stagse", "[]"), MessageHas("did you mean 'stages'"));
  EXPECT_THAT(With("stages", "[aproach, reach, grasp, hold]"), MessageHas("did you mean 'approach'"));
  EXPECT_THAT(With("stages", "[approach, reach, grasp, lift: {rom: 1}, hold]"), MessageHas("did you mean 'room'"));
  EXPECT_THAT(With("stages", "[approach: {to: gras}, reach, grasp, hold]"), MessageHas("did you mean 'grasp'"));
  EXPECT_THAT(With("avoid", "[obstacles]"), MessageHas("obstacle, others"));
}

TEST(TaskSpec, EveryKeyHasItsRule) {
  for (const auto& [key, value, says] : std::initializer_list<std::tuple<const char*, const char*, const char*>>{
           {"name", "'My Task'", "name: 'My Task' must match [a-z0-9_-]{1,64}"},
           {"words", "{}", "words.verbs: at least one"},
           {"words", "{verbs: [Take]}", "words: 'Take' must be lower-case words"},
           {"words", "{verbs: [' take']}", "words: ' take' must be lower-case words"},
           {"words", "{verbs: ['take ']}", "words: 'take ' must be lower-case words"},
           {"words", "{verbs: ['pick  up']}", "words: 'pick  up' must be lower-case words with single spaces"},
           {"words", "{verbs: ['']}", "words: '' must be lower-case words"},
           {"words", "{verbs: [pick-up]}", "words: 'pick-up' must be lower-case words"},
           {"words", "{verbs: [take], places: [on]}", "words.places: only for a task with a reference"},
           {"reference", "{needed: true}", "words.places: at least one, as 'to the left of'"},
           {"reference", "{only: [cube]}", "reference.only: needs `needed: true` beside it"},
           {"avoid", "[robot]", "avoid: 'robot' is not known; known: obstacle, others"},
           {"start", "{boxes: narrow}", "start.boxes: 'narrow' is not known; known: standard, roomy"},
           {"start", "{keep_clear: [[0]]}", "start.keep_clear: pairs of x and y in m"},
           {"start", "{keep_clear: [[0, 0.1, 0]]}", "start.keep_clear: pairs of x and y in m"},
           {"start", "{keep_clear: [[0, 0.5]]}", "start.keep_clear: pairs of x and y in m"},
           {"start", "{not_already: [risen]}", "start.not_already: a predicate is a word"},
           {"latched", "3", "latched: a predicate is a word"},
           {"success", "~", "success: when is it done?"},
           {"stages", "[3]", "stages[0]: expected a primitive"},
           {"stages", "[{lift: {}, hold: {}}]", "stages[0]: expected a primitive"},
           {"stages", "[zzzzzz]", "stages[0]: no primitive is called 'zzzzzz'; known: approach, reach, grasp"}}) {
    EXPECT_THAT(With(key, value), HasCode(Code::kInvalidArgument)) << key << " " << value;
    EXPECT_THAT(With(key, value), MessageHas(says)) << key << " " << value;
  }
  for (const auto& [key, value] : std::initializer_list<std::pair<const char*, const char*>>{
           {"words", "{verbs: [pick up, take]}"},
           {"avoid", "[obstacle, others]"},
           {"start", "{boxes: roomy, keep_clear: [[-0.49, 0.49]], not_already: risen}"},
           {"latched", "{then: [risen, grasped]}"}})
    EXPECT_THAT(With(key, value), IsOk()) << key << " " << value;
}

// A task about a second object, with `stages` between its grasp and its release.
Result<TaskSpec> Carrying(const std::string& stages) {
  OrderedJson json = *ParseYaml(kGood, "my.yaml");
  json["reference"]["needed"] = true;
  json["words"]["places"] = {"beside"};
  json["stages"] = *ParseYaml("[approach, reach, grasp, " + stages + ", release, hold]", "stages");
  return ParseTaskSpec(json, "my.yaml");
}

TEST(TaskSpec, AStagesParametersHaveRanges) {
  for (const auto& [stages, says] : std::initializer_list<std::pair<const char*, const char*>>{
           {"[hold: {steps: 0}]", "stages[0].hold: steps: 0 not in 1..1000"},
           {"[hold: {steps: 1001}]", "steps: 1001 not in 1..1000"},
           {"[approach, reach, grasp: {min_steps: -1}, hold]", "stages[2].grasp: min_steps: -1 not in 0..1000"},
           {"[approach, reach, grasp: {min_steps: 20, max_steps: 19}, hold]", "max_steps: 19 not in 20..1000"},
           {"[approach, reach, grasp: {min_steps: 0, max_steps: 0}, hold]", "max_steps: 0 not in 1..1000"},
           {"[approach, reach, grasp, lift: {room: 0.51}, hold]", "room: 0.51 not in 0..0.5"},
           {"[approach, reach, grasp, turn: {lean: 1.1}, hold]", "lean: 1.1 not in 0..1"},
           {"[approach, reach, grasp, place: {gap: -0.01}, hold]", "gap: -0.01 not in 0..0.1"},
           {"[approach, reach, grasp, release: {steps: 0}, hold]", "steps: 0 not in 1..1000"},
           {"[retreat: {distance: -0.1}, hold]", "stages[0].retreat: distance: -0.1 not in 0..0.5"},
           {"[retreat: {along: down}, hold]", "along: 'down' is not known"},
           {"[approach: {to: push}, push: {distance: 0.31}, hold]", "distance: 0.31 not in 0..0.3"},
           {"[approach: {to: push}, push: {distance: 0.05, least: 0.06}, hold]", "least: 0.06 not in 0..0.05"}})
    EXPECT_THAT(With("stages", stages), MessageHas(says)) << stages;
  for (const char* stages :
       {"[hold: {steps: 1}]", "[hold: {steps: 1000}]", "[approach, reach, grasp: {min_steps: 0, max_steps: 1}, hold]",
        "[approach, reach, grasp, lift: {room: 0.5}, hold]", "[approach, reach, grasp, turn: {lean: 1}, hold]",
        "[approach: {to: push}, push: {distance: 0.3, least: 0.3}, hold]", "[retreat: {distance: 0}, hold]"})
    EXPECT_THAT(With("stages", stages), IsOk()) << stages;
}

TEST(TaskSpec, WhereAThingIsCarriedHasANameOfItsOwn) {
  for (const auto& place : WheretoNames()) {
    const auto task = Carrying("carry: {to: " + place + "}, place: {to: " + place + "}");
    if (place == "here") {
      EXPECT_THAT(task, MessageHas("stages[3].carry: to: say where, seen from the reference"));
      continue;
    }
    ASSERT_THAT(task, IsOk()) << place;
    EXPECT_EQ(std::get<CarrySpec>(task->stages[3]).whereto(), std::get<PlaceSpec>(task->stages[4]).whereto());
    EXPECT_TRUE(task->carries());
    EXPECT_THAT(Carrying("carry: {to: " + place + "}, place"), MessageHas("has to come just before")) << place;
    EXPECT_THAT(Carrying("carry: {to: " + place + "}, lift, place: {to: " + place + "}"),
                MessageHas("has to come just before"));
  }
  EXPECT_THAT(Carrying("carry: {to: ontop}"), MessageHas("did you mean 'on_top'?"));
  EXPECT_THAT(Carrying("carry: {to: left, room: 0.6}"), MessageHas("room: 0.6 not in 0..0.5"));
}

// both hold the target as it was grasped: such a task was accepted, and its demonstrations turned the target back
TEST(TaskSpec, WhatIsTurnedIsNeitherLiftedNorCarried) {
  EXPECT_THAT(Carrying("turn, carry: {to: left}, place: {to: left}"),
              MessageHas("stages[4].carry: cannot come after turn: the hand would turn the target back"));
  EXPECT_THAT(Carrying("turn, hold, lift"), MessageHas("stages[5].lift: cannot come after turn"));
  EXPECT_THAT(Carrying("lift, carry: {to: left}, turn, place"), IsOk());
  EXPECT_THAT(Carrying("turn, place, release, approach, reach, grasp, lift"), IsOk()) << "it was let go";
}

// One letter a stage, and the stage.
const std::vector<std::pair<char, StageSpec>>& Alphabet() {
  static const std::vector<std::pair<char, StageSpec>> letters{{'a', ApproachSpec{}}, {'A', ApproachSpec{.to = "push"}},
                                                               {'r', ReachSpec{}},    {'g', GraspSpec{}},
                                                               {'l', LiftSpec{}},     {'t', TurnSpec{}},
                                                               {'p', PlaceSpec{}},    {'u', PushSpec{}},
                                                               {'e', ReleaseSpec{}},  {'b', RetreatSpec{}},
                                                               {'h', HoldSpec{}}};
  return letters;
}

// Which stages may follow which, said once more as a regular expression: round after round of a grasp or a push.
TEST(TaskSpec, StagesFollowFromOneAnotherInEverySequence) {
  const std::regex possible("(h|b|ah*rh*g[lph]*[tph]*e|Ah*u)*(|ah*|ah*rh*|ah*rh*g[lph]*[tph]*|Ah*)");
  TaskSpec task{.name = "any", .words = {.verbs = {"do"}}};
  int good = 0;
  const std::function<void(const std::string&)> look = [&](const std::string& word) {
    const bool expected = word.ends_with('h') && std::regex_match(word, possible);
    ASSERT_EQ(ProblemsOf(task).empty(), expected) << word << " " << testing::PrintToString(ProblemsOf(task));
    good += expected;
    if (word.size() == 5) return;
    for (const auto& [letter, stage] : Alphabet()) {
      task.stages.push_back(stage);
      look(word + letter);
      task.stages.pop_back();
    }
  };
  look("");
  EXPECT_GT(good, 100);
}

TEST(TaskSpec, ALongTaskGoesRoundAgain) {
  EXPECT_THAT(With("stages",
                   "[approach: {to: push}, push, approach, reach, grasp, lift, place, release, retreat, "
                   "approach, reach, grasp, lift, hold]"),
              IsOk());
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

TEST(LoadTaskSpec, NamesTheFileInEveryMessage) {
  TemporaryFolder folder;
  const Path file = folder.path() / "mine.yaml";
  EXPECT_THAT(LoadTaskSpec(file), HasCode(Code::kNotFound));
  for (const auto& [text, says] : std::initializer_list<std::pair<std::string, const char*>>{
           {"", "words.verbs: at least one"},
           {"name: [", "mine.yaml:1:"},
           {"[1, 2]", "mine.yaml: the file: expected a map"},
           {"name: pick_well\nname: again\n", "key 'name' stands twice"},
           {std::string(1 << 17, '#'), "more than the limit"}}) {
    ASSERT_THAT(WriteFileAtomically(file, text), IsOk());
    EXPECT_THAT(LoadTaskSpec(file), MessageHas("mine.yaml")) << text.substr(0, 40);
    EXPECT_THAT(LoadTaskSpec(file), MessageHas(says)) << text.substr(0, 40);
  }
}

TEST(TaskName, NoTwoBuiltInTasksMeanTheSame) {
  std::set<std::string> hashes, names;
  for (const auto& name : BaseTasks()) hashes.insert(ParseTask(name)->spec->sha256), names.insert(name);
  EXPECT_EQ(hashes.size(), names.size());
  for (const auto& name : KnownTasks()) {
    const auto task = ParseTask(name);
    ASSERT_THAT(task, IsOk());
    EXPECT_TRUE(names.contains(task->base)) << name;
    EXPECT_EQ(task->avoid.empty(), name == task->base) << name;
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

TEST(TaskName, AFileIsReadAgainWhenWhatWasReadIsForgotten) {
  TemporaryFolder folder;
  const std::string path = (folder.path() / "own.yaml").string();
  std::string text = kGood;
  ASSERT_THAT(WriteFileAtomically(path, text), IsOk());
  const std::string before = ParseTask(path)->spec->sha256;
  text.replace(text.find("3 cm"), 4, "5 cm");
  ASSERT_THAT(WriteFileAtomically(path, text), IsOk());
  EXPECT_EQ(ParseTask(path)->spec->sha256, before) << "a campaign's tasks keep their meaning";
  ForgetTaskFiles();
  EXPECT_NE(ParseTask(path)->spec->sha256, before);
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

TEST(TaskRoles, AClassMayBeNamedForAllItsInstances) {
  TaskSpec task;
  task.reference = {.needed = true, .only = {"mug", "cube"}};
  EXPECT_TRUE(task.MayRefer("cube", "mug_03"));
  EXPECT_TRUE(task.MayRefer("pear_00", "things/mug"));
  EXPECT_FALSE(task.MayRefer("mug_00", "mug_03")) << "a sentence cannot tell them apart";
  EXPECT_FALSE(task.MayRefer("cube", "coke"));
  EXPECT_FALSE(task.MayRefer("cube", "cube"));
  task.reference.needed = false;
  EXPECT_FALSE(task.MayRefer("cube", "mug_03"));
}

// its scenes and data sets call it by its folder alone, and the campaign's way to it may be another
TEST(TaskRoles, APathMeansTheObjectOfItsFolder) {
  TaskSpec task;
  task.reference = {.needed = true, .only = {"things/box", "things/mug_00"}};
  for (const char* name : {"box", "things/box", "./things/box/object.yaml", "mug_00", "other/mug_00"})
    EXPECT_TRUE(task.MayRefer("cube", name)) << name;
  for (const char* name : {"things/crate", "mug_01", "things/mug_01"})
    EXPECT_FALSE(task.MayRefer("cube", name)) << name;
}

TEST(TaskRoles, WhatIsMissingIsPutInThePlaceOfTheLast) {
  TaskSpec task;
  task.reference = {.needed = true, .only = {"mug"}};
  const std::vector<std::string> all{"cube", "coke", "milk", "mug_01"};
  EXPECT_THAT(WithReference(task, {"cube"}, all), testing::ElementsAre("cube", "mug_01")) << "one alone stays";
  EXPECT_THAT(WithReference(task, {"cube", "coke", "milk"}, all), testing::ElementsAre("cube", "coke", "mug_01"));
  EXPECT_THAT(WithReference(task, {"cube", "mug_01"}, all), testing::ElementsAre("cube", "mug_01"));
  EXPECT_THAT(WithReference(task, {"cube", "coke"}, {"cube", "coke"}), testing::ElementsAre("cube", "coke"));
}

TEST(TaskName, ACampaignsHashDependsOnWhatItsTaskFilesSay) {
  TemporaryFolder folder;
  CampaignSpec spec;
  spec.tasks = {(folder.path() / "later.yaml").string()};
  const std::string without = SpecHash(spec);
  ASSERT_THAT(WriteFileAtomically(spec.tasks[0], std::string_view(kGood)), IsOk());
  EXPECT_NE(SpecHash(spec), without);
}

}  // namespace task_spec_test
}  // namespace etude
