// SPDX-License-Identifier: Apache-2.0
// Tests services/store/dataset_reader.cc
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <fstream>
#include <thread>

#include "services/core/rng.h"
#include "services/episode/frame_cursor.h"
#include "services/store/dataset.h"
#include "tests/support/matchers.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude::store {
namespace dataset_reader_test {

TEST(DatasetReader, NeedsADataset) {
  const TemporaryFolder folder;
  EXPECT_THAT(DatasetReader::Open(folder.path()), HasCode(Code::kNotFound));
  EXPECT_THAT(DatasetReader::Open(folder / "none"), HasCode(Code::kNotFound));
}

TEST(DatasetReader, ListsWhatIsThereWhileItGrows) {
  const TemporaryFolder folder;
  CampaignSpec spec = SyntheticSpec();
  auto writer = DatasetWriter::Open(folder.path(), spec);
  ASSERT_THAT(writer, IsOk());
  const auto reader = DatasetReader::Open(folder.path());
  ASSERT_THAT(reader, IsOk());
  EXPECT_THAT(*reader->List(), testing::IsEmpty());

  for (const std::uint64_t index : {5, 1'000'001, 2000, 999'999})
    ASSERT_THAT(writer->Commit(MakeSyntheticEpisode(spec, index, 5)), IsOk());
  std::ofstream(EpisodePath(folder.path(), 6).string() + ".tmp") << "half";
  std::ofstream(folder / "episodes/notes.txt") << "x";

  EXPECT_THAT(*reader->List(), testing::ElementsAre(5, 2000, 999'999, 1'000'001));
  EXPECT_THAT(reader->Read(6), HasCode(Code::kNotFound));
  EXPECT_THAT(reader->Read(2000), IsOk());
}

TEST(DatasetReader, RecordsLeadToFramesWithoutHdf5) {
  const TemporaryFolder folder;
  const CampaignSpec spec = SyntheticSpec();
  const Episode episode = MakeSyntheticEpisode(spec, 0);
  ASSERT_THAT(DatasetWriter::Open(folder.path(), spec)->Commit(episode), IsOk());

  const auto record = DatasetReader::Open(folder.path())->Read(0);

  ASSERT_THAT(record, IsOk());
  EXPECT_TRUE(record->episode.cameras[0].streams.empty());
  ASSERT_EQ(record->frames[0].size(), 10u);
  FrameCursor expected(episode);
  FrameReader frames(record->path, record->frames[0]);
  for (std::size_t k = 0; k < 10; ++k) {
    const auto pixels = frames.Read(k);
    ASSERT_THAT(pixels, IsOk());
    EXPECT_TRUE(std::ranges::equal(*pixels, *expected.Frame(k))) << k;
  }
}

TEST(DatasetReader, AFileUnderAnotherNumberIsCorrupt) {
  const TemporaryFolder folder;
  const CampaignSpec spec = SyntheticSpec();
  ASSERT_THAT(DatasetWriter::Open(folder.path(), spec)->Commit(MakeSyntheticEpisode(spec, 0)), IsOk());
  std::filesystem::copy(EpisodePath(folder.path(), 0), EpisodePath(folder.path(), 1));

  const auto read = DatasetReader::Open(folder.path())->Read(1);

  EXPECT_THAT(read, HasCode(Code::kCorrupt));
  EXPECT_THAT(read, MessageHas("000001.hdf5"));
}

TEST(DatasetReader, ReadsWhileEpisodesAreCommitted) {
  const TemporaryFolder folder;
  const CampaignSpec spec = SyntheticSpec(16, 16);
  auto writer = DatasetWriter::Open(folder.path(), spec);
  ASSERT_THAT(writer, IsOk());
  std::vector<Episode> episodes;
  for (std::uint64_t i = 0; i < 30; ++i) episodes.push_back(MakeSyntheticEpisode(spec, i, 15));
  std::atomic<bool> done{false};
  std::atomic<int> reads{0}, wrong{0};
  {
    std::vector<std::jthread> readers;
    for (int t = 0; t < 3; ++t)
      readers.emplace_back([&] {
        const auto reader = DatasetReader::Open(folder.path());
        for (bool last = false; !last;) {
          last = done;
          const auto indices = reader->List();
          for (const std::uint64_t index : *indices) {
            const auto record = reader->Read(index);
            ++reads;
            if (!record || record->episode.eef_pos.values != episodes[index].eef_pos.values) ++wrong;
          }
        }
      });
    for (const auto& episode : episodes) EXPECT_THAT(writer->Commit(episode), IsOk());
    done = true;
  }
  EXPECT_EQ(wrong, 0);
  EXPECT_GE(reads, 90);
}

}  // namespace dataset_reader_test
}  // namespace etude::store
