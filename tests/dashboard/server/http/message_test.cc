// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/http/message.cc
#include "dashboard/server/http/message.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/matchers.h"

namespace etude::http {
namespace message_test {

using testing::ElementsAre;

TEST(SplitPath, DecodesSegmentsAndRefusesToLeave) {
  EXPECT_THAT(SplitPath("/a//b%20c/").value(), ElementsAre("a", "b c"));
  EXPECT_THAT(SplitPath("/a%2Fb").value(), ElementsAre("a/b")) << "one segment, which no folder's name is";
  for (const char* path : {"/../etc/passwd", "/a/%2e%2e/b", "/a/./b", "/a/%zz", "/a/%2", "/a%00b"})
    EXPECT_FALSE(SplitPath(path)) << path;
}

TEST(Query, KeepsRepeatedKeysInOrder) {
  const Query query("task=pick&task=push%2Bobstacle&words=the+blue%20can&empty=&flag");
  EXPECT_THAT(query.All("task"), ElementsAre("pick", "push+obstacle"));
  EXPECT_EQ(query.Get("words"), "the blue can");
  EXPECT_EQ(query.Get("flag"), "");
  EXPECT_TRUE(query.All("empty").empty());
  EXPECT_FALSE(query.Get("none"));
}

TEST(Query, NumbersHaveBounds) {
  const Query query("limit=50&far=100000&bad=5x&huge=99999999999999999999");
  EXPECT_EQ(query.Integer("limit", 10, 1, 500).value(), 50);
  EXPECT_EQ(query.Integer("none", 10, 1, 500).value(), 10);
  for (const char* key : {"far", "bad", "huge"})
    EXPECT_THAT(query.Integer(key, 1, 1, 500), HasCode(Code::kInvalidArgument)) << key;
}

}  // namespace message_test
}  // namespace etude::http
