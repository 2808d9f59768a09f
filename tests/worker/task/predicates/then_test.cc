// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/predicates/then.cc
#include "tests/worker/task/predicates/scene.h"

namespace etude::task {
namespace then_test {

class Then : public PredicateTest {
 protected:
  void Rise() { coke().X_WO = At(0, 0.3, 0.15); }
  void Lie() { coke().X_WO = At(0, 0.3, 0.025, {kQuarter, 0, 0}); }
};

TEST_F(Then, NeedsTheOrder) {
  const auto then = Make("{then: [{risen: {by: 10 cm}}, lying]}");
  Lie();
  EXPECT_FALSE(then->Observe(now)) << "fell over, never lifted";
  Rise();
  EXPECT_FALSE(then->Observe(now));
  Lie();
  EXPECT_TRUE(then->Observe(now));
}

TEST_F(Then, RemembersAllButTheLast) {
  const auto then = Make("{then: [{risen: {by: 10 cm}}, lying, released]}");
  Rise();
  coke().touched = true;
  EXPECT_FALSE(then->Observe(now));
  Lie();
  EXPECT_FALSE(then->Observe(now));
  coke().X_WO = coke().X_WO_start;
  coke().touched = false;
  EXPECT_TRUE(then->Observe(now)) << "it has lain";
  coke().touched = true;
  EXPECT_FALSE(then->Observe(now)) << "the last one is a state";
}

TEST_F(Then, TwoThingsMayHappenAtOneStep) {
  const auto then = Make("{then: [risen, grasped]}");
  Rise();
  coke().grasped = true;
  EXPECT_TRUE(then->Observe(now));
}

}  // namespace then_test
}  // namespace etude::task
