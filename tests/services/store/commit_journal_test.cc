// SPDX-License-Identifier: Apache-2.0
// Tests services/store/commit_journal.cc, and services/store/dataset_writer.cc where it keeps the journal
#include "services/store/commit_journal.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <vector>

#include "services/core/clock.h"
#include "services/store/dataset.h"
#include "services/store/layout.h"
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

// What the journal says, in the order of its lines.
std::vector<CommitRow> LinesOf(const Path& dataset) {
  std::vector<CommitRow> lines;
  EXPECT_THAT(CommitTail(dataset).Refresh([] {}, [&](const CommitRow& row) { lines.push_back(row); }), IsOk());
  return lines;
}

std::vector<std::uint64_t> IndicesOf(const std::vector<CommitRow>& lines) {
  std::vector<std::uint64_t> indices;
  for (const auto& row : lines) indices.push_back(row.index);
  return indices;
}

// As whoever shows it keeps it: a line takes the place of the earlier one of its index.
class Shown {
 public:
  explicit Shown(const Path& dataset) : tail_(dataset) {}
  Result<bool> Refresh() {
    return tail_.Refresh(
        [this] {
          ++resets;
          rows.clear();
        },
        [this](const CommitRow& row) {
          ++lines;
          rows[row.index] = row;
        });
  }
  std::vector<std::uint64_t> Indices() const {
    std::vector<std::uint64_t> indices;
    for (const auto& [index, row] : rows) indices.push_back(index);
    return indices;
  }

  std::map<std::uint64_t, CommitRow> rows;
  int resets = 0, lines = 0;

 private:
  CommitTail tail_;
};

