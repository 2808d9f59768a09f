// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/http/answers.cc
#include "dashboard/server/http/answers.h"

#include <gtest/gtest.h>

namespace etude::http {
namespace answers_test {

TEST(ForBrowsers, NumbersThatJavaScriptCannotHoldBecomeText) {
  const auto json = ForBrowsers(OrderedJson::parse(
      R"({"seed": 7, "big": 6285334756670210419, "low": -9007199254740993, "n": 9007199254740992, "in": [{"seed": 8}]})"));
  EXPECT_EQ(json["seed"], "7") << "every seed, so that pages need not know which are large";
  EXPECT_EQ(json["big"], "6285334756670210419");
  EXPECT_EQ(json["low"], "-9007199254740993");
  EXPECT_EQ(json["n"], 9007199254740992ull);
  EXPECT_EQ(json["in"][0]["seed"], "8");
}

TEST(JsonAnswer, TakesBytesThatAreNoText) { EXPECT_NO_THROW(JsonAnswer({{"name", "a\xff"}})); }

TEST(ProblemOf, HasTheStatusOfItsKind) {
  EXPECT_EQ(ProblemOf({Code::kNotFound, "x"}).status, 404);
  EXPECT_EQ(ProblemOf({Code::kInvalidArgument, "x"}).status, 400);
  EXPECT_EQ(ProblemOf({Code::kUnavailable, "x"}).status, 503);
  const auto answer = ProblemOf({Code::kCorrupt, "file 3 is cut"});
  EXPECT_EQ(answer.content_type, "application/problem+json");
  EXPECT_EQ(OrderedJson::parse(answer.body)["detail"], "file 3 is cut");
}

}  // namespace answers_test
}  // namespace etude::http
