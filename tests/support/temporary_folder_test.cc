// SPDX-License-Identifier: Apache-2.0
// Tests tests/support/temporary_folder.cc: what was left by who died goes, what is in use stays.
#include "tests/support/temporary_folder.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <string>

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
  struct stat space {};
  ASSERT_EQ(::stat("/proc/self/ns/pid", &space), 0);
  const auto make = [&](const std::string& name) {
    const Path path = temporary / name;
    EXPECT_TRUE(MakeFolders(path / "data"));
    return path;
  };
  const std::uint64_t here = space.st_ino;
  const Path left = make(fmt::format("etude-test-ns{}-{}-left", here, child));
  const Path elsewhere = make(fmt::format("etude-test-ns{}-{}-left", here + 1, child));
  const Path of_a_script = make(fmt::format("etude-test-{}-new", child));
  const Path of_an_old_one = make(fmt::format("etude-test-{}-old", child));
  const auto long_ago = std::filesystem::file_time_type::clock::now() - std::chrono::hours(48);
  for (const Path& path : {elsewhere, of_an_old_one}) std::filesystem::last_write_time(path, long_ago);

  RemoveFoldersOfTheDead();

  EXPECT_FALSE(std::filesystem::exists(left));
  EXPECT_FALSE(std::filesystem::exists(of_an_old_one));
  EXPECT_TRUE(std::filesystem::exists(of_a_script)) << "it may be of a process in another container";
  EXPECT_TRUE(std::filesystem::exists(elsewhere)) << "whatever its number means there";
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
