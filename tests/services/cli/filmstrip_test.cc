// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/filmstrip.cc
#include "services/cli/filmstrip.h"

#include <gtest/gtest.h>

#include "services/store/dataset.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude::cli {
namespace {

// Width and height as the PNG's header says.
std::pair<int, int> SizeOf(const Path& png) {
  const auto bytes = ReadBinaryFile(png).value();
  const auto number = [&](std::size_t at) {
    return bytes[at] << 24 | bytes[at + 1] << 16 | bytes[at + 2] << 8 | bytes[at + 3];
  };
  return {number(16), number(20)};
}

TEST(WriteFilmstrips, HasARowForEachEpisodeAndAColumnForEachFrame) {
  TemporaryFolder folder;
  const CampaignSpec spec = SyntheticSpec(64, 48);
  {
    auto writer = store::DatasetWriter::Open(folder / "data", spec);
    ASSERT_TRUE(writer) << writer.error().message;
    for (std::uint64_t i = 0; i < 3; ++i) ASSERT_TRUE(writer->Commit(MakeSyntheticEpisode(spec, i, 25)));
  }
  ASSERT_TRUE(WriteFilmstrips(folder / "data", folder / "sheet.png", {.episodes = 2, .frames = 4}));
  EXPECT_EQ(SizeOf(folder / "sheet.png"), std::make_pair(4 * 64 + 3 * 2, 2 * (48 + 24)));
  ASSERT_TRUE(WriteFilmstrips(folder / "data", folder / "sheet.png", {.episodes = 9, .frames = 1}));
  EXPECT_EQ(SizeOf(folder / "sheet.png"), std::make_pair(64, 3 * (48 + 24))) << "all there are";
}

TEST(WriteFilmstrips, SaysWhatIsMissing) {
  TemporaryFolder folder;
  EXPECT_EQ(WriteFilmstrips(folder / "nothing", folder / "sheet.png").error().code, Code::kNotFound);
  EXPECT_EQ(WriteFilmstrips(folder / "nothing", folder / "sheet.png", {.episodes = 0}).error().code,
            Code::kInvalidArgument);
}

}  // namespace
}  // namespace etude::cli
