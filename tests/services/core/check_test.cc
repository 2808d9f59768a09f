// SPDX-License-Identifier: Apache-2.0
// Tests services/core/check.h
#include "services/core/check.h"

#include <gtest/gtest.h>

namespace etude {
namespace check_test {

TEST(CheckDeathTest, NamesExpressionAndValues) {
  EXPECT_DEATH(ETUDE_CHECK(1 == 2, "left={} right={}", 1, 2), "1 == 2 left=1 right=2");
}

TEST(Check, PassesSilently) { ETUDE_CHECK(true, "never formatted {}", 1); }

}  // namespace check_test
}  // namespace etude
