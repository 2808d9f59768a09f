// SPDX-License-Identifier: Apache-2.0
// GoogleTest matchers for Result and Status.
#pragma once

#include <gmock/gmock.h>

#include <string>
#include <vector>

#include "services/core/result.h"

namespace etude {

/// EXPECT_THAT(status, IsOk());
MATCHER(IsOk, "is a value") {
  if (arg) return true;
  *result_listener << ToString(arg.error().code) << ": " << arg.error().message;
  return false;
}

/// EXPECT_THAT(status, HasCode(Code::kCorrupt));
MATCHER_P(HasCode, code, "is an error: " + std::string(ToString(code))) {
  if (arg) {
    *result_listener << "a value";
    return false;
  }
  *result_listener << ToString(arg.error().code) << ": " << arg.error().message;
  return arg.error().code == code;
}

/// EXPECT_THAT(status, MessageHas("disk"));
MATCHER_P(MessageHas, text, "is an error that says '" + std::string(text) + "'") {
  if (arg) return false;
  *result_listener << arg.error().message;
  return arg.error().message.find(text) != std::string::npos;
}

/// EXPECT_THAT(text, HasAll({"one", "another"}));
inline auto HasAll(std::vector<std::string> parts) {
  std::vector<testing::Matcher<const std::string&>> matchers;
  for (const auto& part : parts) matchers.push_back(testing::HasSubstr(part));
  return testing::AllOfArray(matchers);
}

}  // namespace etude
