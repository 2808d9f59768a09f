// SPDX-License-Identifier: Apache-2.0
// Tests trainer/data/dataset.cc
#include "trainer/data/dataset.h"

#include <gtest/gtest.h>

#include <fstream>

#include "tests/support/temporary_folder.h"
#include "tests/trainer/data/synthetic_dataset.h"

namespace etude::data {
namespace {

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

  EXPECT_EQ((*dataset)->bad_files(), 1u);
  for (const auto& entry : (*dataset)->snapshot()->episodes()) EXPECT_NE(entry->index, 2u);
}

TEST(Dataset, SaysThatAFolderIsNone) {
  const TemporaryFolder folder;
  EXPECT_EQ(Dataset::Open(folder / "none").error().code, Code::kNotFound);
}

}  // namespace
}  // namespace etude::data
