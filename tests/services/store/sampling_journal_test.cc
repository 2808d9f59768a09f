// SPDX-License-Identifier: Apache-2.0
// Tests services/store/sampling_journal.cc, and what verify, hash and info make of it
#include "services/store/sampling_journal.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <optional>

#include "services/spec/episode_plan.h"
#include "services/store/dataset.h"
#include "tests/support/matchers.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude::store {
namespace sampling_journal_test {

constexpr char kRun[] = "0123456789abcdef";

CampaignSpec Adaptive() {
  CampaignSpec spec = SyntheticSpec(24, 24);
  spec.adaptive_sampling = {.share = 0.5, .largest_ratio = 3, .every = 10};
  return spec;
}

SamplingEntry Entry(const CampaignSpec& spec, std::uint64_t from, const std::string& object) {
  return {.from_index = from,
          .run = kRun,
          .step = 5,
          .weights = WeightsFor({{"pick", object, 3, 9, 2}, {"push", "milk", 4, 9, 1}}, spec)};
}

class Journal : public testing::Test {
 protected:
  SamplingJournal Open() {
    auto journal = SamplingJournal::Open(folder_.path(), spec_);
    EXPECT_THAT(journal, IsOk());
    return std::move(*journal);
  }
  void Write(const std::string& text) { ASSERT_THAT(WriteFileAtomically(file_, text), IsOk()); }

