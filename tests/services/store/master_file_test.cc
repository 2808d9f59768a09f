// SPDX-License-Identifier: Apache-2.0
// Tests services/store/master_file.cc: which filter key has which episodes.
#include "services/store/master_file.h"

#include <gmock/gmock.h>

#include "services/store/dataset.h"
#include "services/store/episode_file.h"
#include "services/store/layout.h"
#include "tests/support/matchers.h"
#include "tests/support/replace_in_file.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude::store::internal {
namespace master_file_test {

using testing::ElementsAre;
using testing::IsEmpty;

using Masks = std::map<std::string, std::vector<std::string>>;

// Episodes 0, 1, ... made for these tasks.
std::map<std::uint64_t, EpisodeSummary> Made(const std::vector<std::string>& tasks) {
  std::map<std::uint64_t, EpisodeSummary> episodes;
  for (std::uint64_t i = 0; i < tasks.size(); ++i) {
    episodes[i].task = tasks[i];
    episodes[i].samples = 10 + i;
  }
  return episodes;
}

CampaignSpec OfCounts(double train, double valid, double test) {
  CampaignSpec spec = SyntheticSpec();
  spec.split = {train, valid, test};
  return spec;
}

TEST(EntriesOf, AreInTheOrderOfIndicesWithTheirTasks) {
  std::map<std::uint64_t, EpisodeSummary> episodes;
  for (const std::uint64_t index : {9u, 3u, 300u}) {
    episodes[index].task = "task" + std::to_string(index);
    episodes[index].samples = index;
  }
  const auto entries = EntriesOf(episodes);
  ASSERT_EQ(entries.size(), 3u);
  EXPECT_EQ(entries[0].index, 3u);
  EXPECT_EQ(entries[2].index, 300u);
  EXPECT_EQ(*entries[1].task, "task9");
  EXPECT_EQ(entries[1].samples, 9u);
}

TEST(MasksOf, EverySplitIsThereAndEveryEpisodeInOneOfThem) {
  const auto none = MasksOf(OfCounts(4, 1, 1), {}, {});
  EXPECT_EQ(none, (Masks{{"train", {}}, {"valid", {}}, {"test", {}}})) << "an empty key, not a missing one";

  const auto episodes = Made(std::vector<std::string>(60, "pick"));
  const Masks masks = MasksOf(OfCounts(4, 1, 1), EntriesOf(episodes), {});
  std::multiset<std::string> all;
  for (const char* split : {"train", "valid", "test"}) all.insert(masks.at(split).begin(), masks.at(split).end());
  ASSERT_EQ(all.size(), 60u);
  for (std::uint64_t i = 0; i < 60; ++i) EXPECT_EQ(all.count(DemoName(i)), 1u) << i;
  EXPECT_EQ(masks.at("train").size(), 40u) << "whole numbers are counts";
  EXPECT_EQ(masks.at("test").size(), 10u);
  EXPECT_EQ(masks.at("pick").size(), 60u);
}

TEST(MasksOf, TasksHaveKeysThatH5pyAndShellsTake) {
  const auto episodes = Made({"pick", "push+obstacle", "my/own/task.yaml", "pick", "push+obstacle"});
  const Masks masks = MasksOf(OfCounts(1, 0, 0), EntriesOf(episodes), {});
  EXPECT_THAT(masks.at("pick"), ElementsAre("demo_0", "demo_3"));
  EXPECT_THAT(masks.at("push_obstacle"), ElementsAre("demo_1", "demo_4"));
  EXPECT_EQ(masks.size(), 3u + 2u) << "a path is no name of a group";
}

TEST(MasksOf, ChosenKeysNameOnlyEpisodesThatAreThere) {
  auto episodes = Made({"pick", "pick", "pick", "pick"});
  episodes.erase(2);
  const Masks masks = MasksOf(OfCounts(1, 0, 0), EntriesOf(episodes), {{"keep", {0, 2, 3, 77}}, {"none", {99}}});
  EXPECT_THAT(masks.at("keep"), ElementsAre("demo_0", "demo_3"));
  EXPECT_THAT(masks.at("none"), IsEmpty());
}

class MasterFile : public testing::Test {
 protected:
  // Two tasks, one of them with a variant.
  void SetUp() override {
    spec_.tasks = {"pick", "push+obstacle"};
    auto writer = DatasetWriter::Open(data_, spec_);
    ASSERT_THAT(writer, IsOk());
    for (std::uint64_t i = 0; i < 4; ++i) ASSERT_THAT(writer->Commit(MakeSyntheticEpisode(spec_, i, 10)), IsOk());
    ASSERT_THAT(writer->WriteMaster(), IsOk());
  }

