// SPDX-License-Identifier: Apache-2.0
// Tests services/episode/bounded_json.cc
#include "services/episode/bounded_json.h"

#include <gtest/gtest.h>

namespace etude {
namespace bounded_json_test {

TEST(BoundedJson, ReadsWhatIsJsonAndKeepsTheOrderOfKeys) {
  const auto json = ParseBoundedJson(R"({"b": [1, 2.5, "x"], "a": {"c": null}})", 3);

  ASSERT_TRUE(json);
  EXPECT_EQ(json->dump(), R"({"b":[1,2.5,"x"],"a":{"c":null}})");
}

TEST(BoundedJson, RefusesWhatIsNot) {
  for (const char* text : {"", "{", "{]", "nul", "{\"a\":1}x", "\"\xff\"", "1e999", "{\"a\":1,}", "NaN"})
    EXPECT_FALSE(ParseBoundedJson(text, 5)) << text;
}

TEST(BoundedJson, RefusesDuplicateKeysOfOneObjectOnly) {
  EXPECT_FALSE(ParseBoundedJson(R"({"a":1,"a":2})", 5));
  EXPECT_FALSE(ParseBoundedJson(R"({"x":{"a":1,"b":2,"a":3}})", 5));
  EXPECT_TRUE(ParseBoundedJson(R"({"a":{"a":{"a":1}},"b":{"a":1}})", 5));
}

TEST(BoundedJson, RefusesDeepNestingWithoutUsingTheStack) {
  EXPECT_TRUE(ParseBoundedJson("[[[1]]]", 3));
  EXPECT_FALSE(ParseBoundedJson("[[[[1]]]]", 3));
  // what is written is taken back
  for (const char* text : {"1", "[]", "[[]]", "[[1]]", R"({"a": [1, {"b": 2}]})", R"({"a": {"b": {"c": []}}})"}) {
    const OrderedJson json = OrderedJson::parse(text);
    for (int depth = 0; depth < 6; ++depth)
      EXPECT_EQ(IsBounded(json, depth), ParseBoundedJson(text, depth).has_value()) << text << depth;
  }
  EXPECT_FALSE(ParseBoundedJson(std::string(4'000'000, '['), 40));
  EXPECT_FALSE(ParseBoundedJson(std::string(1'000'000, '[') + std::string(1'000'000, ']'), 40));
}

}  // namespace bounded_json_test
}  // namespace etude
