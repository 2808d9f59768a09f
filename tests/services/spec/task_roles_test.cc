// SPDX-License-Identifier: Apache-2.0
// Tests services/spec/task_roles.cc
#include "services/spec/task_roles.h"

#include <gmock/gmock.h>

#include <memory>

namespace etude {
namespace task_roles_test {

using testing::ElementsAre;
using testing::IsEmpty;

// A task with a reference that is one of `only`.
TaskSpec Onto(std::vector<std::string> only) {
  TaskSpec task;
  task.reference = {.needed = true, .only = std::move(only)};
  return task;
}

TEST(PossibleReferences, AreOfAnotherClassAndAmongThoseThatMayBe) {
  const std::vector<std::string> objects{"cube", "milk", "apple_00"};
  EXPECT_THAT(PossibleReferences(Onto({}), "milk", objects), ElementsAre("cube", "apple_00"));
  EXPECT_THAT(PossibleReferences(Onto({"apple"}), "milk", objects), ElementsAre("apple_00"));
  EXPECT_THAT(PossibleReferences(Onto({}), "apple_03", objects), ElementsAre("cube", "milk"));
  EXPECT_THAT(PossibleReferences(TaskSpec{}, "milk", objects), IsEmpty());
}

TEST(PossibleTargets, HaveAReference) {
  EXPECT_THAT(PossibleTargets(Onto({"cube"}), {"cube", "milk", "bread"}), ElementsAre("milk", "bread"));
  EXPECT_THAT(PossibleTargets(Onto({"cube"}), {"milk", "bread"}), IsEmpty());
  EXPECT_THAT(PossibleTargets(TaskSpec{}, {"milk"}), ElementsAre("milk"));
}

TEST(WithReference, TakesTheLastOnesPlace) {
  const std::vector<std::string> objects{"cube", "milk", "bread", "coke"};
  EXPECT_THAT(WithReference(Onto({"cube"}), {"milk", "bread", "coke"}, objects), ElementsAre("milk", "bread", "cube"));
  EXPECT_THAT(WithReference(Onto({"cube"}), {"milk", "cube"}, objects), ElementsAre("milk", "cube"));
}

// An instance of a class that is drawn already: what was drawn first cannot be put onto its like.
TEST(WithReference, TakesThePlaceOfAnotherInstanceOfItsClass) {
  const std::vector<std::string> objects{"apple_00", "apple_05", "mug_00", "pear_00"};
  const TaskSpec task = Onto({"apple_05"});
  EXPECT_THAT(WithReference(task, {"apple_00", "mug_00"}, objects), ElementsAre("apple_05", "mug_00"));
  EXPECT_THAT(WithReference(task, {"mug_00", "apple_00", "pear_00"}, objects),
              ElementsAre("mug_00", "apple_05", "pear_00"));
}

TEST(AvoidedObjects, AreAllOthersButWhatTheTargetEndsOn) {
  const auto avoided = [](const char* to) {
    auto spec = std::make_shared<TaskSpec>(Onto({"cube"}));
    PlaceSpec place;
    place.to = to;
    spec->stages.emplace_back(place);
    return AvoidedObjects({.base = "stack", .avoid = "others", .spec = spec}, "milk", "cube",
                          {"cube", "milk", "bread"});
  };
  EXPECT_THAT(avoided("on_top"), ElementsAre("bread"));
  EXPECT_THAT(avoided("inside"), ElementsAre("bread"));
  EXPECT_THAT(avoided("left"), ElementsAre("cube", "bread"));
}

}  // namespace task_roles_test
}  // namespace etude
