// SPDX-License-Identifier: Apache-2.0
// Tests services/core/disk_wait.cc
#include "services/core/disk_wait.h"

#include <gtest/gtest.h>

#include "services/core/log.h"

namespace etude {
namespace disk_wait_test {

using namespace std::chrono_literals;

TEST(WriteWhenThereIsRoom, GoesOnByItselfWhenTheDiskTakesItAndSaysEachReasonOnce) {
  std::vector<std::string> heard;
  const LogListener listener([&](const LogRecord& record) { heard.push_back(record.text); });
  int tries = 0;

  const Status written = WriteWhenThereIsRoom(
      "the state",
      [&]() -> Status {
        ++tries;
        return tries < 5 ? Fail(Code::kUnavailable, "write 'x': No space left on device") : Status();
      },
      1ms);

  EXPECT_TRUE(written);
  EXPECT_EQ(tries, 5);
  ASSERT_EQ(heard.size(), 1u);
  EXPECT_NE(heard[0].find("No space left"), std::string::npos) << heard[0];
  EXPECT_NE(heard[0].find("the state"), std::string::npos) << heard[0];
}

TEST(WriteWhenThereIsRoom, DoesNotWaitForWhatNoRoomMends) {
  int tries = 0;
  const Status written = WriteWhenThereIsRoom(
      "the state",
      [&]() -> Status {
        ++tries;
        return Fail(Code::kCorrupt, "not finite");
      },
      1ms);
  ASSERT_FALSE(written);
  EXPECT_EQ(written.error().code, Code::kCorrupt);
  EXPECT_EQ(tries, 1);
}

TEST(WriteWhenThereIsRoom, TellsBeforeEachPause) {
  int tries = 0, told = 0;
  const auto write = [&]() -> Status { return ++tries < 4 ? Fail(Code::kUnavailable, "full") : Status(); };
  EXPECT_TRUE(WriteWhenThereIsRoom("the state", write, 1ms, [&] { ++told; }));
  EXPECT_EQ(told, 3);
}

}  // namespace disk_wait_test
}  // namespace etude
