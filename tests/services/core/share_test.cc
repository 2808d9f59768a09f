// SPDX-License-Identifier: Apache-2.0
// Tests services/core/share.cc
#include "services/core/share.h"

#include <gmock/gmock.h>

#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude {
namespace share_test {

TEST(FindShared, LooksAboveTheProgram) {
  TemporaryFolder folder;
  std::filesystem::create_directories(folder.path() / "a/bin");
  std::filesystem::create_directories(folder.path() / "a/share/etude/tasks");
  std::filesystem::create_directories(folder.path() / "deploy/tasks");
  const auto installed = FindShared("tasks", "", folder.path() / "a/bin/etude");
  ASSERT_THAT(installed, IsOk());
  EXPECT_EQ(*installed, folder.path() / "a/share/etude/tasks") << "the nearest one";
  const auto source = FindShared("tasks", "", folder.path() / "build/bin/etude");
  ASSERT_THAT(source, IsOk());
  EXPECT_EQ(*source, folder.path() / "deploy/tasks");
  EXPECT_THAT(FindShared("no_such_things", "", folder.path() / "a/bin/etude"), HasCode(Code::kNotFound));
}

TEST(FindShared, TheVariableDecidesAlone) {
  TemporaryFolder folder;
  std::filesystem::create_directories(folder.path() / "share/tasks");
  const auto found = FindShared("tasks", (folder.path() / "share").string(), "/no/such/program");
  ASSERT_THAT(found, IsOk());
  EXPECT_EQ(*found, folder.path() / "share/tasks");
  EXPECT_THAT(FindShared("robots", (folder.path() / "share").string(), "/no/such/program"), MessageHas("ETUDE_SHARE"));
}

TEST(FindShared, TestsFindTheTasks) { EXPECT_THAT(FindShared("tasks"), IsOk()); }

}  // namespace share_test
}  // namespace etude
