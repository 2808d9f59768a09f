// SPDX-License-Identifier: Apache-2.0
// Tests services/core/result.cc
#include "services/core/result.h"

#include <gtest/gtest.h>

#include <memory>

namespace etude {
namespace result_test {

Result<std::unique_ptr<int>> Make(bool good) {
  if (!good) return Fail(Code::kCorrupt, "bad bytes");
  return std::make_unique<int>(7);
}

Result<int> Use(bool good) {
  ETUDE_ASSIGN_OR_RETURN(const auto value, Make(good));  // moves a move-only value
  return *value;
}

TEST(Result, PropagatesValueAndError) {
  EXPECT_EQ(Use(true).value(), 7);
  EXPECT_EQ(Use(false).error().code, Code::kCorrupt);
  EXPECT_EQ(Use(false).error().Wrap("read x").message, "read x: bad bytes");
  EXPECT_EQ(ToString(Code::kUnavailable), "unavailable");
}

}  // namespace result_test
}  // namespace etude
