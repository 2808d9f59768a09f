// SPDX-License-Identifier: Apache-2.0
// Tests trainer/data/dataset.cc
#include "trainer/data/dataset.h"

#include <gtest/gtest.h>

#include <fstream>

#include "tests/support/temporary_folder.h"
#include "tests/trainer/data/synthetic_dataset.h"

namespace etude::data {
namespace dataset_test {

TEST(Dataset, GrowsWithItsFolderAndKeepsOldSnapshots) {
  const TemporaryFolder folder;
  const CampaignSpec spec = SyntheticSpec();
  AddSyntheticEpisodes(folder / "d", spec, 0, 5);
  auto dataset = Dataset::Open(folder / "d");
  ASSERT_TRUE(dataset) << dataset.error().message;

  ASSERT_EQ((*dataset)->Refresh().value(), 5);
  const auto before = (*dataset)->snapshot();
  AddSyntheticEpisodes(folder / "d", spec, 5, 9);
  ASSERT_EQ((*dataset)->Refresh().value(), 4);
  ASSERT_EQ((*dataset)->Refresh().value(), 0);

  EXPECT_EQ(before->episodes().size(), 5u);
  const auto after = (*dataset)->snapshot();
  ASSERT_EQ(after->episodes().size(), 9u);
  for (const auto& entry : after->episodes()) {
    const char* name = entry->split == Split::kTrain ? "train" : "valid";
    EXPECT_EQ(SplitOf(spec, entry->index), name);
    EXPECT_EQ(entry->episode().states.rows(), 0);
  }
  EXPECT_NE(before->Fingerprint(), after->Fingerprint());
}

TEST(Dataset, LeavesOutACorruptFileAndKeepsTheOthers) {
  const TemporaryFolder folder;
  AddSyntheticEpisodes(folder / "d", SyntheticSpec(), 0, 4);
  std::ofstream(store::EpisodePath(folder / "d", 2), std::ios::trunc) << "not an episode";
  auto dataset = Dataset::Open(folder / "d");
  ASSERT_TRUE(dataset);

  ASSERT_EQ((*dataset)->Refresh().value(), 3);
  for (int i = 0; i < Dataset::kReadAttempts; ++i) ASSERT_EQ((*dataset)->Refresh().value(), 0);

  EXPECT_EQ((*dataset)->bad_files(), 1u);
  for (const auto& entry : (*dataset)->snapshot()->episodes()) EXPECT_NE(entry->index, 2u);
}

// before, one error was enough to lose the episode for the whole run
TEST(Dataset, TriesAFileAgainThatCouldNotBeRead) {
  const TemporaryFolder folder;
  AddSyntheticEpisodes(folder / "d", SyntheticSpec(), 0, 4);
  const Path path = store::EpisodePath(folder / "d", 2), aside = folder / "aside";
  std::filesystem::rename(path, aside);
  std::filesystem::create_directory(path);  // EISDIR: what cannot be read for now
  auto dataset = Dataset::Open(folder / "d");
  ASSERT_TRUE(dataset);
  ASSERT_EQ((*dataset)->Refresh().value(), 3);
  EXPECT_EQ((*dataset)->bad_files(), 0u);

  std::filesystem::remove(path);
  std::filesystem::rename(aside, path);

  ASSERT_EQ((*dataset)->Refresh().value(), 1);
  EXPECT_EQ((*dataset)->snapshot()->episodes().size(), 4u);
}

// what a frame is good for is found when its episode is read, not at every look at a growing folder
TEST(Dataset, LooksAtTheFramesOfAnEpisodeOnce) {
  const TemporaryFolder folder;
  const CampaignSpec spec = SyntheticSpec();
  AddSyntheticEpisodes(folder / "d", spec, 0, 5);
  auto dataset = Dataset::Open(folder / "d");
  ASSERT_TRUE(dataset);
  ASSERT_TRUE((*dataset)->Refresh());
  const auto before = (*dataset)->snapshot();
  AddSyntheticEpisodes(folder / "d", spec, 5, 6);
  ASSERT_TRUE((*dataset)->Refresh());
  const auto after = (*dataset)->snapshot();

  for (std::size_t i = 0; i < before->episodes().size(); ++i) {
    EXPECT_EQ(before->episodes()[i], after->episodes()[i]);  // the same entry, with the frames that were found
    for (const std::uint32_t frame : after->episodes()[i]->usable)
      EXPECT_TRUE(UsableFrame(*after->episodes()[i], frame));
  }
  std::size_t usable = 0;
  for (const auto& entry : after->episodes()) usable += entry->usable.size();
  EXPECT_EQ(usable, after->frame_count(Split::kTrain) + after->frame_count(Split::kValid));
}

TEST(FixedSplit, StaysWhileTheDatasetGrows) {
  const TemporaryFolder folder;
  AddSyntheticEpisodes(folder / "d", SyntheticSpec(), 0, 60);
  auto dataset = Dataset::Open(folder / "d");
  ASSERT_TRUE(dataset);
  ASSERT_TRUE((*dataset)->Refresh());
  const auto snapshot = (*dataset)->snapshot();

  const auto all = FixedSplit(*snapshot, Split::kValid, {});
  ASSERT_TRUE(all) << all.error().message;
  ASSERT_EQ((*all)->episodes().size(), snapshot->episode_count(Split::kValid));
  ASSERT_GE((*all)->episodes().size(), 2u);
  const std::uint64_t first = (*all)->episodes()[0]->index;
  const auto one = FixedSplit(*snapshot, Split::kValid, {first});
  ASSERT_TRUE(one);
  EXPECT_EQ((*one)->episodes().size(), 1u);
  const auto missing = FixedSplit(*snapshot, Split::kValid, {first, 4711});
  ASSERT_FALSE(missing);
  EXPECT_NE(missing.error().message.find("4711"), std::string::npos);
}

TEST(Dataset, SaysThatAFolderIsNone) {
  const TemporaryFolder folder;
  EXPECT_EQ(Dataset::Open(folder / "none").error().code, Code::kNotFound);
}

}  // namespace dataset_test
}  // namespace etude::data
