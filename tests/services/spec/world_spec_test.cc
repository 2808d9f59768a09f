// SPDX-License-Identifier: Apache-2.0
// Tests services/spec/world_spec.cc
#include "services/spec/world_spec.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "services/core/config.h"

namespace etude {
namespace world_spec_test {

using ::testing::HasSubstr;

TEST(WorldSpec, ReportsWhatIsOutOfRange) {
  WorldSpec world;
  std::vector<std::string> errors;
  world.Check(errors);
  EXPECT_TRUE(errors.empty());
  world.table = "wod";
  world.light_direction = {0, 0, 1};
  world.friction = 0;
  world.background = {0, 2};
  world.Check(errors);
  EXPECT_EQ(errors.size(), 5u) << testing::PrintToString(errors);
  EXPECT_THAT(testing::PrintToString(errors), HasSubstr("did you mean 'wood'"));
}

// What is wrong with the nominal world after one `--set`.
std::vector<std::string> ProblemsWith(const std::string& override_text) {
  OrderedJson json = ToJson(WorldSpec());
  EXPECT_TRUE(ApplyOverride(json, override_text)) << override_text;
  std::vector<std::string> errors;
  FromJson<WorldSpec>(json, "world").value().Check(errors);
  return errors;
}

TEST(WorldSpec, EachProblemIsNamedWithItsRange) {
  for (const auto& [override_text, says] : std::initializer_list<std::pair<const char*, const char*>>{
           {"light_brightness=0.09", "world.light_brightness: 0.09 not in 0.1..4"},
           {"light_brightness=4.1", "world.light_brightness: 4.1 not in 0.1..4"},
           {"light_colour=[1, -0.1, 1]", "world.light_colour: -0.1 not in 0..4"},
           {"light_colour=[1, 1]", "world.light_colour: three numbers"},
           {"table_colour=[5, 1, 1]", "world.table_colour: 5 not in 0..4"},
           {"object_colour=[1, 1, 1, 1]", "world.object_colour: three numbers"},
           {"background=[0, 0, 1.1]", "world.background: 1.1 not in 0..1"},
           {"friction=0.05", "world.friction: 0.05 not in 0.1..4"},
           {"control_delay=-1", "world.control_delay: -1 not in 0..50"},
           {"control_delay=51", "world.control_delay: 51 not in 0..50"},
           {"light_direction=[1, 0]", "world.light_direction: three numbers, the last < 0"},
           {"light_direction=[0, 0, 0]", "world.light_direction: three numbers, the last < 0"},
           {"table=glass", "world.table: 'glass' is not known"}}) {
    const std::vector<std::string> errors = ProblemsWith(override_text);
    ASSERT_EQ(errors.size(), 1u) << override_text << testing::PrintToString(errors);
    EXPECT_THAT(errors[0], HasSubstr(says));
  }
}

TEST(WorldSpec, TakesEveryRangeUpToItsEnds) {
  for (const char* text : {"light_brightness=0.1", "light_brightness=4", "light_colour=[0, 4, 0]", "friction=0.1",
                           "friction=4", "control_delay=0", "control_delay=50", "background=[1, 1, 1]",
                           "light_direction=[3, 3, -0.001]", "table=cloth", "table=stone", "table=plain"})
    EXPECT_THAT(ProblemsWith(text), testing::IsEmpty()) << text;
}

TEST(WorldSpec, WhatIsNotFiniteIsOutOfEveryRange) {
  WorldSpec world;
  const double nan = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();
  world.light_brightness = world.friction = nan;
  world.table_colour = {1, nan, infinity};
  world.light_direction = {0, nan, -1};
  std::vector<std::string> errors;
  world.Check(errors);
  EXPECT_EQ(errors.size(), 5u) << testing::PrintToString(errors);
}

}  // namespace world_spec_test
}  // namespace etude
