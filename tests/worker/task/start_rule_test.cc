// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/start_rule.cc and the names of worker/task/verdict.cc
#include "worker/task/start_rule.h"

#include <gmock/gmock.h>

#include <set>

#include "tests/support/matchers.h"
#include "tests/worker/task/predicates/task_with.h"
#include "worker/task/outcome_meaning.h"
#include "worker/task/predicates/task_predicates.h"
#include "worker/task/verdict.h"

namespace etude::task {
namespace start_rule_test {

class AlreadySo : public testing::Test {
 protected:
  AlreadySo() {
    SceneSpec spec;
    spec.objects = {"coke", "milk"};
    scene_ = sim::Scene::Build(spec).value();
    kinematics_.emplace(scene_);
    shapes_.emplace(*scene_, *kinematics_);
  }
  std::optional<std::string> Ask(const TaskSpec& task, const Eigen::Vector2d& coke, const Eigen::Vector2d& milk) const {
    const auto at = [&](const char* name, const Eigen::Vector2d& place) {
      return PlacedObject{name,
                          {{place.x(), place.y(), shapes_->object(name).rest_height}, Eigen::Quaterniond::Identity()}};
    };
    return Already(task, {.target = "coke", .reference = "milk", .objects = {"coke", "milk"}},
                   {at("coke", coke), at("milk", milk)}, *shapes_)
        .value();
  }

  std::shared_ptr<const sim::Scene> scene_;
  std::optional<sim::Kinematics> kinematics_;
  std::optional<SceneGeometry> shapes_;
};

TEST_F(AlreadySo, SaysWhatHoldsBeforeAnythingMoves) {
  TaskSpec task = TaskWith("beside");
  EXPECT_FALSE(Ask(task, {0.12, 0.3}, {0, 0.3})) << "a task without a rule may start anywhere";
  task.start.not_already = Spec("{beside: {side: left}}");
  const auto already = Ask(task, {0.12, 0.3}, {0, 0.3});
  ASSERT_TRUE(already);
  EXPECT_THAT(*already, testing::StartsWith("already so: coke left of milk by 0.120 m"));
  EXPECT_FALSE(Ask(task, {-0.12, 0.3}, {0, 0.3})) << "on its right";
  EXPECT_FALSE(Ask(task, {0.35, 0.3}, {0, 0.3})) << "too far";
}

TEST_F(AlreadySo, AnObjectThatWasNotDrawnIsAnError) {
  TaskSpec task = TaskWith("risen");
  task.start.not_already = Spec("{beside: {of: bread}}");
  ASSERT_THAT(CheckPredicates(task), IsOk());
  EXPECT_THAT(Already(task, {.target = "coke", .reference = "", .objects = {"coke"}}, {}, *shapes_),
              HasCode(Code::kInvalidArgument));
}

TEST_F(AlreadySo, SizesAreThoseOfTheObjects) {
  TaskSpec task = TaskWith("beside");
  task.start.not_already = Spec("{inside: {deep: 0 m}}");
  EXPECT_TRUE(Ask(task, {0.001, 0.3}, {0, 0.3})) << "its middle is within the other's walls";
  EXPECT_FALSE(Ask(task, {0.06, 0.3}, {0, 0.3}));
}

TEST(AttemptOutcomes, HaveNamesOfTheirOwn) {
  using enum AttemptOutcome;
  std::set<std::string_view> names;
  for (const auto outcome : {kSuccess, kSceneInvalid, kPlanFailed, kGraspMissed, kDropped, kCriterionFailed, kCollision,
                             kViolation, kTimeout, kUnstable, kPolicyError, kStopped})
    names.insert(ToString(outcome));
  EXPECT_EQ(names.size(), 12u);
  EXPECT_FALSE(names.contains("unknown"));
  // written to attempts.jsonl and read by the campaign
  EXPECT_EQ(ToString(kSceneInvalid), "scene_invalid");
  EXPECT_EQ(ToString(kSuccess), "success");
  EXPECT_EQ(kAttemptOutcomes.size(), names.size());
  for (const auto outcome : kAttemptOutcomes) EXPECT_NE(Meaning(outcome), "unknown") << ToString(outcome);
}

}  // namespace start_rule_test
}  // namespace etude::task
