// SPDX-License-Identifier: Apache-2.0
// Tests services/store/edit.cc, groups.cc and filter_keys.cc
#include "services/store/edit.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <numeric>

#include "services/core/stop.h"
#include "services/store/filter_keys.h"
#include "services/store/layout.h"
#include "tests/support/matchers.h"
#include "tests/support/small_disk.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude::store {
namespace edit_test {

using testing::ElementsAre;

class Edit : public testing::Test {
 protected:
  void SetUp() override {
    auto writer = DatasetWriter::Open(data_, spec_);
    ASSERT_THAT(writer, IsOk());
    ASSERT_THAT(writer->RecordFailure(2, 0, "slip", "{}"), IsOk());
    ASSERT_THAT(writer->RecordFailure(5, 0, "slip", "{}"), IsOk());
    for (std::uint64_t i = 0; i < 10; ++i)
      ASSERT_THAT(writer->Commit(MakeSyntheticEpisode(spec_, i, 10 + static_cast<int>(i))), IsOk());
    ASSERT_THAT(writer->WriteMaster(), IsOk());
  }

  static std::vector<std::uint64_t> List(const Path& dataset) { return *DatasetReader::Open(dataset)->List(); }
  static void ExpectSound(const Path& dataset, std::uint64_t episodes) {
    const auto report = Verify(dataset, Quarantine::kNo);
    ASSERT_THAT(report, IsOk());
    EXPECT_EQ(report->good, episodes);
    EXPECT_TRUE(report->bad.empty());
    const auto info = DatasetInfo(dataset);
    ASSERT_THAT(info, IsOk());
    const auto description = internal::ReadDatasetFile(dataset);
    ASSERT_THAT(description, IsOk());
    EXPECT_EQ(description->statistics["episodes"], episodes);
    EXPECT_EQ((*info)["statistics"], [&] {
      OrderedJson statistics = description->statistics;
      statistics.erase("failed_attempts");
      return statistics;
    }());
  }

