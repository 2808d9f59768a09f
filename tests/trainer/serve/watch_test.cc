// SPDX-License-Identifier: Apache-2.0
#include "trainer/serve/watch.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "services/core/config.h"

namespace etude::serve {
namespace watch_test {

using ::testing::HasSubstr;

// another robot's observation may be one that this policy does not answer; the others' go on
TEST(Watch, EndsAtWhatIsWrongWithTheWishOrItsOnlySession) {
  bus::Insight odd;
  odd.session = "insight-x";
  odd.error = "this policy was trained for something else (robot: ur5 here, panda there)";
  EXPECT_FALSE(EndsTheWatch(odd, {}));
  EXPECT_TRUE(EndsTheWatch(odd, {.session = "insight-x"}));
  odd.error = "what if: unknown key 'hid'";
  EXPECT_TRUE(EndsTheWatch(odd, {}));
}

TEST(Watch, MakesAWishOfItsOptions) {
  const auto what_if = WhatIfOf(
      {.sentence = "push it", .hide = {"1,2,3,4"}, .say = {"TAR3D.position=[0.1, 0.2, 0.3]", "LANG.class=coke"}});
  ASSERT_TRUE(what_if) << what_if.error().message;
  EXPECT_EQ(OrderedJson::parse(*what_if), OrderedJson::parse(R"({"sentence": "push it", "hide": [[1, 2, 3, 4]],
      "say": {"TAR3D": {"position": [0.1, 0.2, 0.3]}, "LANG": {"class": "coke"}}})"));
  EXPECT_EQ(WhatIfOf({}).value(), "");
  EXPECT_THAT(WhatIfOf({.hide = {"1,2"}}).error().message, HasSubstr("--hide '1,2'"));
  EXPECT_EQ(WhatIfOf({.think = {"LANG=push it"}}).value(), R"({"think":{"LANG":"push it"}})");
  EXPECT_EQ(WhatIfOf({.worth = true}).value(), R"({"worth":true})");
  EXPECT_THAT(WhatIfOf({.think = {"LANG"}}).error().message, HasSubstr("MODULE=SENTENCE"));
  EXPECT_THAT(WhatIfOf({.say = {"TAR3D=1"}}).error().message, HasSubstr("MODULE.QUANTITY=VALUE"));
}

}  // namespace watch_test
}  // namespace etude::serve
