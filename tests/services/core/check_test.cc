// SPDX-License-Identifier: Apache-2.0
// Tests services/core/check.h and command.cc
#include "services/core/check.h"

#include <gtest/gtest.h>

#include <functional>
#include <stdexcept>
#include <string>
#include <tuple>

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

TEST(Command, EveryKindOfErrorHasItsExitCodeAndItsWords) {
  for (const auto& [code, exit_code, words] :
       std::initializer_list<std::tuple<Code, int, const char*>>{{Code::kInvalidArgument, 2, "invalid argument"},
                                                                 {Code::kNotFound, 1, "not found"},
                                                                 {Code::kUnavailable, 3, "unavailable"},
                                                                 {Code::kTimeout, 1, "timeout"},
                                                                 {Code::kExhausted, 1, "exhausted"},
                                                                 {Code::kCorrupt, 1, "corrupt"},
                                                                 {Code::kInternal, 1, "internal error"}}) {
    EXPECT_EQ(ExitCodeFor({code, "x"}), exit_code) << words;
    EXPECT_EQ(ToString(code), words);
  }
}

// What a program says on stderr when its body does this.
std::string Said(const std::function<Status()>& body) {
  testing::internal::CaptureStderr();
  EXPECT_NE(RunMain("etude", body), 0);
  return testing::internal::GetCapturedStderr();
}

TEST(Command, SaysAnErrorOnceUnderItsName) {
  EXPECT_EQ(Said([]() -> Status { return Fail(Code::kCorrupt, "bits"); }), "etude: bits\n");
  EXPECT_EQ(Said([]() -> Status { throw std::runtime_error("library"); }), "etude: unexpected exception: library\n");
  EXPECT_EQ(Said([]() -> Status { throw 5; }),
            "etude: unexpected exception of a library that says nothing about itself\n");
}

}  // namespace
}  // namespace etude