TEST(CommitJournal, HasWhatTheFileSaysAndWhoMadeIt) {
  const TemporaryFolder folder;
  const double before = WallSeconds();
  CommitTo(folder.path(), {3, 1});

  const auto lines = LinesOf(folder.path());

  ASSERT_THAT(IndicesOf(lines), testing::ElementsAre(3, 1)) << "in the order of the commits";
  const CommitRow& row = lines[1];
  const Episode episode = MakeSyntheticEpisode(SyntheticSpec(), 1);
  EXPECT_EQ(row.bytes, std::filesystem::file_size(EpisodePath(folder.path(), 1)));
  EXPECT_EQ(row.steps, 50u);
  EXPECT_EQ(row.frames, 10u);
  EXPECT_NEAR(row.t, before, 60);
  EXPECT_EQ(row.task, episode.task);
  EXPECT_EQ(row.target, episode.target);
  EXPECT_EQ(row.robot, episode.robot);
  EXPECT_EQ(row.instruction, episode.instruction);
  EXPECT_EQ(row.outcome, "success");
  for (const auto& line : lines) {
    EXPECT_EQ(line.facts.worker, "lab-7-w0");
    EXPECT_EQ(line.facts.host, "lab-7");
    EXPECT_EQ(line.facts.fingerprint, "0123456789ab");
  }
  EXPECT_EQ(row.facts.timings, kFacts.timings);
  EXPECT_GT(row.path_m, 0);
  EXPECT_GT(row.jerk, 0);
  const CommitRow said = RowOf(episode, 0, 0);
  ASSERT_TRUE(said.place_m);
  ASSERT_TRUE(row.place_m);
  EXPECT_NEAR(row.place_m->at(1), said.place_m->at(1), 1e-6);
  EXPECT_NEAR(row.joint_speed, said.joint_speed, 1e-6);
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
  Shown before(folder.path());
  ASSERT_THAT(before.Refresh(), IsOk());
  std::filesystem::remove(folder / "commits.jsonl");

  auto writer = DatasetWriter::Open(folder.path(), SyntheticSpec());
  ASSERT_THAT(writer, IsOk());
  ASSERT_THAT(writer->WriteMaster(), IsOk());

  Shown after(folder.path());
  ASSERT_THAT(after.Refresh(), IsOk());
  ASSERT_THAT(before.Indices(), testing::ElementsAre(0, 1, 2));
  ASSERT_THAT(after.Indices(), testing::ElementsAre(0, 1, 2));
  for (std::uint64_t index = 0; index < 3; ++index) {
    CommitRow was = before.rows.at(index), is = after.rows.at(index);
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

  EXPECT_THAT(IndicesOf(LinesOf(folder.path())), testing::ElementsAre(0, 1, 3));
  EXPECT_EQ(std::ranges::count(Journal(folder.path()), '\n'), 3) << "nothing that is not understood is left";
}

TEST(CommitJournal, ALineOfAnotherFileOfTheSameIndexDoesNotStand) {
  const TemporaryFolder folder;
  CommitTo(folder.path(), {0});
  ReplaceInFile(folder / "commits.jsonl", "\"bytes\":", "\"bytes\":1");

  auto writer = DatasetWriter::Open(folder.path(), SyntheticSpec());
  ASSERT_THAT(writer, IsOk());
  EXPECT_EQ(Journal(folder.path()), "");
  ASSERT_THAT(writer->WriteMaster(), IsOk());

  const auto lines = LinesOf(folder.path());
  ASSERT_EQ(lines.size(), 1u);
  EXPECT_EQ(lines[0].bytes, std::filesystem::file_size(EpisodePath(folder.path(), 0)));
}

TEST(CommitJournal, ALineOfAnOlderProgramHasNoPlace) {
  const auto row = ParseCommitLine(R"({"index": 3, "path_m": 0.5})");
  ASSERT_THAT(row, IsOk());
  EXPECT_FALSE(row->place_m);
  EXPECT_EQ(row->joint_speed, 0);
  EXPECT_EQ(LineOf(*row).find("place_m"), std::string::npos);
  EXPECT_THAT(ParseCommitLine(R"({"index": 3, "place_m": [1]})"), HasCode(Code::kCorrupt));
}

TEST(CommitTail, FollowsAJournalThatGrows) {
  const TemporaryFolder folder;
  Shown shown(folder.path());
  EXPECT_FALSE(*shown.Refresh()) << "no file, no lines";
  CommitTo(folder.path(), {0});
  EXPECT_TRUE(*shown.Refresh());
  EXPECT_FALSE(*shown.Refresh());
  const int resets = shown.resets;

  CommitRow row;
  row.index = 7;
  const std::string line = LineOf(row);
  std::ofstream(folder / "commits.jsonl", std::ios::app) << line.substr(0, 20) << std::flush;
  EXPECT_FALSE(*shown.Refresh()) << "half a line waits";
  std::ofstream(folder / "commits.jsonl", std::ios::app) << line.substr(20) << "\n";
  EXPECT_TRUE(*shown.Refresh());
  EXPECT_THAT(shown.Indices(), testing::ElementsAre(0, 7));
  EXPECT_EQ(shown.lines, 2) << "each once";

  // the same index again: the later one counts
  row.attempt = 2;
  std::ofstream(folder / "commits.jsonl", std::ios::app) << LineOf(row) << "\n";
  EXPECT_TRUE(*shown.Refresh());
  EXPECT_THAT(shown.Indices(), testing::ElementsAre(0, 7));
  EXPECT_EQ(shown.rows.at(7).attempt, 2u);
  EXPECT_EQ(shown.lines, 3);
  EXPECT_EQ(shown.resets, resets);

  ASSERT_THAT(WriteFileAtomically(folder / "commits.jsonl", LineOf(row) + "\n"), IsOk());
  EXPECT_TRUE(*shown.Refresh());
  EXPECT_THAT(shown.Indices(), testing::ElementsAre(7));
  EXPECT_EQ(shown.resets, resets + 1);

  // made anew in the same place, and longer already
  CommitRow other;
  std::string lines;
  for (other.index = 20; other.index < 23; ++other.index) lines += LineOf(other) + "\n";
  std::ofstream(folder / "commits.jsonl", std::ios::trunc) << lines << std::flush;
  EXPECT_TRUE(*shown.Refresh());
  EXPECT_THAT(shown.Indices(), testing::ElementsAre(20, 21, 22));
  EXPECT_EQ(shown.resets, resets + 2);

  std::filesystem::remove(folder / "commits.jsonl");
  EXPECT_TRUE(*shown.Refresh());
  EXPECT_TRUE(shown.rows.empty());
  EXPECT_FALSE(*shown.Refresh()) << "it has gone already";
}

TEST(CommitTail, WhatALineHoldsHasABoundWhoeverWroteTheFile) {
  const TemporaryFolder folder;
  std::ofstream file(folder / "commits.jsonl");
  CommitRow row;
  row.instruction = std::string(2 * CommitTail::kLongestText, 'x');
  row.target = std::string(CommitTail::kLongestText, 't');
  for (row.index = 0; row.index < 5; ++row.index) file << LineOf(row) << "\n";
  file << std::string(1 << 20, '[') << "\n"
       << "{\"index\": -1}\n"
       << "{\"index\": 1, \"t\": \"now\"}\n"
       << "[1]\n"
       << LineOf(row) << "\n";
  file.close();

  const auto lines = LinesOf(folder.path());

  EXPECT_THAT(IndicesOf(lines), testing::ElementsAre(0, 1, 2, 3, 4, 5)) << "what is not understood is passed over";
  for (const auto& line : lines) {
    EXPECT_EQ(line.instruction, "…");
    EXPECT_EQ(line.target, row.target);
  }
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

TEST(CommitJournal, ARestartReadsItAndNotTheEpisodes) {
  const TemporaryFolder folder;
  CommitTo(folder.path(), {0, 1, 2});
  for (const std::uint64_t index : {0, 1, 2}) {  // as long as before, and no episode any more
    const Path file = EpisodePath(folder.path(), index);
    ASSERT_THAT(WriteFileAtomically(file, std::string(std::filesystem::file_size(file), 'x')), IsOk());
  }
  auto writer = DatasetWriter::Open(folder.path(), SyntheticSpec());
  ASSERT_THAT(writer, IsOk());
  ASSERT_THAT(writer->WriteMaster(), IsOk());
  const auto read = internal::ReadDatasetFile(folder.path());
  ASSERT_THAT(read, IsOk());
  EXPECT_EQ(read->statistics["episodes"], 3u) << "whoever opened them left them out";
}

}  // namespace commit_journal_test
}  // namespace etude::store
