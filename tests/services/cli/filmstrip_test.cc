// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/filmstrip.cc
#include "services/cli/filmstrip.h"

#include <gtest/gtest.h>

#include "services/store/dataset.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude::cli {
namespace filmstrip_test {

// Width and height as the PNG's header says.
std::pair<int, int> SizeOf(const Path& png) {
  const auto bytes = ReadBinaryFile(png).value();
  const auto number = [&](std::size_t at) {
    return bytes[at] << 24 | bytes[at + 1] << 16 | bytes[at + 2] << 8 | bytes[at + 3];
  };
  return {number(16), number(20)};
}

// Of 64 x 48 pixels.
void WriteThreeEpisodes(const Path& dataset) {
  const CampaignSpec spec = SyntheticSpec(64, 48);
  auto writer = store::DatasetWriter::Open(dataset, spec);
  ASSERT_TRUE(writer) << writer.error().message;
  for (std::uint64_t i = 0; i < 3; ++i) ASSERT_TRUE(writer->Commit(MakeSyntheticEpisode(spec, i, 25)));
}

TEST(WriteFilmstrips, HasARowForEachEpisodeAndAColumnForEachFrame) {
  TemporaryFolder folder;
  WriteThreeEpisodes(folder / "data");
  ASSERT_TRUE(WriteFilmstrips(folder / "data", folder / "sheet.png", {.episodes = 2, .frames = 4}));
  EXPECT_EQ(SizeOf(folder / "sheet.png"), std::make_pair(4 * 64 + 3 * 2, 2 * (48 + 24)));
  ASSERT_TRUE(WriteFilmstrips(folder / "data", folder / "sheet.png", {.episodes = 9, .frames = 1}));
  EXPECT_EQ(SizeOf(folder / "sheet.png"), std::make_pair(64, 3 * (48 + 24))) << "all there are";
}

TEST(WriteFilmstrips, TakesRowsByNumberAndWritesJpegToItsName) {
  TemporaryFolder folder;
  WriteThreeEpisodes(folder / "data");
  const auto bytes_of = [&](const std::string& name, const FilmstripOptions& options) {
    EXPECT_TRUE(WriteFilmstrips(folder / "data", folder / name, options));
    return ReadBinaryFile(folder / name).value();
  };
  const auto first_two = bytes_of("a.png", {.episodes = 2, .frames = 2});
  EXPECT_EQ(bytes_of("b.png", {.indices = {0, 1}, .frames = 2}), first_two);
  EXPECT_NE(bytes_of("c.png", {.indices = {1, 0}, .frames = 2}), first_two) << "in the order asked for";
  const auto jpeg = bytes_of("d.jpg", {.indices = {2}, .frames = 2});
  ASSERT_GT(jpeg.size(), 3u);
  EXPECT_EQ((std::vector<std::uint8_t>(jpeg.begin(), jpeg.begin() + 3)), (std::vector<std::uint8_t>{0xff, 0xd8, 0xff}));
  EXPECT_EQ(WriteFilmstrips(folder / "data", folder / "e.png", {.indices = {7}}).error().code, Code::kNotFound);
}

TEST(WriteFilmstrips, MovesWhereItsNameSaysSo) {
  TemporaryFolder folder;
  WriteThreeEpisodes(folder / "data");
  ASSERT_TRUE(WriteFilmstrips(folder / "data", folder / "moving.webp", {.episodes = 2}));
  const std::string webp = ReadTextFile(folder / "moving.webp").value();
  EXPECT_EQ(webp.substr(0, 4) + webp.substr(8, 4), "RIFFWEBP");
  EXPECT_NE(webp.find("ANMF"), std::string::npos) << "it has more than one picture";
  ASSERT_TRUE(WriteFilmstrips(folder / "data", folder / "new" / "moving.mp4", {.episodes = 2}));
  EXPECT_EQ(ReadTextFile(folder / "new" / "moving.mp4").value().substr(4, 4), "ftyp");
}

TEST(WriteFilmstrips, SaysWhatIsMissing) {
  TemporaryFolder folder;
  EXPECT_EQ(WriteFilmstrips(folder / "nothing", folder / "sheet.png").error().code, Code::kNotFound);
  EXPECT_EQ(WriteFilmstrips(folder / "nothing", folder / "sheet.png", {.episodes = 0}).error().code,
            Code::kInvalidArgument);
}

}  // namespace filmstrip_test
}  // namespace etude::cli
