// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/file_names.cc
#include "services/cli/file_names.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "tests/support/matchers.h"

namespace etude::cli {
namespace file_names_test {

TEST(CheckpointFileName, TakesNoPathFromAPublisher) {
  EXPECT_EQ(CheckpointFileName("latest", 12).value(), "latest-00000012.safetensors");
  for (const char* channel : {"../../etc/cron.d/x", "/root/x", "a/b", "..", "", "LATEST", "a\nb"})
    EXPECT_THAT(CheckpointFileName(channel, 1), HasCode(Code::kInvalidArgument)) << channel;
}

TEST(VideoFileName, TakesNoPathFromAnEpisode) {
  EXPECT_EQ(VideoFileName(12, "pick+obstacle", "timeout"), "000012-pick+obstacle-timeout.mp4");
  for (const char* outcome : {"../../../tmp/x", "/root/x", "a/b", "..", "a b\n"}) {
    const std::filesystem::path name = VideoFileName(0, "pick", outcome);
    EXPECT_EQ(name, name.filename()) << outcome;
    EXPECT_TRUE(name.string().ends_with(".mp4"));
  }
  EXPECT_LT(VideoFileName(0, std::string(4000, 'a'), std::string(4000, 'b')).size(), 255u);
}

}  // namespace file_names_test
}  // namespace etude::cli