  TemporaryFolder folder_;
  CampaignSpec spec_ = SyntheticSpec();
  Path data_ = folder_ / "data";
};

TEST_F(Edit, SelectsWhatFitsEveryList) {
  EXPECT_EQ(Select(data_, {})->size(), 10u);
  EXPECT_THAT(*Select(data_, {.indices = {7, 2}}), ElementsAre(2, 7));
  EXPECT_THAT(*Select(data_, {.min_steps = 12, .max_steps = 13}), ElementsAre(2, 3));
  const auto picks = Select(data_, {.tasks = {"pick"}});
  ASSERT_THAT(picks, IsOk());
  EXPECT_FALSE(picks->empty());
  const auto reader = DatasetReader::Open(data_);
  for (const std::uint64_t i : *picks) EXPECT_EQ(reader->Read(i)->episode.task, "pick");
  EXPECT_TRUE(Select(data_, {.tasks = {"pick"}, .robots = {"panda"}})->empty());
  EXPECT_THAT(Select(data_, {.indices = {99}}), HasCode(Code::kNotFound));
  EXPECT_THAT(Select(data_, {.keys = {"none"}}), MessageHas("no filter key 'none'"));
}

TEST_F(Edit, CopiesEpisodesWithTheirBytesAndWhatIsSaidOfThem) {
  ASSERT_THAT(WriteFilterKey(data_, "keep", {2, 3}), IsOk());

  ASSERT_THAT(CopyEpisodes(data_, {2, 7}, folder_ / "some", Leftover::kRefuse), IsOk());

  EXPECT_THAT(List(folder_ / "some"), ElementsAre(2, 7));
  EXPECT_EQ(*ReadBinaryFile(EpisodePath(folder_ / "some", 7)), *ReadBinaryFile(EpisodePath(data_, 7)));
  ExpectSound(folder_ / "some", 2);
  EXPECT_EQ(*ReadFilterKeys(folder_ / "some"), (FilterKeys{{"keep", {2}}}));
  const std::string attempts = *ReadTextFile(folder_ / "some/attempts.jsonl");
  EXPECT_THAT(attempts, testing::HasSubstr("\"index\":2"));
  EXPECT_THAT(attempts, testing::Not(testing::HasSubstr("\"index\":5")));
  const std::string commits = *ReadTextFile(folder_ / "some/commits.jsonl");
  EXPECT_EQ(std::ranges::count(commits, '\n'), 2) << "who made each, and nothing has to be read for it: " << commits;
  EXPECT_THAT(CopyEpisodes(data_, {1}, folder_ / "some", Leftover::kRefuse), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(CopyEpisodes(data_, {}, folder_ / "other", Leftover::kRefuse), MessageHas("no episode"));

  // the campaign goes on in the copy
  EXPECT_THAT(DatasetWriter::Open(folder_ / "some", spec_), IsOk());
}

// as git-annex keeps large files; before, a copy had links that led nowhere once it was moved
TEST_F(Edit, CopiesWhatALinkLeadsTo) {
  const Path elsewhere = folder_ / "elsewhere.hdf5";
  std::filesystem::rename(EpisodePath(data_, 2), elsewhere);
  std::filesystem::create_symlink(elsewhere, EpisodePath(data_, 2));

  ASSERT_THAT(CopyEpisodes(data_, {2}, folder_ / "some", Leftover::kRefuse), IsOk());

  EXPECT_FALSE(std::filesystem::is_symlink(EpisodePath(folder_ / "some", 2)));
  EXPECT_EQ(*ReadBinaryFile(EpisodePath(folder_ / "some", 2)), *ReadBinaryFile(elsewhere));
}

// before, who was killed in between had a dataset without them
TEST_F(Edit, ACopyAppearsWithWhatElseBelongsToIt) {
  const auto note = [&](const Path& folder) {
    EXPECT_FALSE(std::filesystem::exists(folder_ / "some"));
    return WriteFileAtomically(folder / "note", std::string_view("x"));
  };
  ASSERT_THAT(CopyEpisodes(data_, {2}, folder_ / "some", Leftover::kRefuse, {}, note), IsOk());
  EXPECT_EQ(*ReadTextFile(folder_ / "some/note"), "x");
  const auto fail = [](const Path&) -> Status { return Fail(Code::kUnavailable, "full"); };
  EXPECT_THAT(CopyEpisodes(data_, {2}, folder_ / "none", Leftover::kRefuse, {}, fail), MessageHas("full"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "none"));
}

TEST_F(Edit, OnlyACollectorThatMayAddMakesEpisodesAgain) {
  EXPECT_TRUE(CanBeMadeAgain(data_));
  ASSERT_THAT(CopyEpisodes(data_, {2}, folder_ / "some", Leftover::kRefuse), IsOk());
  EXPECT_FALSE(CanBeMadeAgain(folder_ / "some")) << "of others";
  EXPECT_FALSE(CanBeMadeAgain(folder_ / "none"));
  CampaignSpec rollouts = spec_;
  rollouts.mode = "rollout";
  rollouts.rollout.run = "run";
  ASSERT_THAT(DatasetWriter::Open(folder_ / "rollouts", rollouts), IsOk());
  EXPECT_FALSE(CanBeMadeAgain(folder_ / "rollouts")) << "no collection makes rollouts";
  auto description = OrderedJson::parse(*ReadTextFile(data_ / "dataset.json"));
  description["content"] = 1;
  ASSERT_THAT(WriteFileAtomically(data_ / "dataset.json", description.dump()), IsOk());
  EXPECT_FALSE(CanBeMadeAgain(data_)) << "it would be refused";
}

TEST_F(Edit, WhatIsDerivedIsTheSameOfTheJournalAndOfTheFiles) {
  const auto statistics = [&] { return internal::ReadDatasetFile(data_)->statistics; };
  const OrderedJson made = statistics();
  ASSERT_THAT(WriteFilterKey(data_, "keep", {1}), IsOk());
  EXPECT_EQ(statistics(), made);
  const auto master = ReadBinaryFile(data_ / "dataset.hdf5");
  ASSERT_THAT(master, IsOk());
  std::filesystem::remove(data_ / "commits.jsonl");
  ASSERT_THAT(WriteFilterKey(data_, "keep", {1}), IsOk());
  EXPECT_EQ(statistics(), made);
  EXPECT_EQ(*ReadBinaryFile(data_ / "dataset.hdf5"), *master);
}

TEST_F(Edit, ACopySaysThatNoCampaignGoesOnWithItUntilOneDoes) {
  const auto derived = [&](const Path& dataset) {
    return OrderedJson::parse(*ReadTextFile(dataset / "dataset.json")).value("derived", false);
  };
  const std::string hash = HashDataset(data_).value();
  std::vector<std::uint64_t> all(10);
  std::iota(all.begin(), all.end(), 0);
  ASSERT_THAT(CopyEpisodes(data_, all, folder_ / "copy", Leftover::kRefuse), IsOk());
  EXPECT_FALSE(derived(data_));
  EXPECT_TRUE(derived(folder_ / "copy"));
  EXPECT_EQ(HashDataset(folder_ / "copy").value(), hash) << "the same episodes";
  auto writer = DatasetWriter::Open(folder_ / "copy", spec_);
  ASSERT_THAT(writer, IsOk());
  ASSERT_THAT(writer->Commit(MakeSyntheticEpisode(spec_, 10, 10)), IsOk());
  ASSERT_THAT(writer->WriteMaster(), IsOk());
  EXPECT_FALSE(derived(folder_ / "copy"));
}

TEST_F(Edit, ACopyOutlivesItsOriginal) {
  ASSERT_THAT(CopyEpisodes(data_, {1}, folder_ / "one", Leftover::kRefuse), IsOk());
  ASSERT_THAT(DeleteEpisodes(data_, {1}), IsOk());
  ExpectSound(folder_ / "one", 1);
}

TEST_F(Edit, DeletesAllOrNothing) {
  ASSERT_THAT(WriteFilterKey(data_, "keep", {3, 4}), IsOk());
  EXPECT_THAT(DeleteEpisodes(data_, {3, 99}), MessageHas("nothing was deleted"));
  EXPECT_EQ(List(data_).size(), 10u);

  ASSERT_THAT(DeleteEpisodes(data_, {0, 3}), IsOk());

  EXPECT_THAT(List(data_), ElementsAre(1, 2, 4, 5, 6, 7, 8, 9));
  ExpectSound(data_, 8);
  EXPECT_EQ(*ReadFilterKeys(data_), (FilterKeys{{"keep", {4}}}));
  auto writer = DatasetWriter::Open(data_, spec_);  // a campaign that goes on makes them again
  ASSERT_THAT(writer, IsOk());
  EXPECT_FALSE(writer->Contains(3));
}

// before, who stopped a selection that took minutes had everything deleted
TEST_F(Edit, NothingIsDeletedOnceAStopIsAskedFor) {
  const auto stopped = [&] {  // in a process of its own: a request stays
    RequestStop();
    const auto selected = Select(data_, {.tasks = {"pick"}});
    const auto deleted = DeleteEpisodes(data_, {1});
    std::fputs((selected.error().message + "; " + deleted.error().message).c_str(), stderr);
    std::_Exit(7);
  };
  EXPECT_EXIT(stopped(), testing::ExitedWithCode(7), "stopped; nothing.*stopped; nothing");
  EXPECT_EQ(List(data_).size(), 10u);
}

// on a full disk one deletes, and what was to be deleted could not be written down
TEST_F(Edit, ADeletionOnAFullDiskMakesItsOwnRoom) {
  const SmallDisk disk(folder_ / "disk", "8m");
  if (!disk.mounted()) GTEST_SKIP() << "a small tmpfs needs root";
  const Path data = folder_ / "disk/data";
  {
    auto writer = DatasetWriter::Open(data, spec_);
    ASSERT_THAT(writer, IsOk());
    for (std::uint64_t i = 0; i < 4; ++i) ASSERT_THAT(writer->Commit(MakeSyntheticEpisode(spec_, i, 400)), IsOk());
    ASSERT_THAT(writer->WriteMaster(), IsOk());
  }
  std::ofstream ballast(folder_ / "disk/ballast", std::ios::binary);
  const std::string block(4096, 'x');
  while (ballast.write(block.data(), static_cast<std::streamsize>(block.size())).flush()) {
  }
  ASSERT_THAT(WriteFileAtomically(data / "more", std::string(8192, 'x')), HasCode(Code::kUnavailable));
  ASSERT_THAT(DeleteEpisodes(data, {1, 3}), IsOk());
  EXPECT_THAT(List(data), ElementsAre(0, 2));
  ExpectSound(data, 2);
}

// before, the first episode was removed all the same, and made no room: its bytes had another name
TEST_F(Edit, ADeletionOnAFullDiskTakesNothingWhereItMakesNoRoom) {
  const SmallDisk disk(folder_ / "disk", "8m");
  if (!disk.mounted()) GTEST_SKIP() << "a small tmpfs needs root";
  const Path data = folder_ / "disk/data", copy = folder_ / "disk/copy";
  {
    auto writer = DatasetWriter::Open(data, spec_);
    ASSERT_THAT(writer, IsOk());
    for (std::uint64_t i = 0; i < 4; ++i) ASSERT_THAT(writer->Commit(MakeSyntheticEpisode(spec_, i, 400)), IsOk());
    ASSERT_THAT(writer->WriteMaster(), IsOk());
  }
  ASSERT_THAT(CopyEpisodes(data, {0, 1, 2, 3}, copy, Leftover::kRefuse), IsOk());
  std::ofstream ballast(folder_ / "disk/ballast", std::ios::binary);
  const std::string block(4096, 'x');
  while (ballast.write(block.data(), static_cast<std::streamsize>(block.size())).flush()) {
  }
  ASSERT_THAT(WriteFileAtomically(copy / "more", std::string(8192, 'x')), HasCode(Code::kUnavailable));
  EXPECT_THAT(DeleteEpisodes(copy, {1, 3}), HasCode(Code::kUnavailable));
  EXPECT_THAT(List(copy), ElementsAre(0, 1, 2, 3));
}

// two master files had no room, and neither that deletion nor any other ever ended
TEST_F(Edit, ADeletionEndsWhereASecondMasterFileHasNoRoom) {
  const SmallDisk disk(folder_ / "disk", "8m");
  if (!disk.mounted()) GTEST_SKIP() << "a small tmpfs needs root";
  const Path data = folder_ / "disk/data", copy = folder_ / "disk/copy";
  {
    auto writer = DatasetWriter::Open(data, spec_);
    ASSERT_THAT(writer, IsOk());
    for (std::uint64_t i = 0; i < 4; ++i) ASSERT_THAT(writer->Commit(MakeSyntheticEpisode(spec_, i, 400)), IsOk());
    ASSERT_THAT(writer->WriteMaster(), IsOk());
  }
  ASSERT_THAT(CopyEpisodes(data, {0, 1, 2, 3}, copy, Leftover::kRefuse), IsOk());
  std::string keys = "{";  // which the master file lists, too
  for (int n = 0; n < 200; ++n) keys += fmt::format("{}\"key{}\": [0, 2]", n == 0 ? "" : ",", n);
  ASSERT_THAT(WriteFileAtomically(copy / "filters.json", keys + "}"), IsOk());
  ASSERT_THAT(internal::RefreshDerived(copy), IsOk());
  const Path full = folder_ / "disk/ballast";
  std::ofstream ballast(full, std::ios::binary);
  const std::string block(4096, 'x');
  while (ballast.write(block.data(), static_cast<std::streamsize>(block.size())).flush()) {
  }
  const auto size = std::filesystem::file_size(full);
  ASSERT_GT(std::filesystem::file_size(copy / "dataset.hdf5"), 10 * 4096);
  std::filesystem::resize_file(full, size - 8 * 4096);

  EXPECT_THAT(DeleteEpisodes(copy, {1, 3}), IsOk());

  EXPECT_THAT(List(copy), ElementsAre(0, 2));
}

TEST_F(Edit, EndsADeletionThatWasInterrupted) {
  ASSERT_THAT(WriteFileAtomically(data_ / "deleting.json", std::string_view("[2, 5]")), IsOk());
  std::filesystem::remove(EpisodePath(data_, 2));  // so far it came

  { ASSERT_THAT(DatasetWriter::Open(data_, spec_), IsOk()); }

  const auto statistics = OrderedJson::parse(*ReadTextFile(data_ / "dataset.json"))["statistics"];
  EXPECT_EQ(statistics["episodes"], 8) << "what is derived no longer tells of them";

  EXPECT_EQ(List(data_).size(), 8u);
  EXPECT_FALSE(std::filesystem::exists(EpisodePath(data_, 5)));
  EXPECT_FALSE(std::filesystem::exists(data_ / "deleting.json"));
}

TEST_F(Edit, AFilterKeyIsOfWhatADeletionLeaves) {
  ASSERT_THAT(WriteFileAtomically(data_ / "deleting.json", std::string_view("[2, 5]")), IsOk());

  EXPECT_THAT(WriteFilterKey(data_, "keep", {1, 2}), MessageHas("no episode 2"));

  EXPECT_EQ(List(data_).size(), 8u);
}

TEST_F(Edit, IsRefusedWhileACollectorWrites) {
  const auto writer = DatasetWriter::Open(data_, spec_);
  ASSERT_THAT(writer, IsOk());

  EXPECT_THAT(DeleteEpisodes(data_, {1}), HasCode(Code::kUnavailable));
  EXPECT_THAT(WriteFilterKey(data_, "keep", {1}), MessageHas("being written by another process"));
  EXPECT_EQ(List(data_).size(), 10u);
  EXPECT_THAT(CopyEpisodes(data_, {1}, folder_ / "one", Leftover::kRefuse), IsOk());  // reading is free
}

TEST_F(Edit, FilterKeysHaveNamesOfTheirOwn) {
  EXPECT_THAT(WriteFilterKey(data_, "train", {1}), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(WriteFilterKey(data_, "lang_0000", {1}), MessageHas("sentences of an exported file"));
  EXPECT_THAT(WriteFilterKey(data_, "pick", {1}), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(WriteFilterKey(data_, "../x", {1}), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(WriteFilterKey(data_, "keep", {77}), MessageHas("no episode 77"));
  ASSERT_THAT(WriteFilterKey(data_, "keep", {1, 2}), IsOk());
  EXPECT_THAT(*Select(data_, {.keys = {"keep"}}), ElementsAre(1, 2));
  ASSERT_THAT(WriteFilterKey(data_, "keep", {}), IsOk());  // none: it goes
  EXPECT_TRUE(ReadFilterKeys(data_)->empty());
}

TEST_F(Edit, AKeyWithoutEpisodesIsRemovedWhateverItIsCalled) {
  ASSERT_THAT(internal::WriteFilterKeys(data_, {{"lang_3", {1}}, {"keep", {2}}}), IsOk());
  EXPECT_THAT(WriteFilterKey(data_, "lang_3", {}), IsOk());
  EXPECT_EQ(*ReadFilterKeys(data_), (FilterKeys{{"keep", {2}}}));
}

TEST_F(Edit, WhoeverWritesTheDatasetGivesFilterKeysItself) {
  auto writer = DatasetWriter::Open(data_, spec_);
  ASSERT_THAT(writer, IsOk());
  ASSERT_THAT(writer->WriteFilterKey("handpicked", {1, 4}), IsOk());
  EXPECT_EQ(*ReadFilterKeys(data_), (FilterKeys{{"handpicked", {1, 4}}}));
  EXPECT_NE(ReadTextFile(data_ / "dataset.hdf5")->find("handpicked"), std::string::npos) << "the master file has it";

  EXPECT_THAT(writer->WriteFilterKey("handpicked", {1, 77}), MessageHas("no episode 77"));
  EXPECT_THAT(writer->WriteFilterKey("train", {1}), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(writer->WriteFilterKey("../x", {1}), HasCode(Code::kInvalidArgument));
  EXPECT_EQ(*ReadFilterKeys(data_), (FilterKeys{{"handpicked", {1, 4}}})) << "as it was";
  ASSERT_THAT(writer->WriteFilterKey("handpicked", {}), IsOk());
  EXPECT_TRUE(ReadFilterKeys(data_)->empty());
}

TEST(Indices, AreSpansInATextAndBack) {
  const std::set<std::uint64_t> indices{0, 1, 2, 3, 7, 9, 10};
  EXPECT_EQ(IndicesText(indices), "0-3,7,9-10");
  EXPECT_EQ(*ParseIndices("0-3,7,9-10"), indices);
  EXPECT_EQ(*ParseIndices("9-10,7,0-3,2"), indices) << "in any order, and twice";
  EXPECT_TRUE(ParseIndices("")->empty());
  EXPECT_EQ(IndicesText({}), "");
  const std::uint64_t last = std::numeric_limits<std::uint64_t>::max();
  EXPECT_EQ(*ParseIndices(IndicesText({last - 1, last})), (std::set<std::uint64_t>{last - 1, last}));
  for (const char* text : {"3-1", "x", "1,,2", "1;2", "-1", "1-", " 1", "18446744073709551616"})
    EXPECT_THAT(ParseIndices(text), HasCode(Code::kInvalidArgument)) << text;
  EXPECT_THAT(ParseIndices("0-9", 10), IsOk());
  EXPECT_THAT(ParseIndices("0-10", 10), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(ParseIndices("0-5,10-15", 10), HasCode(Code::kInvalidArgument));
}

TEST_F(Edit, SaysWhatIsWrongWithDamagedFiles) {
  for (const char* text : {"[1]", "{\"a\": 1}", "{\"a\": [-1]}", "{\"A b\": [1]}", "{"}) {
    ASSERT_THAT(WriteFileAtomically(data_ / "filters.json", std::string_view(text)), IsOk());
    EXPECT_THAT(ReadFilterKeys(data_), HasCode(Code::kCorrupt)) << text;
  }
  { EXPECT_THAT(DatasetWriter::Open(data_, spec_)->WriteMaster(), IsOk()); }  // collection goes on all the same
  std::filesystem::remove(data_ / "filters.json");
  ASSERT_THAT(WriteFileAtomically(data_ / "deleting.json", std::string_view("{\"a\": 1}")), IsOk());
  EXPECT_THAT(DeleteEpisodes(data_, {1}), HasCode(Code::kCorrupt));
  EXPECT_EQ(List(data_).size(), 10u);
}

TEST_F(Edit, GroupsByWhatEpisodesSay) {
  const auto groups = GroupEpisodes(data_, "task");
  ASSERT_THAT(groups, IsOk());
  std::size_t total = 0;
  for (const auto& [name, indices] : *groups) {
    EXPECT_TRUE(IsPlainName(name)) << name;
    total += indices.size();
  }
  EXPECT_EQ(total, 10u);
  EXPECT_THAT(GroupEpisodes(data_, "colour"), HasCode(Code::kInvalidArgument));
}

// the files of two folders may have one name, and are two robots all the same
TEST_F(Edit, GroupsOfFilesOfOneNameAreApart) {
  const Path mixed = data_.parent_path() / "mixed";
  {
    auto writer = DatasetWriter::Open(mixed, spec_);
    ASSERT_THAT(writer, IsOk());
    for (std::uint64_t i = 0; i < 4; ++i) {
      Episode episode = MakeSyntheticEpisode(spec_, i, 10);
      episode.robot = i < 3 ? "here/arm.yaml" : "there/arm.yaml";
      ASSERT_THAT(writer->Commit(episode), IsOk());
    }
  }
  const auto groups = GroupEpisodes(mixed, "robot");
  ASSERT_THAT(groups, IsOk());
  EXPECT_THAT(groups->at("arm"), ElementsAre(0, 1, 2));
  EXPECT_THAT(groups->at("arm_2"), ElementsAre(3));
}

TEST_F(Edit, DealsShares) {
  const auto parts = DealEpisodes(data_, {{"a", 0.8}, {"b", 0.2}});
  ASSERT_THAT(parts, IsOk());
  EXPECT_EQ(parts->at("a").size(), 8u);
  EXPECT_EQ(parts->at("b").size(), 2u);
  std::set<std::uint64_t> all(parts->at("a").begin(), parts->at("a").end());
  all.insert(parts->at("b").begin(), parts->at("b").end());
  EXPECT_EQ(all.size(), 10u);
  EXPECT_EQ(*DealEpisodes(data_, {{"a", 0.8}, {"b", 0.2}}), *parts);
  EXPECT_THAT(DealEpisodes(data_, {{"a", 0.8}, {"a", 0.2}}), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(DealEpisodes(data_, {{"a", -1}}), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(DealEpisodes(data_, {{"../a", 1}}), HasCode(Code::kInvalidArgument));
  // before, their sum was no number, and the episodes' places in it neither
  EXPECT_THAT(DealEpisodes(data_, {{"a", 1e308}, {"b", 1e308}}), MessageHas("add up"));
  EXPECT_THAT(DealEpisodes(data_, {{"a", 1e308}}), MessageHas("add up")) << "ten times as much";
}

}  // namespace edit_test
}  // namespace etude::store
