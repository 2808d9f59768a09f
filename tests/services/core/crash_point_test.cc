// SPDX-License-Identifier: Apache-2.0
// Tests services/core/crash_point.cc in child processes: what it is told stands in their environment when they begin.
#include "services/core/crash_point.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <cstdlib>
#include <string>

#include "services/core/file.h"
#include "tests/support/temporary_folder.h"

namespace etude {
namespace crash_point_test {

// Reaches "other" once and "here" three times, and ends well if it comes to that.
[[noreturn]] void Reach(const std::string& at, const Path& log) {
  if (!at.empty()) ::setenv("ETUDE_CRASH_AT", at.c_str(), 1);
  ::setenv("ETUDE_CRASH_LOG", log.c_str(), 1);
  internal::ReachCrashPoint("other", 9);
  for (const std::uint64_t number : {1, 2, 3}) internal::ReachCrashPoint("here", number);
  ::_exit(0);
}

TEST(CrashPointDeathTest, KillsTheFirstTimeOrTheOneThatIsNamed) {
  const TemporaryFolder folder;
  EXPECT_EXIT(Reach("here", folder / "first"), testing::KilledBySignal(SIGKILL), "");
  EXPECT_EQ(ReadTextFile(folder / "first").value(), "other 9\nhere 1\n");
  EXPECT_EXIT(Reach("here:3", folder / "third"), testing::KilledBySignal(SIGKILL), "");
  EXPECT_EQ(ReadTextFile(folder / "third").value(), "other 9\nhere 1\nhere 2\nhere 3\n");
}

TEST(CrashPointDeathTest, LeavesAloneWhatIsNotReached) {
  const TemporaryFolder folder;
  EXPECT_EXIT(Reach("here:4", folder / "later"), testing::ExitedWithCode(0), "");
  EXPECT_EXIT(Reach("her", folder / "prefix"), testing::ExitedWithCode(0), "");
  EXPECT_EXIT(Reach("", folder / "unset"), testing::ExitedWithCode(0), "");
  EXPECT_EQ(ReadTextFile(folder / "unset").value(), "other 9\nhere 1\nhere 2\nhere 3\n");
}

TEST(CrashPoint, CostsNothingWhereNobodyAskedForIt) {
  EXPECT_FALSE(internal::kCrashPointsArmed);
  CrashPoint("here");
}

}  // namespace crash_point_test
}  // namespace etude
