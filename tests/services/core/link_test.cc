// SPDX-License-Identifier: Apache-2.0
// Tests services/core/link.cc
#include "services/core/link.h"

#include <gtest/gtest.h>

#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude {
namespace link_test {

TEST(PointLink, TakesThePlaceOfWhatWasThere) {
  const TemporaryFolder folder;
  const Path link = folder / "best";
  ASSERT_THAT(PointLink(link, "1"), IsOk());
  ASSERT_THAT(PointLink(link, "2"), IsOk());
  EXPECT_EQ(std::filesystem::read_symlink(link), "2");
  EXPECT_FALSE(std::filesystem::exists(std::filesystem::symlink_status(folder / "best.new")));
}

TEST(PointLink, SaysWhichOneCannotBeMade) {
  const TemporaryFolder folder;
  EXPECT_THAT(PointLink(folder / "none" / "best", "1"), MessageHas("none/best"));
}

}  // namespace link_test
}  // namespace etude
