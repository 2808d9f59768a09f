// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/sources/dataset_source.cc
#include "dashboard/server/sources/dataset_source.h"

#include <gtest/gtest.h>

#include <fstream>

#include "services/core/clock.h"
#include "services/spec/episode_plan.h"
#include "services/store/filter_keys.h"
#include "services/store/sampling_journal.h"
#include "tests/dashboard/server/example_folders.h"
#include "tests/support/matchers.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude::sources {
namespace dataset_source_test {

Found DataOf(const ExampleFolders& lab) { return {Kind::kDataset, "data", "data", lab.root() / "data", "data", ""}; }

TEST(DatasetSource, RowsAreThereAtOnceAndFillInFromTheFiles) {
  ExampleFolders lab;
  // whoever writes datasets may also keep a journal; this is about one without
  std::filesystem::remove(lab.root() / "data" / "commits.jsonl");
  DatasetSource source(DataOf(lab));
  const auto before = source.View().value();
  ASSERT_EQ(before->rows.size(), kEpisodes);
  EXPECT_EQ(before->known, 0u);
  const CampaignSpec spec = before->info.spec;
  for (const auto& row : before->rows) {
    const auto plan = PlanEpisode(spec, row.index, 0);
    EXPECT_EQ(row.task, plan.task.text());
    EXPECT_EQ(row.target, plan.target);
    EXPECT_EQ(row.split, SplitOf(spec, row.index));
  }
  while (source.ReadNext()) {
  }
  // what was read is in the next view, which is built anew at once
  const auto after = source.View().value();
  EXPECT_EQ(after->known, kEpisodes);
  EXPECT_EQ(after->rows[0].steps, kSteps);
  EXPECT_EQ(after->rows[0].frames, (kSteps + 4) / 5);
  EXPECT_GT(after->rows[0].path_m.value_or(0), 0);
  EXPECT_TRUE(after->rows[0].place_m);
}

// every open page listed all files of all datasets twice a second, also of those that were long done
TEST(DatasetSource, EpisodesAreListedWhenTheirFoldersChange) {
  ExampleFolders lab;
  DatasetSource source(DataOf(lab), std::chrono::milliseconds(0));
  ASSERT_EQ(source.View().value()->rows.size(), kEpisodes);
  const Path part = lab.root() / "data" / "episodes" / "000";
  const auto then = std::filesystem::last_write_time(part);
  std::filesystem::copy_file(part / "000000.hdf5", part / "000999.hdf5");
  std::filesystem::last_write_time(part, then);
  const auto look = [&](double seconds, std::size_t rows) {  // files are looked at again twice a second
    auto view = source.View().value();
    for (const Stopwatch watch; view->rows.size() != rows && watch.Seconds() < seconds;) view = source.View().value();
    return view->rows.size();
  };
  EXPECT_EQ(look(0.7, kEpisodes + 1), kEpisodes) << "its folder stands still";
  std::filesystem::last_write_time(part, then + std::chrono::seconds(1));
  EXPECT_EQ(look(10, kEpisodes + 1), kEpisodes + 1);
}

TEST(DatasetSource, TheJournalSavesOpeningFilesAndTheFilesDecide) {
  ExampleFolders lab;
  std::string journal;
  for (const std::uint64_t index : {0, 1, 99})  // 99 was set aside: it has no file
    journal += OrderedJson{{"index", index},
                           {"attempt", 1},
                           {"t", 1795369600.0},
                           {"worker", "w1"},
                           {"host", "h"},
                           {"bytes", 10},
                           {"steps", 77},
                           {"frames", 16},
                           {"outcome", "success"},
                           {"task", "pick"},
                           {"target", "coke"},
                           {"robot", "ur5"},
                           {"instruction", "pick the coke"},
                           {"path_m", 0.5},
                           {"joint_speed", 1.5},
                           {"place_m", {0.25, -0.5}},
                           {"draws", 2},
                           {"timings", {{"plan_s", 0.1}}}}
                   .dump() +
               "\n";
  ASSERT_THAT(WriteFileAtomically(lab.root() / "data" / "commits.jsonl", journal), IsOk());
  DatasetSource source(DataOf(lab));
  const auto view = source.View().value();
  EXPECT_EQ(view->rows.size(), kEpisodes);
  EXPECT_EQ(view->known, 2u);
  EXPECT_EQ(view->Find(1)->steps, 77u);
  EXPECT_EQ(view->Find(1)->worker, "w1");
  EXPECT_EQ(view->Find(1)->plan_s, 0.1);
  EXPECT_EQ(view->Find(1)->joint_speed, 1.5);
  ASSERT_TRUE(view->Find(1)->place_m);
  EXPECT_EQ(view->Find(1)->place_m->at(1), -0.5);
  EXPECT_EQ(view->Find(99), nullptr);
}

// the folders of another host are seen later than its journal, whose lines are read once
TEST(DatasetSource, WhatTheJournalTellsOfAFileIsKeptUntilItIsSeen) {
  ExampleFolders lab;
  const Path file = store::EpisodePath(lab.root() / "data", 3), hidden = lab.root() / "hidden.hdf5";
  std::filesystem::rename(file, hidden);
  DatasetSource source(DataOf(lab));
  auto view = source.View().value();
  EXPECT_EQ(view->rows.size(), kEpisodes - 1);
  EXPECT_EQ(view->Find(3), nullptr);

  std::filesystem::rename(hidden, file);
  for (const Stopwatch watch; view->rows.size() != kEpisodes && watch.Seconds() < 10;) view = source.View().value();
  EXPECT_EQ(view->known, kEpisodes) << "no file was opened";
  ASSERT_NE(view->Find(3), nullptr);
  EXPECT_EQ(view->Find(3)->steps, kSteps);
}

TEST(DatasetSource, ALaterLineOfTheJournalTakesThePlaceOfAnEarlierOne) {
  ExampleFolders lab;
  DatasetSource source(DataOf(lab));
  auto view = source.View().value();
  EXPECT_EQ(view->Find(1)->attempt, 0u);
  const auto say = [&](std::uint32_t attempt) {
    store::CommitRow row;
    row.index = 1, row.attempt = attempt;
    std::ofstream(lab.root() / "data" / "commits.jsonl", std::ios::app) << store::LineOf(row) << "\n" << std::flush;
    for (const Stopwatch watch; view->Find(1)->attempt != attempt && watch.Seconds() < 10;)
      view = source.View().value();
    return view->Find(1)->attempt;
  };
  EXPECT_EQ(say(4), 4u);
  EXPECT_EQ(say(2), 2u) << "it is the last word that counts, not the largest";
  EXPECT_EQ(view->rows.size(), kEpisodes);
  EXPECT_EQ(view->known, kEpisodes);
}

TEST(DatasetSource, FailedAttemptsSayWhatTheyWereAbout) {
  ExampleFolders lab;
  DatasetSource source(DataOf(lab));
  const auto view = source.View().value();
  ASSERT_EQ(view->failures.size(), 2u);
  EXPECT_EQ(view->failures[0].outcome, "plan_failed");
  EXPECT_EQ(view->failures[0].stage, "reach");
  EXPECT_EQ(view->failures[0].plan_s, 0.25);
  EXPECT_EQ(view->failures[0].task, PlanEpisode(view->info.spec, 2, 0).task.text());
  EXPECT_EQ(view->GivenUp(), 0u);
}

// what came before the journal's new line was read kept the task that the weights before it would have drawn
TEST(DatasetSource, AFailuresTaskIsThatOfTheWeightsThatHeld) {
  TemporaryFolder folder;
  CampaignSpec spec = SyntheticSpec(24, 24);
  spec.adaptive_sampling = {.share = 0.5, .largest_ratio = 3, .every = 10};
  auto writer = store::DatasetWriter::Open(folder / "data", spec);
  ASSERT_THAT(writer, IsOk());
  for (std::uint64_t index = 10; index < 24; ++index)
    ASSERT_THAT(writer->RecordFailure(index, 0, "plan_failed", "{}"), IsOk());
  DatasetSource source({Kind::kDataset, "data", "data", folder / "data", "data", ""});
  const auto before = source.View().value();
  ASSERT_EQ(before->failures.size(), 14u);

  auto journal = store::SamplingJournal::Open(folder / "data", spec);
  ASSERT_THAT(journal, IsOk());
  ASSERT_THAT(journal->Append({.from_index = 10,
                               .run = "0123456789abcdef",
                               .step = 5,
                               .weights = WeightsFor({{"pick", "cube", 3, 9, 2}, {"push", "milk", 4, 9, 1}}, spec)}),
              IsOk());
  const auto about = [](const DatasetView& view) {
    std::vector<std::string> words;
    for (const auto& row : view.failures) words.push_back(row.task + " " + row.target);
    return words;
  };
  std::vector<std::string> drawn;
  for (std::uint64_t index = 10; index < 24; ++index) {
    const EpisodePlan plan = PlanEpisode(spec, index, 0, journal->At(index));
    drawn.push_back(plan.task.text() + " " + plan.target);
  }
  ASSERT_NE(about(*before), drawn);
  auto after = before;
  for (const Stopwatch watch; about(*after) != drawn && watch.Seconds() < 10;) after = source.View().value();
  EXPECT_EQ(about(*after), drawn);
}

DatasetView FailedView(const std::string& mode, const std::vector<AttemptRow>& failures) {
  DatasetView view;
  view.info.spec.mode = mode;
  view.info.spec.max_attempts = 3;
  view.failures = failures;
  return view;
}
AttemptRow FailedAt(std::uint64_t index, std::uint32_t attempt, const std::string& outcome) {
  AttemptRow row;
  row.index = index, row.attempt = attempt, row.outcome = outcome;
  return row;
}

TEST(DatasetView, AttemptsAreUsedUpWhenAsManyAsThereMayBeHaveFailed) {
  std::vector<AttemptRow> failures{FailedAt(4, 0, "timeout"),      FailedAt(4, 1, "timeout"),
                                   FailedAt(4, 1, "timeout"),      FailedAt(5, 0, "policy_error"),
                                   FailedAt(5, 1, "policy_error"), FailedAt(5, 2, "policy_error")};
  EXPECT_EQ(FailedView("demonstrate", failures).GivenUp(), 0u) << "a line twice is one attempt, a policy's error none";
  failures.push_back(FailedAt(4, 2, "timeout"));
  DatasetView view = FailedView("demonstrate", failures);
  EXPECT_EQ(view.UsedUp(), std::set<std::uint64_t>{4});
  view.rows.emplace_back().index = 4;
  EXPECT_EQ(view.GivenUp(), 0u) << "it is committed";
}

// before, spec.scenes decided: an evaluation that draws scenes anew waited for indices that nobody tries again, and a
// campaign of first draws gave demonstrations up that are retried
TEST(DatasetView, AnInvalidSceneIsTheEndOfARolloutAndNotOfADemonstration) {
  const std::vector<AttemptRow> failures{FailedAt(7, 0, "scene_invalid")};
  for (const char* scenes : {"first_draw", "feasible"}) {
    DatasetView rollout = FailedView("rollout", failures), demonstration = FailedView("demonstrate", failures);
    rollout.info.spec.scenes = demonstration.info.spec.scenes = scenes;
    EXPECT_EQ(rollout.GivenUp(), 1u) << scenes;
    EXPECT_EQ(demonstration.GivenUp(), 0u) << scenes;
  }
}

// before, an evaluation with such a rollout was never finished here, as it was for its collector
TEST(DatasetView, WhatEndsItsWorkersIsTheEndOfARolloutAndNotOfADemonstration) {
  const std::vector<AttemptRow> failures{FailedAt(7, 0, "kills_workers"), FailedAt(8, 0, "timeout")};
  EXPECT_EQ(FailedView("rollout", failures).UsedUp(), std::set<std::uint64_t>{7});
  EXPECT_EQ(FailedView("demonstrate", failures).GivenUp(), 0u);
}

TEST(DatasetSource, ADamagedFileIsNamedAndTheOthersGoOn) {
  ExampleFolders lab;
  std::filesystem::remove(lab.root() / "data" / "commits.jsonl");
  ASSERT_THAT(WriteFileAtomically(store::EpisodePath(lab.root() / "data", 3), "not an episode"), IsOk());
  DatasetSource source(DataOf(lab));
  ASSERT_THAT(source.View(), IsOk());
  while (source.ReadNext()) {
  }
  const auto view = source.View().value();
  EXPECT_EQ(view->known, kEpisodes - 1);
  EXPECT_EQ(view->info.unreadable, 1u);
  EXPECT_TRUE(view->info.unreadable_files.contains(3));
  EXPECT_THAT(source.Episode(3), HasCode(Code::kCorrupt));
  EXPECT_THAT(source.Episode(2), IsOk());

  // what takes its place is read; what was read before it is not shown any more
  const Path data = lab.root() / "data";
  const Path fresh = data / "fresh";
  std::filesystem::copy_file(store::EpisodePath(data, 2), fresh);
  std::filesystem::rename(fresh, store::EpisodePath(data, 3));
  ASSERT_THAT(WriteFileAtomically(store::EpisodePath(data, 2), "not an episode any more"), IsOk());
  EXPECT_THAT(source.Episode(2), HasCode(Code::kCorrupt));
  const auto deadline = MonotonicClock::now() + std::chrono::seconds(20);
  while (source.View().value()->info.unreadable_files.contains(3) && MonotonicClock::now() < deadline) {
  }
  EXPECT_EQ(source.View().value()->info.unreadable, 0u);
}

// before, nothing was read behind the last one that is named
TEST(DatasetSource, ManyDamagedFilesKeepNoneFromBeingRead) {
  ExampleFolders lab;
  const Path data = lab.root() / "data";
  std::filesystem::remove(data / "commits.jsonl");
  for (std::uint64_t index = 1000; index < 1025; ++index) {
    std::filesystem::create_directories(store::EpisodePath(data, index).parent_path());
    ASSERT_THAT(WriteFileAtomically(store::EpisodePath(data, index), "not an episode"), IsOk());
  }
  DatasetSource source(DataOf(lab));
  ASSERT_THAT(source.View(), IsOk());
  while (source.ReadNext()) {
  }
  const auto view = source.View().value();
  EXPECT_EQ(view->known, kEpisodes);
  EXPECT_EQ(view->info.unreadable, 25u);
  EXPECT_EQ(view->info.unreadable_files.size(), 20u);
}

TEST(MarkOdd, FindsTheOneThatTookTooLong) {
  std::vector<EpisodeRow> rows(12);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    rows[i].known = true;
    rows[i].task = "pick";
    rows[i].steps = i == 7 ? 1500 : 300 + i;
  }
  rows[0].task = "push";  // alone of its task
  MarkOdd(rows);
  EXPECT_GT(rows[7].odd.value_or(0), 50);
  EXPECT_EQ(rows[7].odd_what, "steps");
  EXPECT_LT(rows[6].odd.value_or(99), 3);
  EXPECT_FALSE(rows[0].odd);
}

TEST(DatasetSource, KeysAreThoseThatTheStoreWrites) {
  ExampleFolders lab;
  const Path data = lab.root() / "data";
  DatasetSource source(DataOf(lab));
  EXPECT_TRUE(source.Keys().empty());
  ASSERT_THAT(store::WriteFilterKey(data, "good", {0, 2}), IsOk());
  ASSERT_THAT(store::WriteFilterKey(data, "better", {4}), IsOk());
  EXPECT_EQ(source.Keys(), (std::vector<std::string>{"better", "good"}));
  EXPECT_EQ(source.EpisodesOfKey("good").value(), (std::set<std::uint64_t>{0, 2}));
  EXPECT_THAT(source.EpisodesOfKey("../good"), HasCode(Code::kNotFound));

  ASSERT_THAT(WriteFileAtomically(data / "filters.json", std::string_view("[1]")), IsOk());
  EXPECT_TRUE(source.Keys().empty());
  EXPECT_THAT(source.EpisodesOfKey("good"), HasCode(Code::kCorrupt)) << "and not that there is none";
}

}  // namespace dataset_source_test
}  // namespace etude::sources
