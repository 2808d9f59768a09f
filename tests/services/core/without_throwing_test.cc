// SPDX-License-Identifier: Apache-2.0
// Tests services/core/without_throwing.h
#include "services/core/without_throwing.h"

#include <gtest/gtest.h>

#include <stdexcept>

namespace etude {
namespace without_throwing_test {

TEST(WithoutThrowing, TurnsWhatIsThrownIntoAnError) {
  EXPECT_TRUE(WithoutThrowing([] { return Status(); }));
  const Status failed = WithoutThrowing([]() -> Status { return Fail(Code::kNotFound, "no disk"); });
  EXPECT_EQ(failed.error().code, Code::kNotFound);
  const Status thrown = WithoutThrowing([]() -> Status { throw std::runtime_error("out of luck"); });
  ASSERT_FALSE(thrown);
  EXPECT_EQ(thrown.error().code, Code::kInternal);
  EXPECT_NE(thrown.error().message.find("out of luck"), std::string::npos);
  EXPECT_FALSE(WithoutThrowing([]() -> Status { throw 7; }));
}

}  // namespace without_throwing_test
}  // namespace etude
