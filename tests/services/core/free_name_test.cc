// SPDX-License-Identifier: Apache-2.0
// Tests services/core/free_name.h
#include "services/core/free_name.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <string_view>

#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude {
namespace free_name_test {

TEST(FirstFree, IsTheFirstNameAtWhichNothingIs) {
  const TemporaryFolder folder;
  const auto name = [&](int i) { return folder / ("old." + std::to_string(i)); };
  EXPECT_EQ(FirstFree(name), name(1));
  ASSERT_THAT(WriteFileAtomically(name(1), std::string_view("a file")), IsOk());
  ASSERT_THAT(MakeFolders(name(2)), IsOk());
  ASSERT_THAT(MakeFolders(name(4)), IsOk());
  EXPECT_EQ(FirstFree(name), name(3));
  EXPECT_EQ(FirstFree(name, 0), name(0));
}

}  // namespace free_name_test
}  // namespace etude
