// SPDX-License-Identifier: Apache-2.0
// Tests services/core/link.cc
#include "services/core/link.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>
#include <vector>

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
  for (const auto& item : std::filesystem::directory_iterator(folder.path())) EXPECT_EQ(item.path(), link);
}

TEST(PointLink, AsksNothingOfOthersWhoPointTheSame) {
  const TemporaryFolder folder;
  std::vector<std::thread> threads;
  std::atomic<int> failed = 0;
  for (int i = 0; i < 4; ++i)
    threads.emplace_back([&] {
      for (int round = 0; round < 50; ++round) failed += PointLink(folder / "best", "1") ? 0 : 1;
    });
  for (auto& thread : threads) thread.join();
  EXPECT_EQ(failed, 0);
}

TEST(PointLink, SaysWhichOneCannotBeMade) {
  const TemporaryFolder folder;
  EXPECT_THAT(PointLink(folder / "none" / "best", "1"), MessageHas("none/best"));
}

}  // namespace link_test
}  // namespace etude
