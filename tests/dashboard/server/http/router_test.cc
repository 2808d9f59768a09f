// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/http/router.cc
#include "dashboard/server/http/router.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace etude::http {
namespace router_test {

class RouterTest : public testing::Test {
 protected:
  RouterTest() {
    const Handler nothing = [](const Request&) -> Result<Answer> { return Answer{}; };
    router_.Add("GET", "/runs/{id}", Lane::kFiles, nothing);
    router_.Add("GET", "/runs/{id}/pictures/{camera}/{k}.rgb", Lane::kEpisodes, nothing);
    router_.Add("POST", "/actions", Lane::kFiles, nothing, Access::kAction);
  }
  const Route* Find(const std::string& method, const std::string& path) {
    request_ = Request{};
    request_.method = method;
    request_.path = SplitPath(path).value();
    allowed_.clear();
    return router_.Find(request_, allowed_);
  }
  Router router_;
  Request request_;
  std::vector<std::string> allowed_;
};

TEST_F(RouterTest, FillsInWhatStandsForNames) {
  const auto* route = Find("GET", "/runs/base.1/pictures/front/12.rgb");
  ASSERT_NE(route, nullptr);
  EXPECT_EQ(route->lane, Lane::kEpisodes);
  EXPECT_EQ(request_.Parameter("id"), "base.1");
  EXPECT_EQ(request_.Parameter("camera"), "front");
  EXPECT_EQ(request_.Index("k").value(), 12u);
  EXPECT_NE(Find("HEAD", "/runs/x"), nullptr) << "as GET";
}

TEST_F(RouterTest, KnowsNoOtherAddress) {
  EXPECT_EQ(Find("GET", "/runs"), nullptr);
  EXPECT_EQ(Find("GET", "/runs/a/b"), nullptr);
  EXPECT_EQ(Find("GET", "/runs/a/pictures/front/.rgb"), nullptr);
  EXPECT_EQ(Find("GET", "/runs/a/pictures/front/12.png"), nullptr);
  EXPECT_TRUE(allowed_.empty());
}

TEST_F(RouterTest, SaysWhichMethodsAnAddressHas) {
  EXPECT_EQ(Find("DELETE", "/actions"), nullptr);
  EXPECT_THAT(allowed_, testing::ElementsAre("POST"));
}

}  // namespace router_test
}  // namespace etude::http
