// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/sibling_text.cc with the program that lies beside this one.
#include "services/cli/sibling_text.h"

#include <gmock/gmock.h>

#include "tests/support/matchers.h"

namespace etude::cli {
namespace sibling_text_test {

using testing::EndsWith;
using testing::HasSubstr;
using testing::Not;

TEST(AskSibling, HasItsExitCodeAndItsWords) {
  const auto answer = AskSibling("fake_worker", {});  // refuses its usage
  ASSERT_THAT(answer, IsOk());
  EXPECT_EQ(answer->exit_code, 2);
  EXPECT_THAT(answer->text, HasSubstr("--campaign"));
  EXPECT_THAT(answer->text, Not(EndsWith("\n")));
}

TEST(AskSibling, WhatIsNotBuiltIsNamedWithTheWayToBuildIt) {
  const auto answer = AskSibling("etude-none", {"--help"});
  EXPECT_THAT(answer, HasCode(Code::kUnavailable));
  EXPECT_THAT(answer, MessageHas("--target etude-none"));
}

TEST(AskSiblingJson, WhatIsNoJsonIsAnErrorWithWhatItSaid) {
  const auto json = AskSiblingJson("fake_worker", {});
  EXPECT_THAT(json, HasCode(Code::kInternal));
  EXPECT_THAT(json, MessageHas("exit code 2, and no JSON"));
  EXPECT_THAT(json, MessageHas("--campaign"));
}

}  // namespace sibling_text_test
}  // namespace etude::cli
