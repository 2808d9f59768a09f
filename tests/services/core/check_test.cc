// SPDX-License-Identifier: Apache-2.0
// Tests services/core/check.h and command.cc
#include "services/core/check.h"

#include <gtest/gtest.h>

#include <stdexcept>

#include "services/core/command.h"

namespace etude {
namespace {

TEST(CheckDeathTest, NamesExpressionAndValues) {
  EXPECT_DEATH(ETUDE_CHECK(1 == 2, "left={} right={}", 1, 2), "1 == 2 left=1 right=2");
}

TEST(Check, PassesSilently) { ETUDE_CHECK(true, "never formatted {}", 1); }

TEST(Command, ExitCodesFollowTheError) {
  EXPECT_EQ(RunMain("t", [] { return Status(); }), 0);
  EXPECT_EQ(RunMain("t", []() -> Status { return Fail(Code::kInvalidArgument, "usage"); }), 2);
  EXPECT_EQ(RunMain("t", []() -> Status { return Fail(Code::kUnavailable, "no GL"); }), 3);
  EXPECT_EQ(RunMain("t", []() -> Status { return Fail(Code::kCorrupt, "bits"); }), 1);
  EXPECT_EQ(RunMain("t", []() -> Status { throw std::runtime_error("library"); }), 1);
}

}  // namespace
}  // namespace etude