  TemporaryFolder folder_;
  const Path file_ = folder_ / "sampling.jsonl";
  const CampaignSpec spec_ = Adaptive();
};

TEST_F(Journal, IsEmptyWhereThereIsNone) {
  const SamplingJournal journal = Open();
  EXPECT_TRUE(journal.entries().empty());
  EXPECT_TRUE(journal.At(0).empty());
  EXPECT_EQ(journal.EntryAt(1'000'000), nullptr);
  EXPECT_EQ(journal.next_from(), 10u);
}

TEST_F(Journal, HoldsFromEachEntryOnAndIsTheSameWhenReadAgain) {
  SamplingJournal journal = Open();
  const SamplingEntry first = Entry(spec_, 12, "cube"), second = Entry(spec_, 22, "coke");
  ASSERT_THAT(journal.Append(first), IsOk());
  EXPECT_EQ(journal.next_from(), 22u);
  const std::string before = ReadTextFile(file_).value();
  ASSERT_THAT(journal.Append(second), IsOk());
  EXPECT_TRUE(ReadTextFile(file_).value().starts_with(before)) << "lines are only added";

  const SamplingJournal again = Open();
  EXPECT_EQ(again.entries(), journal.entries());
  for (const SamplingJournal* one : std::initializer_list<const SamplingJournal*>{&journal, &again}) {
    EXPECT_TRUE(one->At(11).empty());
    EXPECT_EQ(one->At(12), first.weights);
    EXPECT_EQ(one->At(21), first.weights);
    EXPECT_EQ(one->At(22), second.weights);
    EXPECT_EQ(one->At(std::numeric_limits<std::uint64_t>::max()), second.weights);
    EXPECT_EQ(one->At(0), SamplingWeights()) << "in any order";
    EXPECT_EQ(one->EntryAt(15)->from_index, 12u);
  }
}

TEST_F(Journal, RefusesWhatIsTooSoonOrOutOfBounds) {
  SamplingJournal journal = Open();
  EXPECT_THAT(journal.Append(Entry(spec_, 9, "cube")), HasCode(Code::kInvalidArgument));
  ASSERT_THAT(journal.Append(Entry(spec_, 10, "cube")), IsOk());
  const std::string before = ReadTextFile(file_).value();
  EXPECT_THAT(journal.Append(Entry(spec_, 19, "coke")), MessageHas("from episode 19, before 20"));
  SamplingEntry wild = Entry(spec_, 20, "coke");
  wild.weights.places[0] = 5;
  EXPECT_THAT(journal.Append(wild), MessageHas("5 not in"));
  EXPECT_EQ(journal.entries().size(), 1u);
  EXPECT_EQ(ReadTextFile(file_).value(), before);
}

TEST_F(Journal, AFailedEntryDoesNotHoldAndIsReplacedByTheNext) {
  SamplingJournal journal = Open();
  ASSERT_THAT(MakeFolders(file_ / "in its place"), IsOk());
  EXPECT_FALSE(journal.Append(Entry(spec_, 10, "cube")));
  EXPECT_TRUE(journal.At(10).empty());
  std::filesystem::remove_all(file_);
  ASSERT_THAT(journal.Append(Entry(spec_, 11, "coke")), IsOk());
  EXPECT_EQ(Open().entries(), std::vector<SamplingEntry>{Entry(spec_, 11, "coke")});
}

TEST_F(Journal, EndsAtItsBound) {
  SamplingJournal journal = Open();
  std::string text;
  for (std::size_t i = 1; i <= SamplingJournal::kMostEntries; ++i)
    text += ToJson(Entry(spec_, 10 * i, "cube")).dump() + "\n";
  Write(text);
  journal = Open();
  EXPECT_EQ(journal.entries().size(), SamplingJournal::kMostEntries);
  EXPECT_EQ(journal.next_from(), std::numeric_limits<std::uint64_t>::max());
}

TEST_F(Journal, RefusesAFileThatItDoesNotUnderstand) {
  const std::string good = ToJson(Entry(spec_, 10, "cube")).dump() + "\n";
  SamplingEntry wild = Entry(spec_, 20, "cube");
  wild.weights.tasks["pick"] = 2;
  for (const std::string& bad :
       {std::string("\n"), std::string("{}\n"), std::string("[]\n"), std::string("not json\n"), good,
        good.substr(0, good.size() / 2), ToJson(wild).dump() + "\n", std::string("{\"from_index\": -1}\n")}) {
    Write(good + bad);
    const auto journal = SamplingJournal::Open(folder_.path(), spec_);
    EXPECT_THAT(journal, HasCode(Code::kCorrupt)) << bad;
    EXPECT_THAT(journal, MessageHas("line 2")) << bad;
  }
  Write(good);
  EXPECT_EQ(Open().entries().size(), 1u);
  CampaignSpec off = spec_;
  off.adaptive_sampling = {};
  EXPECT_THAT(SamplingJournal::Open(folder_.path(), off), HasCode(Code::kCorrupt));
}

// A dataset of 15 episodes with weights from episode 10 on; episode `without` does not say so.
void MakeDataset(const Path& path, const CampaignSpec& spec, const std::optional<SamplingEntry>& entry,
                 std::optional<std::uint64_t> without = {}) {
  auto writer = DatasetWriter::Open(path, spec);
  ASSERT_THAT(writer, IsOk());
  auto journal = SamplingJournal::Open(path, spec);
  ASSERT_THAT(journal, IsOk());
  if (entry) {
    ASSERT_THAT(journal->Append(*entry), IsOk());
  }
  for (std::uint64_t i = 0; i < 15; ++i) {
    Episode episode = MakeSyntheticEpisode(spec, i, 20);
    const EpisodePlan plan = PlanEpisode(spec, i, 0, journal->At(i));
    if (!plan.weights_sha256.empty() && without != i) episode.details["sampling"] = SamplingDetails(plan);
    ASSERT_THAT(writer->Commit(episode), IsOk());
  }
  ASSERT_THAT(writer->WriteMaster(), IsOk());
}

TEST(SampledDataset, VerifiesAgainstItsJournal) {
  const TemporaryFolder folder;
  const CampaignSpec spec = Adaptive();
  MakeDataset(folder / "good", spec, Entry(spec, 10, "cube"));
  MakeDataset(folder / "bad", spec, Entry(spec, 10, "cube"), 12);

  const auto good = Verify(folder / "good", Quarantine::kNo), bad = Verify(folder / "bad", Quarantine::kNo);
  ASSERT_THAT(good, IsOk());
  EXPECT_EQ(good->good, 15u);
  ASSERT_THAT(bad, IsOk());
  EXPECT_EQ(bad->good, 14u);
  ASSERT_EQ(bad->bad.size(), 1u);
  EXPECT_EQ(bad->bad[0].path, EpisodePath(folder / "bad", 12));
  EXPECT_THAT(bad->bad[0].reason, testing::HasSubstr("other sampling weights"));

  std::filesystem::remove(folder / "good/sampling.jsonl");
  // what nothing tells of may be good: it is said, and not moved away
  const auto without = Verify(folder / "good", Quarantine::kYes);
  ASSERT_THAT(without, IsOk());
  EXPECT_EQ(without->good, 10u);
  EXPECT_TRUE(without->bad.empty());
  ASSERT_EQ(without->unread.size(), 5u);
  EXPECT_THAT(without->unread[0].reason, testing::HasSubstr("sampling.jsonl"));
  EXPECT_FALSE(std::filesystem::exists(folder / "good/quarantine"));
}

TEST(SampledDataset, TheHashIsOfEpisodesAndOfWhatMakesThem) {
  const TemporaryFolder folder;
  const CampaignSpec spec = Adaptive();
  SamplingEntry entry = Entry(spec, 10, "cube");
  MakeDataset(folder / "a", spec, entry);
  entry.run = "fedcba9876543210";
  entry.step = 6;
  MakeDataset(folder / "b", spec, entry);
  EXPECT_EQ(HashDataset(folder / "a").value(), HashDataset(folder / "b").value()) << "who asked does not matter";

  auto journal = SamplingJournal::Open(folder / "b", spec);
  ASSERT_THAT(journal, IsOk());
  ASSERT_THAT(journal->Append(Entry(spec, 20, "coke")), IsOk());
  EXPECT_NE(HashDataset(folder / "a").value(), HashDataset(folder / "b").value()) << "further episodes will differ";
}

TEST(SampledDataset, InfoShowsTheWeightsWhereThereAreSome) {
  const TemporaryFolder folder;
  const CampaignSpec spec = Adaptive();
  MakeDataset(folder / "none", spec, std::nullopt);
  EXPECT_FALSE(DatasetInfo(folder / "none").value().contains("sampling"));
  const SamplingEntry entry = Entry(spec, 10, "cube");
  MakeDataset(folder / "d", spec, entry);
  const auto info = DatasetInfo(folder / "d");
  ASSERT_THAT(info, IsOk());
  ASSERT_EQ((*info)["sampling"].size(), 1u);
  EXPECT_EQ((*info)["sampling"][0]["from_index"], 10u);
  EXPECT_EQ((*info)["sampling"][0]["run"], kRun);
  EXPECT_EQ((*info)["sampling"][0]["weights"]["objects"]["cube"], entry.weights.objects.at("cube"));
}

TEST(SampledDataset, BeginsInAFolderThatHasAJournalAndNothingElse) {
  const TemporaryFolder folder;
  const CampaignSpec spec = Adaptive();
  MakeDataset(folder / "a", spec, Entry(spec, 10, "cube"));
  ASSERT_THAT(MakeFolders(folder / "b"), IsOk());
  std::filesystem::copy_file(folder / "a/sampling.jsonl", folder / "b/sampling.jsonl");
  MakeDataset(folder / "b", spec, std::nullopt);
  EXPECT_EQ(HashDataset(folder / "a").value(), HashDataset(folder / "b").value());
}

TEST(SampledDataset, IsNotGoneOnWithUnderAnotherSplit) {
  const TemporaryFolder folder;
  const CampaignSpec spec = Adaptive();
  MakeDataset(folder / "d", spec, std::nullopt);
  CampaignSpec other = spec;
  other.split.train = 0.5;
  EXPECT_THAT(DatasetWriter::Open(folder / "d", other), MessageHas("split.train (0.9, now 0.5)"));
  other = spec;
  other.episodes += 10;
  EXPECT_THAT(DatasetWriter::Open(folder / "d", other), IsOk());
}

}  // namespace sampling_journal_test
}  // namespace etude::store
