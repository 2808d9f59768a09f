// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/predicates/kind.cc
#include "worker/task/predicates/kind.h"

#include "services/core/file.h"
#include "tests/worker/task/predicates/scene.h"

namespace etude::task {
namespace kind_test {

TEST_F(PredicateTest, KindRefusesWhatItDoesNotKnowAndSaysWhatItDoes) {
  for (const auto& [yaml, says] : std::initializer_list<std::pair<const char*, const char*>>{
           {"rise", "'rise' is not known, did you mean 'risen'?"},
           {"{risen: {bye: 3 cm}}", "predicate 'risen': 'bye' is not known, did you mean 'by'?"},
           {"{risen: {by: 3 deg}}", "by: a quantity in m"},
           {"{risen: {by: target}}", "by: a quantity in m"},
           {"{risen: {by: -1}}", "not in 0..2 m"},
           {"{risen: {from: sky}}", "from: 'sky' is not known"},
           {"{risen: {object: teapot}}", "the scene has no 'teapot'; it has bread, coke, milk"},
           {"{risen: {object: others}}", "the scene has no 'others'"},
           {"{risen: [grasped]}", "takes parameters, not a list"},
           {"all", "needs a list of predicates"},
           {"{all: {by: 3}}", "it has no parameters"},
           {"{all: [grasped, rise]}", "'rise' is not known"}}) {
    const auto made = Try(yaml);
    ASSERT_FALSE(made.has_value()) << yaml;
    EXPECT_THAT(made.error().message, testing::HasSubstr(says)) << yaml;
  }
}

TEST_F(PredicateTest, KindARoleThatNothingPlaysIsAnError) {
  const auto made = MakePredicate({.kind = "beside"}, {.target = "coke", .reference = "", .objects = {"coke"}});
  ASSERT_FALSE(made.has_value());
  EXPECT_THAT(made.error().message, testing::HasSubstr("the scene has no 'reference'"));
}

TEST_F(PredicateTest, KindEveryKindSaysWhatItAndItsParametersMean) {
  std::vector<std::string> names;
  for (const auto& kind : PredicateKinds()) {
    names.push_back(kind.name);
    EXPECT_FALSE(kind.says.empty()) << kind.name;
    for (const auto& parameter : kind.parameters) {
      EXPECT_FALSE(parameter.says.empty()) << kind.name << "." << parameter.name;
      if (parameter.type != PredicateParameter::Type::kNumber) continue;
      EXPECT_THAT(parameter.unit, testing::AnyOf("m", "rad", "m/s", "s")) << kind.name;
      EXPECT_LE(parameter.low, parameter.value) << kind.name << "." << parameter.name;
      EXPECT_GE(parameter.high, parameter.value) << kind.name << "." << parameter.name;
    }
    PredicateSpec spec{.kind = kind.name};
    if (kind.combines) spec.children = {{.kind = "grasped"}};
    const auto made = MakePredicate(spec, TheCast());
    ASSERT_TRUE(made.has_value()) << made.error().message;
    (*made)->Observe(now);
    EXPECT_FALSE((*made)->Words().empty()) << kind.name;
  }
  EXPECT_THAT(names, testing::IsSupersetOf({"risen", "moved", "grasped", "released", "lying", "upright", "turned",
                                            "at_rest", "beside", "on", "inside", "untouched", "all", "any", "then"}));
}

// What a user reads of the kinds, and of their parameters and defaults.
TEST_F(PredicateTest, KindEachIsInThePageOnTasks) {
  const std::string page = ReadTextFile("deploy/tasks/README.md").value();
  for (const auto& kind : PredicateKinds()) {
    const std::size_t at = page.find("`" + kind.name + "`", page.find("| predicate |"));
    ASSERT_NE(at, std::string::npos) << kind.name;
    const std::string row = page.substr(at, page.find('\n', at) - at);
    for (const auto& parameter : kind.parameters)
      EXPECT_THAT(row, testing::HasSubstr("`" + parameter.name)) << kind.name;
  }
}

}  // namespace kind_test
}  // namespace etude::task
