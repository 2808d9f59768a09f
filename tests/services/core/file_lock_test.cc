// SPDX-License-Identifier: Apache-2.0
// Tests services/core/file_lock.cc
#include "services/core/file_lock.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude {
namespace file_lock_test {

TEST(FileLock, OneAtATimeAndTheOtherIsTold) {
  const TemporaryFolder folder;
  {
    auto lock = FileLock::Take(folder / "lock", "folder 'x' is being written");
    ASSERT_THAT(lock, IsOk());
    const auto second = FileLock::Take(folder / "lock", "folder 'x' is being written");
    EXPECT_THAT(second, HasCode(Code::kUnavailable));
    EXPECT_THAT(second, MessageHas("folder 'x' is being written by another process"));
    EXPECT_THAT(second, MessageHas("pid " + std::to_string(::getpid())));
    const FileLock moved = std::move(*lock);
    EXPECT_THAT(FileLock::Take(folder / "lock", "it is written"), HasCode(Code::kUnavailable));
  }
  EXPECT_THAT(FileLock::Take(folder / "lock", "it is written"), IsOk());
}

TEST(FileLock, WithoutItsFolderThereIsNone) {
  const TemporaryFolder folder;
  EXPECT_THAT(FileLock::Take(folder / "missing" / "lock", "it is written"), HasCode(Code::kNotFound));
}

}  // namespace file_lock_test
}  // namespace etude
