// SPDX-License-Identifier: Apache-2.0
// Tests tests/support/temporary_folder.cc: what was left by who died goes, what is in use stays.
#include "tests/support/temporary_folder.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

namespace etude {
namespace temporary_folder_test {

TEST(TemporaryFolders, OfTheDeadAreRemovedAndThoseInUseStay) {
  // in a folder of this test's own: other programs' tests clean the system's at the same time
  const TemporaryFolder temporary;
  ASSERT_EQ(::setenv("TMPDIR", temporary.path().c_str(), 1), 0);
  const TemporaryFolder own;
  const pid_t child = ::fork();
  if (child == 0) ::_exit(0);
  ASSERT_EQ(::waitpid(child, nullptr, 0), child);
  const Path left = std::filesystem::temp_directory_path() / fmt::format("etude-test-{}-left", child);
  ASSERT_TRUE(MakeFolders(left / "data"));

  RemoveFoldersOfTheDead();

  EXPECT_FALSE(std::filesystem::exists(left));
  EXPECT_TRUE(std::filesystem::exists(own.path()));
  ASSERT_EQ(::unsetenv("TMPDIR"), 0);
}

TEST(TemporaryFolders, AreRemovedWithAllTheirContent) {
  Path path;
  {
    const TemporaryFolder folder;
    path = folder.path();
    ASSERT_TRUE(MakeFolders(folder / "a" / "b"));
  }
  EXPECT_FALSE(std::filesystem::exists(path));
}

}  // namespace temporary_folder_test
}  // namespace etude
