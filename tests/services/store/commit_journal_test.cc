// SPDX-License-Identifier: Apache-2.0
// Tests services/store/commit_journal.cc, and services/store/dataset_writer.cc where it keeps the journal
#include "services/store/commit_journal.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "services/core/clock.h"
#include "services/store/dataset.h"
#include "tests/support/matchers.h"
#include "tests/support/replace_in_file.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude::store {
namespace commit_journal_test {

const CommitFacts kFacts{"lab-7-w0", "lab-7", "0123456789ab", {.plan_s = 0.5, .step_s = 0.25, .wall_s = 1.5}};

void CommitTo(const Path& dataset, const std::vector<std::uint64_t>& indices) {
  auto writer = DatasetWriter::Open(dataset, SyntheticSpec());
  ASSERT_THAT(writer, IsOk());
  for (const auto index : indices)
    ASSERT_THAT(writer->Commit(MakeSyntheticEpisode(SyntheticSpec(), index), kFacts), IsOk());
}

std::string Journal(const Path& dataset) { return ReadTextFile(dataset / "commits.jsonl").value_or("none"); }

TEST(CommitJournal, HasWhatTheFileSaysAndWhoMadeIt) {
  const TemporaryFolder folder;
  const double before = WallSeconds();
  CommitTo(folder.path(), {3, 1});

  CommitTable table(folder.path());
  ASSERT_THAT(table.Refresh(), IsOk());

  EXPECT_THAT(table.index(), testing::ElementsAre(3, 1)) << "in the order of the commits";
  const std::size_t row = table.RowOfIndex(1);
  ASSERT_EQ(row, 1u);
  const Episode episode = MakeSyntheticEpisode(SyntheticSpec(), 1);
  EXPECT_EQ(table.bytes()[row], std::filesystem::file_size(EpisodePath(folder.path(), 1)));
  EXPECT_EQ(table.steps()[row], 50u);
  EXPECT_EQ(table.frames()[row], 10u);
  EXPECT_NEAR(table.t()[row], before, 60);
  EXPECT_EQ(table.task().At(row), episode.task);
  EXPECT_EQ(table.target().At(row), episode.target);
  EXPECT_EQ(table.robot().At(row), episode.robot);
  EXPECT_EQ(table.instruction().At(row), episode.instruction);
  EXPECT_EQ(table.outcome().At(row), "success");
  EXPECT_EQ(table.worker().At(row), "lab-7-w0");
  EXPECT_EQ(table.host().words(), std::vector<std::string>{"lab-7"});
  EXPECT_EQ(table.fingerprint().words(), std::vector<std::string>{"0123456789ab"});
  EXPECT_EQ(table.timings()[row], kFacts.timings);
  EXPECT_GT(table.path_m()[row], 0);
  EXPECT_GT(table.jerk()[row], 0);
  const CommitRow said = RowOf(episode, 0, 0);
  ASSERT_TRUE(said.place_m);
  ASSERT_TRUE(table.Row(row).place_m);
  EXPECT_NEAR(table.Row(row).place_m->at(1), said.place_m->at(1), 1e-6);
  EXPECT_NEAR(table.Row(row).joint_speed, said.joint_speed, 1e-6);
}

TEST(CommitJournal, NothingOfItEntersTheEpisode) {
  const TemporaryFolder folder;
  CommitTo(folder / "told", {0});
  {
    auto writer = DatasetWriter::Open(folder / "untold", SyntheticSpec());
    ASSERT_THAT(writer, IsOk());
    ASSERT_THAT(writer->Commit(MakeSyntheticEpisode(SyntheticSpec(), 0)), IsOk());
  }
  EXPECT_EQ(*ReadBinaryFile(EpisodePath(folder / "told", 0)), *ReadBinaryFile(EpisodePath(folder / "untold", 0)));
  EXPECT_EQ(*HashDataset(folder / "told"), *HashDataset(folder / "untold"));
}

TEST(CommitJournal, MeasuresTheHand) {
  Episode episode = MakeSyntheticEpisode(SyntheticSpec(), 0);
  episode.eef_pos = Track{3, {}};
  // a cubic along x: its third difference is constant, 6 a h^3
  for (int t = 0; t < 101; ++t) {
    const double s = t * 0.008;
    episode.eef_pos.Push(std::vector<float>{static_cast<float>(s * s * s), 0.f, 0.f});
  }
  const CommitRow row = RowOf(episode, 0, 0);
  EXPECT_NEAR(row.path_m, 0.8 * 0.8 * 0.8, 1e-6);
  EXPECT_NEAR(row.jerk, 6, 0.05);
  EXPECT_EQ(row.draws, 0u);

  episode.details["scene"] = {{"draws", 4}};
  EXPECT_EQ(RowOf(episode, 0, 0).draws, 0u) << "a signed number is none of ours";
  episode.details["scene"] = {{"draws", 4u}};
  EXPECT_EQ(RowOf(episode, 0, 0).draws, 4u);
}

TEST(CommitJournal, IsMadeAgainFromTheFilesWhenItIsGone) {
  const TemporaryFolder folder;
  CommitTo(folder.path(), {0, 1, 2});
  CommitTable before(folder.path());
  ASSERT_THAT(before.Refresh(), IsOk());
  std::filesystem::remove(folder / "commits.jsonl");

  auto writer = DatasetWriter::Open(folder.path(), SyntheticSpec());
  ASSERT_THAT(writer, IsOk());
  ASSERT_THAT(writer->WriteMaster(), IsOk());

  CommitTable after(folder.path());
  ASSERT_THAT(after.Refresh(), IsOk());
  ASSERT_EQ(after.size(), 3u);
  for (std::uint64_t index = 0; index < 3; ++index) {
    CommitRow was = before.Row(before.RowOfIndex(index)), is = after.Row(after.RowOfIndex(index));
    EXPECT_NEAR(is.t, was.t, 60) << "of the file";
    EXPECT_EQ(is.facts.worker, "") << "the files do not say who made them";
    is.t = was.t;
    is.facts = was.facts;
    EXPECT_EQ(LineOf(is), LineOf(was));
  }
}

TEST(CommitJournal, DropsWhatIsTornDoubledOrOfAFileThatIsNotThere) {
  const TemporaryFolder folder;
  CommitTo(folder.path(), {0, 1, 2});
  const std::string whole = Journal(folder.path());
  const std::string first = whole.substr(0, whole.find('\n') + 1);
  std::filesystem::remove(EpisodePath(folder.path(), 2));
  std::ofstream(folder / "commits.jsonl", std::ios::app) << first << "not json\n"
                                                         << "{\"index\": 1, \"byt";

  CommitTo(folder.path(), {3});

  CommitTable table(folder.path());
  ASSERT_THAT(table.Refresh(), IsOk());
  EXPECT_THAT(table.index(), testing::ElementsAre(0, 1, 3));
  EXPECT_EQ(table.unread_lines(), 0u);
}

TEST(CommitJournal, ALineOfAnotherFileOfTheSameIndexDoesNotStand) {
  const TemporaryFolder folder;
  CommitTo(folder.path(), {0});
  ReplaceInFile(folder / "commits.jsonl", "\"bytes\":", "\"bytes\":1");

  auto writer = DatasetWriter::Open(folder.path(), SyntheticSpec());
  ASSERT_THAT(writer, IsOk());
  EXPECT_EQ(Journal(folder.path()), "");
  ASSERT_THAT(writer->WriteMaster(), IsOk());

  CommitTable table(folder.path());
  ASSERT_THAT(table.Refresh(), IsOk());
  ASSERT_EQ(table.size(), 1u);
  EXPECT_EQ(table.bytes()[0], std::filesystem::file_size(EpisodePath(folder.path(), 0)));
}

TEST(CommitJournal, ALineOfAnOlderProgramHasNoPlace) {
  const auto row = ParseCommitLine(R"({"index": 3, "path_m": 0.5})");
  ASSERT_THAT(row, IsOk());
  EXPECT_FALSE(row->place_m);
  EXPECT_EQ(row->joint_speed, 0);
  EXPECT_EQ(LineOf(*row).find("place_m"), std::string::npos);
  EXPECT_THAT(ParseCommitLine(R"({"index": 3, "place_m": [1]})"), HasCode(Code::kCorrupt));
}

TEST(CommitTable, FollowsAJournalThatGrows) {
  const TemporaryFolder folder;
  CommitTable table(folder.path());
  EXPECT_FALSE(*table.Refresh()) << "no file, no rows";
  CommitTo(folder.path(), {0});
  EXPECT_TRUE(*table.Refresh());
  EXPECT_FALSE(*table.Refresh());
  const auto generation = table.generation();

  CommitRow row;
  row.index = 7;
  const std::string line = LineOf(row);
  std::ofstream(folder / "commits.jsonl", std::ios::app) << line.substr(0, 20) << std::flush;
  EXPECT_FALSE(*table.Refresh()) << "half a line waits";
  std::ofstream(folder / "commits.jsonl", std::ios::app) << line.substr(20) << "\n";
  EXPECT_TRUE(*table.Refresh());
  EXPECT_THAT(table.index(), testing::ElementsAre(0, 7));
  EXPECT_EQ(table.generation(), generation);

  // the same index again takes the first one's place
  row.attempt = 2;
  std::ofstream(folder / "commits.jsonl", std::ios::app) << LineOf(row) << "\n";
  EXPECT_TRUE(*table.Refresh());
  EXPECT_THAT(table.index(), testing::ElementsAre(0, 7));
  EXPECT_EQ(table.attempt()[1], 2u);

  ASSERT_THAT(WriteFileAtomically(folder / "commits.jsonl", LineOf(row) + "\n"), IsOk());
  EXPECT_TRUE(*table.Refresh());
  EXPECT_THAT(table.index(), testing::ElementsAre(7));
  EXPECT_GT(table.generation(), generation);

  // made anew in the same place, and longer already
  CommitRow other;
  std::string lines;
  for (other.index = 20; other.index < 23; ++other.index) lines += LineOf(other) + "\n";
  std::ofstream(folder / "commits.jsonl", std::ios::trunc) << lines << std::flush;
  EXPECT_TRUE(*table.Refresh());
  EXPECT_THAT(table.index(), testing::ElementsAre(20, 21, 22));

  std::filesystem::remove(folder / "commits.jsonl");
  EXPECT_TRUE(*table.Refresh());
  EXPECT_EQ(table.size(), 0u);
}

TEST(CommitTable, ItsMemoryHasABoundWhateverTheFileHolds) {
  const TemporaryFolder folder;
  std::ofstream file(folder / "commits.jsonl");
  CommitRow row;
  row.instruction = std::string(2 * WordColumn::kLongestWord, 'x');
  for (row.index = 0; row.index < 5; ++row.index) file << LineOf(row) << "\n";
  file << std::string(1 << 20, '[') << "\n"
       << "{\"index\": -1}\n"
       << "{\"index\": 1, \"t\": \"now\"}\n"
       << "[1]\n";
  file.close();

  CommitTable table(folder.path(), 3);
  ASSERT_THAT(table.Refresh(), IsOk());

  EXPECT_EQ(table.size(), 3u);
  EXPECT_EQ(table.unread_lines(), 2u + 4u);
  EXPECT_EQ(table.instruction().words(), std::vector<std::string>{"…"});
}

TEST(CommitLine, KeysThatAreMissingKeepTheirDefaults) {
  const auto row =
      ParseCommitLine(R"({"index": 4, "later": [1], "timings": {"plan_s": -1, "step_s": "x", "wall_s": 2}})");
  ASSERT_THAT(row, IsOk());
  EXPECT_EQ(row->index, 4u);
  EXPECT_EQ(row->facts.timings.plan_s, 0);
  EXPECT_EQ(row->facts.timings.step_s, 0);
  EXPECT_EQ(row->facts.timings.wall_s, 2);
  EXPECT_THAT(ParseCommitLine("{}"), HasCode(Code::kCorrupt));
  EXPECT_THAT(ParseCommitLine(R"({"index": 1, "attempt": 99999999999})"), HasCode(Code::kCorrupt));
}

}  // namespace commit_journal_test
}  // namespace etude::store
