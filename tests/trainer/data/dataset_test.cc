// SPDX-License-Identifier: Apache-2.0
// Tests trainer/data/dataset.cc
#include "trainer/data/dataset.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <fstream>
#include <set>
#include <string>
#include <vector>

#include "services/core/hash.h"
#include "services/core/log.h"
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
  const auto left = FixedSplit(*snapshot, Split::kValid, {first, 4711});
  ASSERT_TRUE(left) << left.error().message;
  EXPECT_EQ((*left)->episodes().size(), 1u) << "an episode that was lost ends no run";
  const auto missing = FixedSplit(*snapshot, Split::kValid, {4711});
  ASSERT_FALSE(missing);
  EXPECT_NE(missing.error().message.find("4711"), std::string::npos);
}

// Folders "a", of SyntheticSpec, and "b", of another seed and task order, of 20 episodes each.
class SeveralFolders : public ::testing::Test {
 protected:
  void SetUp() override {
    spec_.split = {3, 1, 0};  // one of four, exactly
    other_ = spec_;
    other_.seed = spec_.seed + 1;
    other_.tasks = {"rotate", spec_.tasks.front()};
    AddSyntheticEpisodes(folder_ / "a", spec_, 0, 20);
    AddSyntheticEpisodes(folder_ / "b", other_, 0, 20);
  }
  static std::shared_ptr<Dataset> Read(const std::vector<Path>& folders) {
    auto dataset = Dataset::Open(folders);
    EXPECT_TRUE(dataset) << dataset.error().message;
    EXPECT_TRUE((*dataset)->Refresh());
    return *dataset;
  }

  TemporaryFolder folder_;
  CampaignSpec spec_ = SyntheticSpec(), other_;
};

TEST_F(SeveralFolders, AreReadAsOneFolderByFolderWithTheSplitsOfEach) {
  const auto dataset = Read({folder_ / "a", folder_ / "b"});
  const auto snapshot = dataset->snapshot();

  EXPECT_EQ(dataset->folders(), 2u);
  ASSERT_EQ(snapshot->episodes().size(), 40u);
  for (std::size_t i = 0; i < 40; ++i) {
    const EpisodeEntry& entry = *snapshot->episodes()[i];
    const CampaignSpec& spec = i < 20 ? spec_ : other_;
    EXPECT_EQ(entry.folder, i / 20);
    EXPECT_EQ(entry.index, i % 20);
    EXPECT_EQ(entry.episode().spec_sha256, SpecHash(spec));
    EXPECT_EQ(entry.split, SplitOf(spec, entry.index) == "train" ? Split::kTrain : Split::kValid);
  }
  std::vector<std::string> tasks = spec_.tasks;
  tasks.emplace_back("rotate");
  EXPECT_EQ(dataset->tasks(), tasks) << "those of the first, then what others add";
  EXPECT_EQ(dataset->objects(), spec_.objects);
  EXPECT_EQ(dataset->text(), fmt::format("'{}', '{}'", (folder_ / "a").string(), (folder_ / "b").string()));
}

// before, training looked for words of "objects/mug_00" and ended the process at its first sentence
TEST_F(SeveralFolders, CallObjectsAsTheirScenesDo) {
  spec_.objects = {"cube", "objects/crate"};
  AddSyntheticEpisodes(folder_ / "imported", spec_, 0, 0);
  const auto dataset = Dataset::Open(folder_ / "imported");
  ASSERT_TRUE(dataset) << dataset.error().message;
  EXPECT_EQ((*dataset)->objects(), (std::vector<std::string>{"cube", "crate"}));
}

// an evaluation's folder is a dataset as any other, and CTRL learned what a policy had failed with
TEST_F(SeveralFolders, RolloutsAreNoDemonstrations) {
  spec_.mode = "rollout";
  spec_.rollout.run = "run";
  AddSyntheticEpisodes(folder_ / "rollouts", spec_, 0, 0);
  const auto dataset = Dataset::Open(std::vector<Path>{folder_ / "a", folder_ / "rollouts"});
  ASSERT_FALSE(dataset);
  EXPECT_EQ(dataset.error().code, Code::kInvalidArgument);
  EXPECT_NE(dataset.error().message.find("rollouts of a policy"), std::string::npos) << dataset.error().message;
}

// another spec is another hash, and yet the same scenes under the same numbers, for training here and validation there
TEST_F(SeveralFolders, OfOneSeedAreWarnedOf) {
  InitLog("test", "info");
  std::vector<std::string> heard;
  const LogListener listener([&](const LogRecord& record) { heard.push_back(record.text); });
  Read({folder_ / "a", folder_ / "b"});
  EXPECT_TRUE(heard.empty()) << heard.front();
  other_.seed = spec_.seed;
  other_.split = {1, 1, 0};
  AddSyntheticEpisodes(folder_ / "same", other_, 0, 20);
  Read({folder_ / "a", folder_ / "same"});
  ASSERT_EQ(heard.size(), 1u);
  EXPECT_NE(heard[0].find("have one seed"), std::string::npos) << heard[0];
}

