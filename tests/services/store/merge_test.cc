// SPDX-License-Identifier: Apache-2.0
// Tests services/store/merge.cc
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "services/store/edit.h"
#include "services/store/filter_keys.h"
#include "tests/support/matchers.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude::store {
namespace merge_test {

using testing::ElementsAre;

class Merge : public testing::Test {
 protected:
  Path Write(const std::string& name, const CampaignSpec& spec, const std::vector<std::uint64_t>& indices,
             int steps = 10) {
    auto writer = DatasetWriter::Open(folder_ / name, spec);
    EXPECT_THAT(writer, IsOk());
    for (const std::uint64_t i : indices) EXPECT_THAT(writer->Commit(MakeSyntheticEpisode(spec, i, steps)), IsOk());
    EXPECT_THAT(writer->WriteMaster(), IsOk());
    return folder_ / name;
  }
  void ExpectSound(std::uint64_t episodes) {
    const auto report = Verify(out_, Quarantine::kNo);
    ASSERT_THAT(report, IsOk());
    EXPECT_EQ(report->good, episodes);
    EXPECT_TRUE(report->bad.empty()) << report->bad[0].reason;
  }

  TemporaryFolder folder_;
  CampaignSpec spec_ = SyntheticSpec();
  Path out_ = folder_ / "merged";
};

TEST_F(Merge, OfOneSpecKeepsEveryByte) {
  const auto report = MergeDatasets({Write("a", spec_, {0, 2}), Write("b", spec_, {2, 5})}, out_, Leftover::kRefuse);

  ASSERT_THAT(report, IsOk());
  EXPECT_EQ(report->episodes, 3u);
  EXPECT_FALSE(report->renumbered);
  EXPECT_THAT(*DatasetReader::Open(out_)->List(), ElementsAre(0, 2, 5));
  EXPECT_EQ(*ReadBinaryFile(EpisodePath(out_, 5)), *ReadBinaryFile(EpisodePath(folder_ / "b", 5)));
  EXPECT_EQ(*HashDataset(out_), *HashDataset(Write("all", spec_, {0, 2, 5})));
  ExpectSound(3);
}

// Neither is part of a spec's hash, and each decides on what an episode is or is for.
TEST_F(Merge, OfOneSpecButAnotherSplitOrNameIsRefused) {
  CampaignSpec split = spec_, name = spec_;
  split.split = {1, 9, 0};
  name.name = "other";
  ASSERT_EQ(SpecHash(split), SpecHash(spec_));
  const Path a = Write("a", spec_, {0});
  EXPECT_THAT(MergeDatasets({a, Write("b", split, {1})}, out_, Leftover::kRefuse), MessageHas("not of one split"));
  ASSERT_EQ(SpecHash(name), SpecHash(spec_));
  EXPECT_THAT(MergeDatasets({a, Write("c", name, {1})}, out_, Leftover::kRefuse), MessageHas("not of one name"));
}

TEST_F(Merge, UndoesAFilter) {
  const Path all = Write("all", spec_, {0, 1, 2, 3});
  ASSERT_THAT(CopyEpisodes(all, {0, 3}, folder_ / "a", Leftover::kRefuse), IsOk());
  ASSERT_THAT(CopyEpisodes(all, {1, 2}, folder_ / "b", Leftover::kRefuse), IsOk());
  ASSERT_THAT(MergeDatasets({folder_ / "a", folder_ / "b"}, out_, Leftover::kRefuse), IsOk());
  EXPECT_EQ(*HashDataset(out_), *HashDataset(all));
}

TEST_F(Merge, OfDifferentSpecsNumbersAnewAndSaysWhereFrom) {
  CampaignSpec other = spec_;
  other.seed = 77;
  other.name = "second";
  other.robots = {"panda"};
  const auto report = MergeDatasets({Write("a", spec_, {4}), Write("b", other, {0, 4})}, out_, Leftover::kRefuse);

  ASSERT_THAT(report, IsOk());
  EXPECT_TRUE(report->renumbered);
  const auto reader = DatasetReader::Open(out_);
  ASSERT_THAT(reader, IsOk());
  EXPECT_THAT(*reader->List(), ElementsAre(0, 1, 2));
  EXPECT_THAT(reader->spec().robots, ElementsAre("ur5", "panda"));
  const auto last = reader->ReadWhole(2);
  ASSERT_THAT(last, IsOk());
  EXPECT_EQ(last->robot, "panda");
  EXPECT_EQ(last->details["merged_from"]["campaign"], "second");
  EXPECT_EQ(last->details["merged_from"]["index"], 4);
  EXPECT_EQ(last->details["merged_from"]["spec_sha256"], SpecHash(other));
  EXPECT_EQ(last->cameras[0].streams, MakeSyntheticEpisode(other, 4, 10).cameras[0].streams);
  ExpectSound(3);
}

TEST_F(Merge, OfWhatWasMergedKeepsWhereItFirstCameFrom) {
  CampaignSpec second = spec_, third = spec_;
  second.seed = 77;
  second.name = "second";
  third.seed = 78;
  const Path both = folder_ / "both";
  ASSERT_THAT(MergeDatasets({Write("a", spec_, {4}), Write("b", second, {3})}, both, Leftover::kRefuse), IsOk());
  ASSERT_THAT(MergeDatasets({both, Write("c", third, {0})}, out_, Leftover::kRefuse), IsOk());
  const auto moved = DatasetReader::Open(out_).value().ReadWhole(1);
  ASSERT_THAT(moved, IsOk());
  const auto& from = moved->details["merged_from"];
  EXPECT_EQ(from["campaign"], "merged");
  EXPECT_EQ(from["merged_from"]["campaign"], "second");
  EXPECT_EQ(from["merged_from"]["index"], 3);
}

// both had the hash of the first part's spec, and good episodes were called damaged
TEST_F(Merge, OfTwoMergesAndOfAMergeWithItsPart) {
  CampaignSpec second = spec_, third = spec_;
  second.camera.fovy_deg += 1;
  third.camera.fovy_deg += 2;
  const Path a = Write("a", spec_, {0}), b = Write("b", second, {0}), c = Write("c", third, {0});
  const Path ab = folder_ / "ab", ac = folder_ / "ac", all = folder_ / "all";
  ASSERT_THAT(MergeDatasets({a, b}, ab, Leftover::kRefuse), IsOk());
  ASSERT_THAT(MergeDatasets({a, c}, ac, Leftover::kRefuse), IsOk());
  EXPECT_NE(DatasetReader::Open(ab).value().spec_sha256(), DatasetReader::Open(ac).value().spec_sha256());
  EXPECT_THAT(MergeDatasets({ab, ac}, all, Leftover::kRefuse), IsOk());
  EXPECT_THAT(MergeDatasets({ab, a}, out_, Leftover::kRefuse), IsOk());
  ExpectSound(3);
}

// each merge of the one before nested it deeper, until what was written could not be read
TEST_F(Merge, AfterVeryManyAnEpisodeStillSaysWhereItCameFrom) {
  CampaignSpec today = spec_;
  Path before = Write("first", spec_, {5});
  for (int day = 0; day < 12; ++day) {
    today.seed = 100 + day;
    const Path so_far = folder_ / fmt::format("so_far{}", day);
    const Path one = Write(fmt::format("day{}", day), today, {0});
    ASSERT_THAT(MergeDatasets({before, one}, so_far, Leftover::kRefuse), IsOk());
    before = so_far;
  }
  const auto episode = DatasetReader::Open(before).value().ReadWhole(0);
  ASSERT_THAT(episode, IsOk());
  const OrderedJson* from = &episode->details["merged_from"];
  int merges = 1;
  for (; from->contains("merged_from"); from = &from->at("merged_from")) ++merges;
  EXPECT_EQ(merges, 8);
  EXPECT_EQ(from->at("campaign"), spec_.name);
  EXPECT_EQ(from->at("index"), 5);
}

TEST_F(Merge, PlansWhatTheLargestPlansInEitherOrder) {
  CampaignSpec more = spec_;
  more.episodes = spec_.episodes + 100;
  const Path a = Write("a", spec_, {1}), b = Write("b", more, {2});
  const Path other = folder_ / "other";
  ASSERT_THAT(MergeDatasets({a, b}, out_, Leftover::kRefuse), IsOk());
  ASSERT_THAT(MergeDatasets({b, a}, other, Leftover::kRefuse), IsOk());
  EXPECT_EQ(DatasetReader::Open(out_).value().spec().episodes, more.episodes);
  EXPECT_EQ(DatasetReader::Open(other).value().spec().episodes, more.episodes);
}

// who would ask the joint spec where its cameras are would be told one part's draws
TEST_F(Merge, OfAMovingAndAStillCameraLeavesItToTheEpisodes) {
  CampaignSpec moving = spec_, alike = spec_;
  moving.seed = 77;
  moving.randomization.world.camera_position = 0.05;
  alike.randomization.world.camera_position = 0.05;
  const Path both = folder_ / "both", one = folder_ / "one";
  const Path a = Write("a", moving, {0}), b = Write("b", spec_, {1}), c = Write("c", alike, {2});
  ASSERT_THAT(MergeDatasets({a, b}, both, Leftover::kRefuse), IsOk());
  EXPECT_EQ(DatasetReader::Open(both).value().spec().randomization.world.camera_position, 0);
  ASSERT_THAT(MergeDatasets({a, c}, one, Leftover::kRefuse), IsOk());
  EXPECT_EQ(DatasetReader::Open(one).value().spec().randomization.world.camera_position, 0.05) << "their draws are one";
}

// before, a key of an episode that two have was kept by chance of their order, and one of another spec never
TEST_F(Merge, FilterKeysComeAlong) {
  const Path a = Write("a", spec_, {0, 1, 2}), b = Write("b", spec_, {1, 3});
  ASSERT_THAT(WriteFilterKey(a, "good", {0, 1}), IsOk());
  ASSERT_THAT(WriteFilterKey(b, "good", {3}), IsOk());
  ASSERT_THAT(WriteFilterKey(b, "keep", {1}), IsOk());
  ASSERT_THAT(MergeDatasets({a, b}, out_, Leftover::kRefuse), IsOk());
  EXPECT_EQ(*ReadFilterKeys(out_), (FilterKeys{{"good", {0, 1, 3}}, {"keep", {1}}}));

  CampaignSpec other = spec_;
  other.seed = 77;
  const Path c = Write("c", other, {5, 7}), anew = folder_ / "anew";
  ASSERT_THAT(WriteFilterKey(c, "keep", {7}), IsOk());
  ASSERT_THAT(MergeDatasets({b, c}, anew, Leftover::kRefuse), IsOk());
  EXPECT_EQ(*ReadFilterKeys(anew), (FilterKeys{{"good", {1}}, {"keep", {0, 3}}}));
  EXPECT_TRUE(IsDerived(anew)) << "nobody collects on there";
}

TEST_F(Merge, RefusesWhatDoesNotGoTogether) {
  const Path a = Write("a", spec_, {1});
  EXPECT_THAT(MergeDatasets({a}, out_, Leftover::kRefuse), MessageHas("at least two"));
  EXPECT_THAT(MergeDatasets({a, folder_ / "none"}, out_, Leftover::kRefuse), HasCode(Code::kNotFound));
  const auto twice = MergeDatasets({a, Write("b", spec_, {1}, 20)}, out_, Leftover::kRefuse);
  EXPECT_THAT(twice, MessageHas("differ"));
  EXPECT_THAT(twice, MessageHas("determinism")) << "two hosts may have made it";
  CampaignSpec large = SyntheticSpec(64, 64);
  EXPECT_THAT(MergeDatasets({a, Write("c", large, {0})}, out_, Leftover::kRefuse), MessageHas("64x64"));
  EXPECT_FALSE(std::filesystem::exists(out_));
}

}  // namespace merge_test
}  // namespace etude::store
