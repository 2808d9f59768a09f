// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/predicates/task_predicates.cc
#include "worker/task/predicates/task_predicates.h"

#include <gmock/gmock.h>

#include "tests/support/matchers.h"
#include "tests/worker/task/predicates/task_with.h"

namespace etude::task {
namespace task_predicates_test {

TEST(CheckPredicates, NamesTheTaskAndTheKeyOfWhatIsWrong) {
  EXPECT_THAT(CheckPredicates(TaskWith("risen")), IsOk());
  EXPECT_THAT(CheckPredicates(TaskWith("rise")), MessageHas("task 'mine': success: predicate 'rise' is not known"));
  TaskSpec task = TaskWith("risen");
  task.latched = Spec("{moved: {bye: 3 cm}}");
  EXPECT_THAT(CheckPredicates(task), MessageHas("task 'mine': latched: predicate 'moved': 'bye' is not known"));
  task.latched.reset();
  task.start.not_already = Spec("{all: [grasped, flown]}");
  EXPECT_THAT(CheckPredicates(task), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(CheckPredicates(task), MessageHas("start.not_already"));
}

TEST(CheckPredicates, OnlyATaskWithAReferenceMaySpeakOfOne) {
  TaskSpec task = TaskWith("beside");
  EXPECT_THAT(CheckPredicates(task), MessageHas("the scene has no 'reference'"));
  task.reference.needed = true;
  EXPECT_THAT(CheckPredicates(task), IsOk());
}

TEST(CheckPredicates, AnObjectMayBeNamed) {
  const TaskSpec task = TaskWith("{all: [{risen: {object: milk}}, {untouched: {objects: bottle}}]}");
  EXPECT_THAT(CheckPredicates(task), IsOk());
  EXPECT_THAT(CheckPredicates(TaskWith("{risen: {object: mlik}}")), MessageHas("the scene has no 'mlik'"));
  const TaskSpec own = TaskWith("{risen: {object: duck}}");
  EXPECT_THAT(CheckPredicates(own), MessageHas("the scene has no 'duck'"));
  EXPECT_THAT(CheckPredicates(own, {"cube", "duck"}), IsOk()) << "one of the campaign's own";
}

// before, a campaign with an object called table was refused for tasks that rise "from: table"
TEST(NamedObjects, AWordOfThePredicateIsNoObject) {
  const std::vector<std::string> objects{"cube", "table", "target"};
  EXPECT_THAT(NamedObjects(TaskWith("{risen: {from: table}}"), objects), testing::IsEmpty());
  EXPECT_THAT(NamedObjects(TaskWith("{risen: {object: target}}"), objects), testing::IsEmpty()) << "the role";
  EXPECT_THAT(NamedObjects(TaskWith("{risen: {object: table}}"), objects), testing::ElementsAre("table"));
}

TEST(NamedObjects, AreThoseOfAllTreesOrOfOne) {
  TaskSpec task = TaskWith("{all: [{risen: {object: milk}}, upright]}");
  task.latched = Spec("{risen: {object: coke}}");
  task.start.not_already = Spec("{beside: {of: bread}}");
  EXPECT_THAT(NamedObjects(task, {}), testing::UnorderedElementsAre("milk", "coke", "bread"));
  EXPECT_THAT(NamedObjects(*task.start.not_already, {}), testing::ElementsAre("bread"));
}

}  // namespace task_predicates_test
}  // namespace etude::task