  TemporaryFolder folder_;
  CampaignSpec spec_ = SyntheticSpec();
  Path data_ = folder_ / "data";
};

// before, a key of that name took the place of the task's in the master file, and who trained on it got other episodes
TEST_F(MasterFile, AKeyTakesNoNameThatATaskHasThere) {
  EXPECT_THAT(WriteFilterKey(data_, "pick", {1}), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(WriteFilterKey(data_, "push_obstacle", {1}), HasCode(Code::kInvalidArgument));
  EXPECT_TRUE(ReadFilterKeys(data_)->empty());
  EXPECT_THAT(WriteFilterKey(data_, "push", {1}), IsOk()) << "no task of this campaign";
}

TEST_F(MasterFile, KeysThatCannotBeReadKeepItFromNoOneAndReplaceNothing) {
  const auto before = ReadBinaryFile(data_ / kMasterFile);
  ASSERT_THAT(before, IsOk());
  ASSERT_THAT(WriteFileAtomically(data_ / kFilters, std::string_view("not JSON")), IsOk());
  const auto episodes = Made({"pick", "push+obstacle", "pick", "push+obstacle"});
  EXPECT_THAT(WriteMasterFile(data_, spec_, SpecHash(spec_), EntriesOf(episodes)), IsOk());
  EXPECT_EQ(ReadTextFile(data_ / kFilters).value(), "not JSON") << "somebody's choice, to be mended by them";
}

TEST_F(MasterFile, IsTheSameBytesForTheSameEpisodes) {
  const auto episodes = Made({"pick", "push+obstacle", "pick"});
  ASSERT_THAT(WriteMasterFile(folder_ / "a", spec_, SpecHash(spec_), EntriesOf(episodes)), IsOk());
  ASSERT_THAT(WriteMasterFile(folder_ / "b", spec_, SpecHash(spec_), EntriesOf(episodes)), IsOk());
  EXPECT_EQ(ReadBinaryFile(folder_ / "a" / kMasterFile).value(), ReadBinaryFile(folder_ / "b" / kMasterFile).value());
}

// before, it had the hash that the spec has now, and the episodes another one
TEST_F(MasterFile, HasTheHashThatTheDatasetHas) {
  const std::string before(64, 'a');
  ReplaceInFile(data_ / kDatasetJson, SpecHash(spec_), before);
  ASSERT_THAT(WriteFilterKey(data_, "keep", {1}), IsOk());
  const auto master = ReadTextFile(data_ / kMasterFile);
  ASSERT_THAT(master, IsOk());
  EXPECT_NE(master->find(before), std::string::npos);
  EXPECT_EQ(master->find(SpecHash(spec_)), std::string::npos);
}

// A collector asks every half minute; at 20 episodes a second that is every 600.
TEST(MasterIsDue, CostsAnEpisodeTheSameAtTenAndAtAMillion) {
  const auto links_for_each = [](std::uint64_t total, std::uint64_t step) {
    std::uint64_t written = 0, links = 0;
    for (std::uint64_t episodes = step; episodes <= total; episodes += step) {
      EXPECT_LE(4 * (episodes - written), std::max<std::uint64_t>(4000, episodes) + 4 * step) << "it lacks no more";
      if (!MasterIsDue(episodes, written)) continue;
      written = episodes;
      links += episodes;
    }
    return static_cast<double>(links) / static_cast<double>(total);
  };
  EXPECT_LE(links_for_each(100'000, 600), 5);
  EXPECT_LE(links_for_each(1'000'000, 600), 5);
  EXPECT_LE(links_for_each(10'000'000, 600), 5);
  EXPECT_FALSE(MasterIsDue(5, 5)) << "nothing came";
  EXPECT_TRUE(MasterIsDue(1000, 999)) << "small ones are always whole";
  EXPECT_FALSE(MasterIsDue(1249, 1000));
  EXPECT_TRUE(MasterIsDue(1250, 1000));
}

}  // namespace master_file_test
}  // namespace etude::store::internal
