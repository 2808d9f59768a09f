// SPDX-License-Identifier: Apache-2.0
#include "services/spec/object_names.h"

#include <gmock/gmock.h>

#include <set>

#include "tests/support/matchers.h"

namespace etude {
namespace object_names_test {

TEST(ObjectNames, GeneratedOnesAreAClassAndTwoDigits) {
  const auto parsed = ParseGenerated("strawberry_07");
  ASSERT_TRUE(parsed.has_value());
  EXPECT_EQ(parsed->class_name, "strawberry");
  EXPECT_EQ(parsed->instance, 7);
  EXPECT_EQ(GeneratedObject("strawberry", 7), "strawberry_07");
  for (const char* other :
       {"strawberry", "strawberry_7", "strawberry_10", "strawberry_0x", "cherry_01", "_01", "", "01"})
    EXPECT_FALSE(ParseGenerated(other).has_value()) << other;
}

TEST(ObjectNames, SplitIsThreeToSeven) {
  EXPECT_EQ(TrainObjects().size(), 30u);
  EXPECT_EQ(TestObjects().size(), 70u);
  std::set<std::string> all;
  for (const auto& names : {TrainObjects(), TestObjects()}) all.insert(names.begin(), names.end());
  EXPECT_EQ(all.size(), 100u);
  for (const std::string& name : TestObjects()) EXPECT_EQ(SplitOfInstance(ParseGenerated(name)->instance), "test");
  for (const std::string& name : TrainObjects()) EXPECT_EQ(SplitOfInstance(ParseGenerated(name)->instance), "train");
}

TEST(ObjectNames, SetsExpandInPlace) {
  const auto some = ExpandObjects({"cube", "generated:train", "mug_09"});
  ASSERT_THAT(some, IsOk());
  EXPECT_EQ(some->size(), 32u);
  EXPECT_EQ(some->front(), "cube");
  EXPECT_EQ((*some)[1], "apple_00");
  EXPECT_EQ((*some)[30], "strawberry_02");
  EXPECT_EQ(some->back(), "mug_09");
  EXPECT_EQ(ExpandObjects({"generated:test"})->size(), 70u);
  EXPECT_EQ(ExpandObjects({"generated:all"})->size(), 100u);
  EXPECT_THAT(ExpandObjects({"generated:valid"}), HasCode(Code::kInvalidArgument));
}

TEST(ObjectNames, OfPathsAreTheirLastFolder) {
  for (const char* path : {"objects/duck", "./duck", "/a/b/duck/", "x/duck/object.yaml"}) {
    EXPECT_TRUE(IsObjectPath(path));
    EXPECT_EQ(SceneName(path), "duck") << path;
    EXPECT_EQ(ObjectNoun(path), "duck") << path;
    for (const char* path : {"mug_00", "objects/mug_03", "objects/mug_12"}) EXPECT_EQ(ObjectNoun(path), "mug") << path;
  }
  EXPECT_EQ(SceneName("apple_03"), "apple_03");
  EXPECT_EQ(ObjectNoun("apple_03"), "apple");
  EXPECT_EQ(ObjectNoun("objects/apple_03"), "apple") << "before, two of one class could stand in one scene";
  EXPECT_EQ(ObjectNoun("cube"), "cube");
}

TEST(ObjectNames, ADistractorIsKnownByItsName) {
  EXPECT_EQ(DistractorName("apple_03"), "distractor_apple_03");
  EXPECT_TRUE(IsDistractor("distractor_apple_03"));
  EXPECT_EQ(WhatDistracts("distractor_apple_03"), "apple_03");
  for (const char* name : {"apple_03", "distractor_", "distractor_cube", "distractor_apple", "my/distractor_apple_03"})
    EXPECT_FALSE(IsDistractor(name)) << name;
  EXPECT_FALSE(ParseGenerated("distractor_apple_03"));
  EXPECT_EQ(BallName(7), "ball_07");
  EXPECT_EQ(ParseBall("ball_07"), 7);
  EXPECT_TRUE(IsDistractor("distractor_ball_23"));
  for (const char* name : {"ball_24", "ball_7", "ball", "apple_07", "basketball"}) {
    EXPECT_FALSE(ParseBall(name)) << name;
    EXPECT_FALSE(IsDistractor(std::string("distractor_") + name) && !ParseGenerated(name)) << name;
  }
}

TEST(ObjectNames, UnknownOnesAreRefusedWithTheNearest) {
  for (const char* name : {"cube", "basketball", "pear_09", "objects/duck"}) EXPECT_THAT(CheckObjectName(name), IsOk());
  EXPECT_THAT(CheckObjectName("lemmon_03"), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(CheckObjectName("lemmon_03"), MessageHas("'lemon_03'"));
  EXPECT_THAT(CheckObjectName("botle"), MessageHas("'bottle'"));
}

}  // namespace object_names_test
}  // namespace etude