// what a run is made of must not change because several folders can be read
TEST_F(SeveralFolders, OneAloneIsWhatItWas) {
  const auto alone = Read({folder_ / "a"}), both = Read({folder_ / "a", folder_ / "b"});
  ASSERT_EQ(alone->snapshot()->episodes().size(), 20u);
  for (std::size_t i = 0; i < 20; ++i) {
    EXPECT_EQ(alone->snapshot()->episodes()[i]->number(), i);
    EXPECT_EQ(both->snapshot()->episodes()[i]->number(), i) << "and keeps its numbers beside others";
  }
  std::string text;
  for (std::uint64_t i = 0; i < 20; ++i)
    if (SplitOf(spec_, i) == "train") text += fmt::format("{}:{};", i, MakeSyntheticEpisode(spec_, i).seed);
  EXPECT_EQ(alone->snapshot()->Fingerprint(), Sha256Hex(text));
  EXPECT_NE(both->snapshot()->Fingerprint(), alone->snapshot()->Fingerprint());
  EXPECT_EQ(both->snapshot()->Fingerprint(), Read({folder_ / "a", folder_ / "b"})->snapshot()->Fingerprint());
  EXPECT_NE(both->snapshot()->Fingerprint(), Read({folder_ / "b", folder_ / "a"})->snapshot()->Fingerprint());
}

TEST_F(SeveralFolders, GrowEachByItself) {
  const auto dataset = Read({folder_ / "a", folder_ / "b"});
  AddSyntheticEpisodes(folder_ / "a", spec_, 20, 23);
  AddSyntheticEpisodes(folder_ / "b", other_, 20, 21);
  ASSERT_EQ(dataset->Refresh().value(), 4);
  const auto& episodes = dataset->snapshot()->episodes();
  ASSERT_EQ(episodes.size(), 44u);
  EXPECT_EQ(episodes[22]->index, 22u);
  EXPECT_EQ(episodes[22]->folder, 0u);
  EXPECT_EQ(episodes[43]->index, 20u);
  EXPECT_EQ(episodes[43]->folder, 1u);
}

TEST_F(SeveralFolders, AFixedSplitIsOfBothAndKnowsEachByItsFolder) {
  const auto snapshot = Read({folder_ / "a", folder_ / "b"})->snapshot();
  const auto all = FixedSplit(*snapshot, Split::kValid, {});
  ASSERT_TRUE(all);
  std::set<std::uint32_t> folders;
  std::vector<std::uint64_t> numbers;
  for (const auto& entry : (*all)->episodes()) {
    folders.insert(entry->folder);
    numbers.push_back(entry->number());
  }
  EXPECT_EQ(folders, (std::set<std::uint32_t>{0, 1}));
  const auto again = FixedSplit(*snapshot, Split::kValid, numbers);
  ASSERT_TRUE(again);
  EXPECT_EQ((*again)->episodes(), (*all)->episodes());
  const auto missing = FixedSplit(*snapshot, Split::kValid, {EpisodeEntry::NumberOf(1, 4711)});
  ASSERT_FALSE(missing);
  EXPECT_NE(missing.error().message.find("4711 of dataset 2"), std::string::npos) << missing.error().message;
}

TEST_F(SeveralFolders, AnEpisodeThatTwoHaveIsRefused) {
  AddSyntheticEpisodes(folder_ / "shard", spec_, 20, 24);
  EXPECT_EQ(Read({folder_ / "a", folder_ / "shard"})->snapshot()->episodes().size(), 24u) << "shards have none";
  AddSyntheticEpisodes(folder_ / "shard", spec_, 3, 5);

  const std::vector<Path> folders{folder_ / "a", folder_ / "b", folder_ / "shard"};
  const auto twice = Dataset::Open(folders);
  ASSERT_TRUE(twice);
  const auto refused = (*twice)->Refresh();
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, Code::kInvalidArgument);
  for (const std::string& text :
       {(folder_ / "a").string(), (folder_ / "shard").string(), std::string("both have episode 3 and 1 more")})
    EXPECT_NE(refused.error().message.find(text), std::string::npos) << refused.error().message;
  const std::vector<Path> same{folder_ / "a", folder_ / "b", folder_ / "b/../a"};
  EXPECT_NE(Dataset::Open(same).error().message.find("twice"), std::string::npos);
}

TEST(Dataset, SaysThatAFolderIsNone) {
  const TemporaryFolder folder;
  EXPECT_EQ(Dataset::Open(folder / "none").error().code, Code::kNotFound);
}

}  // namespace dataset_test
}  // namespace etude::data
