// SPDX-License-Identifier: Apache-2.0
// Tests services/store/dataset_writer.cc, master_file.cc and summary.cc
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>

#include "services/core/hash.h"
#include "services/episode/codec.h"
#include "services/spec/content_version.h"
#include "services/spec/episode_plan.h"
#include "services/store/attempts.h"
#include "services/store/dataset.h"
#include "services/store/edit.h"
#include "tests/support/matchers.h"
#include "tests/support/replace_in_file.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude::store {
namespace dataset_writer_test {

Result<DatasetWriter> OpenWith(const Path& dataset, const CampaignSpec& spec, int episodes) {
  auto writer = DatasetWriter::Open(dataset, spec);
  for (int i = 0; writer && i < episodes; ++i)
    if (Status done = writer->Commit(MakeSyntheticEpisode(spec, static_cast<std::uint64_t>(i))); !done)
      return Fail(done.error());
  return writer;
}

std::string Slurp(const Path& path) { return ReadTextFile(path).value_or("unreadable"); }

TEST(DatasetWriter, CommitsEpisodesThatAReaderGetsBackWhole) {
  const TemporaryFolder folder;
  const CampaignSpec spec = SyntheticSpec();
  const auto writer = OpenWith(folder / "d", spec, 3);
  ASSERT_THAT(writer, IsOk());
  EXPECT_THAT(writer->committed(), testing::ElementsAre(0, 1, 2));
  EXPECT_FALSE(writer->Contains(3));

  const auto reader = DatasetReader::Open(folder / "d");
  ASSERT_THAT(reader, IsOk());
  for (std::uint64_t i = 0; i < 3; ++i) {
    const auto episode = reader->ReadWhole(i);
    ASSERT_THAT(episode, IsOk());
    EXPECT_EQ(EncodeEpisode(*episode), EncodeEpisode(MakeSyntheticEpisode(spec, i)));
  }
}

TEST(DatasetWriter, WhileItGrowsTheSmallMasterFileIsWholeToo) {
  const TemporaryFolder folder;
  auto writer = OpenWith(folder / "a", SyntheticSpec(), 3);
  ASSERT_THAT(writer->WriteProgress(), IsOk());
  const auto json = Slurp(folder / "a" / "dataset.json"), master = Slurp(folder / "a" / "dataset.hdf5");
  ASSERT_THAT(writer->WriteMaster(), IsOk());
  EXPECT_TRUE(Slurp(folder / "a" / "dataset.json") == json);
  EXPECT_TRUE(Slurp(folder / "a" / "dataset.hdf5") == master);
  // nothing came: the statistics are written, the links are not
  ASSERT_TRUE(std::filesystem::remove(folder / "a" / "dataset.hdf5"));
  ASSERT_THAT(writer->RecordFailure(0, 0, "slip", "{}"), IsOk());
  ASSERT_THAT(writer->WriteProgress(), IsOk());
  EXPECT_FALSE(std::filesystem::exists(folder / "a" / "dataset.hdf5"));
  EXPECT_FALSE(Slurp(folder / "a" / "dataset.json") == json);
}

TEST(DatasetWriter, GivesTheSameBytesInAnyOrderAndFolder) {
  const TemporaryFolder folder;
  const CampaignSpec spec = SyntheticSpec();
  ASSERT_THAT(OpenWith(folder / "a", spec, 3)->WriteMaster(), IsOk());
  {
    auto b = DatasetWriter::Open(folder / "b", spec);
    ASSERT_THAT(b, IsOk());
    for (const std::uint64_t i : {2, 0}) ASSERT_THAT(b->Commit(MakeSyntheticEpisode(spec, i)), IsOk());
  }
  auto b = DatasetWriter::Open(folder / "b", spec);  // resumed
  ASSERT_THAT(b, IsOk());
  EXPECT_THAT(b->committed(), testing::ElementsAre(0, 2));
  ASSERT_THAT(b->Commit(MakeSyntheticEpisode(spec, 1)), IsOk());
  ASSERT_THAT(b->WriteMaster(), IsOk());

  for (const char* name : {"dataset.json", "dataset.hdf5", "episodes/000/000000.hdf5", "episodes/000/000001.hdf5",
                           "episodes/000/000002.hdf5"})
    EXPECT_TRUE(Slurp(folder / "a" / name) == Slurp(folder / "b" / name)) << name;
}

TEST(DatasetWriter, CommittingTwiceChangesNothing) {
  const TemporaryFolder folder;
  auto writer = OpenWith(folder.path(), SyntheticSpec(), 1);
  ASSERT_THAT(writer, IsOk());
  const auto before = std::filesystem::last_write_time(EpisodePath(folder.path(), 0));

  ASSERT_THAT(writer->Commit(MakeSyntheticEpisode(SyntheticSpec(), 0, 10)), IsOk());

  EXPECT_EQ(std::filesystem::last_write_time(EpisodePath(folder.path(), 0)), before);
  EXPECT_EQ(DatasetReader::Open(folder.path())->Read(0)->episode.steps(), 50);
}

TEST(DatasetWriter, RefusesAnotherSpecNamingTheKeys) {
  const TemporaryFolder folder;
  CampaignSpec spec = SyntheticSpec();
  ASSERT_THAT(OpenWith(folder.path(), spec, 1), IsOk());
  CampaignSpec other = spec;
  other.seed = 77;
  other.camera.width = 48;
  other.episodes = 5;

  const auto refused = DatasetWriter::Open(folder.path(), other);

  EXPECT_THAT(refused, HasCode(Code::kInvalidArgument));
  EXPECT_THAT(refused, MessageHas("seed (1, now 77)"));
  EXPECT_THAT(refused, MessageHas("camera.width (32, now 48)"));
  EXPECT_THAT(refused, testing::Not(MessageHas("episodes (")));
}

TEST(DatasetWriter, SurvivesWhateverAWorkerSaysOfItsFailures) {
  const TemporaryFolder folder;
  auto writer = OpenWith(folder.path(), SyntheticSpec(), 1);
  ASSERT_THAT(writer, IsOk());
  const std::string deep(1'000'000, '[');

  // a million brackets used to end the process
  ASSERT_THAT(writer->RecordFailure(1, 0, "plan_failed", deep), IsOk());
  ASSERT_THAT(writer->RecordFailure(1, 1, "plan_failed", deep + std::string(deep.size(), ']')), IsOk());
  ASSERT_THAT(writer->RecordFailure(1, 2, "plan_failed", "\xff\xfe not JSON"), IsOk());
  ASSERT_THAT(writer->WriteMaster(), IsOk());

  const std::string lines = Slurp(folder / "attempts.jsonl");
  EXPECT_EQ(std::count(lines.begin(), lines.end(), '\n'), 3);
  EXPECT_LT(lines.size(), 10'000u);
  EXPECT_THAT(Slurp(folder / "dataset.json"), testing::HasSubstr("\"plan_failed\": 3"));
}

TEST(DatasetWriter, SurvivesFilesThatSomebodyElseWrote) {
  const TemporaryFolder folder;
  ASSERT_THAT(OpenWith(folder.path(), SyntheticSpec(), 1), IsOk());
  const std::string deep = std::string(1'000'000, '[') + std::string(1'000'000, ']');
  std::ofstream(folder / "attempts.jsonl") << "{\"index\": 1, \"attempt\": 0, \"details\": " << deep << "}\n";

  EXPECT_THAT(OpenWith(folder.path(), SyntheticSpec(), 1)->WriteMaster(), IsOk());

  std::ofstream(folder / "dataset.json") << "{\"schema_version\": 2, \"spec\": " << deep << "}";
  EXPECT_THAT(DatasetWriter::Open(folder.path(), SyntheticSpec()), HasCode(Code::kCorrupt));
}

TEST(DatasetWriter, RefusesToMixEpisodesOfTwoContents) {
  const TemporaryFolder folder;
  ASSERT_THAT(OpenWith(folder.path(), SyntheticSpec(), 1), IsOk());
  ReplaceInFile(folder / "dataset.json", fmt::format("\"content\": {}", kContentVersion), "\"content\": 1");
  const auto refused = DatasetWriter::Open(folder.path(), SyntheticSpec());
  EXPECT_THAT(refused, HasCode(Code::kInvalidArgument));
  EXPECT_THAT(refused, MessageHas("content version 1"));
  EXPECT_THAT(DatasetReader::Open(folder.path()), IsOk()) << "what is there can be read";
}

TEST(DatasetWriter, MayBeExtended) {
  const TemporaryFolder folder;
  CampaignSpec spec = SyntheticSpec();
  ASSERT_THAT(OpenWith(folder.path(), spec, 2), IsOk());
  spec.episodes = 500;
  spec.split.valid = 0.5;

  const auto writer = DatasetWriter::Open(folder.path(), spec);

  ASSERT_THAT(writer, IsOk());
  EXPECT_EQ(writer->committed().size(), 2u);
  EXPECT_EQ(DatasetReader::Open(folder.path())->spec().episodes, 500u);
}

TEST(DatasetWriter, RefusesEpisodesOfAnotherSpecAndInvalidOnes) {
  const TemporaryFolder folder;
  auto writer = OpenWith(folder.path(), SyntheticSpec(), 0);
  ASSERT_THAT(writer, IsOk());
  Episode broken = MakeSyntheticEpisode(SyntheticSpec(), 0);
  broken.joint_pos.values.pop_back();

  EXPECT_THAT(writer->Commit(MakeSyntheticEpisode(SyntheticSpec(16, 16), 0)), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(writer->Commit(broken), HasCode(Code::kInvalidArgument));

  EXPECT_THAT(writer->committed(), testing::IsEmpty());
  EXPECT_THAT(*DatasetReader::Open(folder.path())->List(), testing::IsEmpty());
}

TEST(DatasetWriter, RefusesASecondWriterOfTheSameProcess) {
  const TemporaryFolder folder;
  const auto first = OpenWith(folder.path(), SyntheticSpec(), 1);
  ASSERT_THAT(first, IsOk());

  const auto second = DatasetWriter::Open(folder.path(), SyntheticSpec());

  EXPECT_THAT(second, HasCode(Code::kUnavailable));
  EXPECT_THAT(second, MessageHas("being written by another process"));
}

TEST(DatasetWriter, DoesNotTakeAFolderOfSomethingElse) {
  const TemporaryFolder folder;
  std::ofstream(folder / "thesis.tex") << "x";

  const auto refused = DatasetWriter::Open(folder.path(), SyntheticSpec());

  EXPECT_THAT(refused, HasCode(Code::kInvalidArgument));
  EXPECT_THAT(refused, MessageHas("thesis.tex"));
}

TEST(DatasetWriter, RefusesADamagedDescription) {
  const TemporaryFolder folder;
  ASSERT_THAT(OpenWith(folder.path(), SyntheticSpec(), 1), IsOk());
  std::ofstream(folder / "dataset.json") << "{\"schema_ver";

  EXPECT_THAT(DatasetWriter::Open(folder.path(), SyntheticSpec()), HasCode(Code::kCorrupt));
}

// the name is in every episode: half of them under another one are of no spec
TEST(DatasetWriter, RefusesToGoOnUnderAnotherCampaignsName) {
  const TemporaryFolder folder;
  CampaignSpec spec = SyntheticSpec();
  ASSERT_THAT(OpenWith(folder.path(), spec, 1), IsOk());
  spec.name += "_2";
  EXPECT_THAT(DatasetWriter::Open(folder.path(), spec), MessageHas("whose name is in every episode"));
}

// before, what came back in the same way had no line, and was tried all over again after the next start
TEST(DatasetWriter, WhatWasForgottenIsRecordedAgain) {
  const TemporaryFolder folder;
  auto writer = OpenWith(folder.path(), SyntheticSpec(), 0);
  ASSERT_THAT(writer->RecordFailure(4, 0, "no_path", "{}"), IsOk());
  ASSERT_THAT(writer->ForgetFailures(), IsOk());
  ASSERT_THAT(writer->RecordFailure(4, 0, "no_path", "{}"), IsOk());
  ASSERT_THAT(writer->RecordFailure(4, 0, "no_path", "{}"), IsOk());
  for (const char* name : {"attempts.jsonl", "attempts.1.jsonl"}) {
    const std::string text = Slurp(folder / name);
    EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 1) << name;
  }
}

// before, the next start took the lines for recorded again: what came back in the same way was not told of
TEST(DatasetWriter, WhatWasForgottenStaysSoAfterARestart) {
  const TemporaryFolder folder;
  const auto failed = [&](DatasetWriter& writer) {
    EXPECT_THAT(writer.WriteMaster(), IsOk());
    return (*DatasetInfo(folder.path()))["failed_attempts"].dump();
  };
  {
    auto writer = OpenWith(folder.path(), SyntheticSpec(), 0);
    ASSERT_THAT(writer->ForgetFailures(), IsOk()) << "nothing has failed";
    EXPECT_FALSE(std::filesystem::exists(folder / "attempts.1.jsonl"));
    ASSERT_THAT(writer->RecordFailure(4, 0, "no_path", "{}"), IsOk());
    ASSERT_THAT(writer->ForgetFailures(), IsOk());
  }
  auto writer = OpenWith(folder.path(), SyntheticSpec(), 0);
  EXPECT_EQ(failed(*writer), "{}");
  ASSERT_THAT(writer->RecordFailure(4, 0, "no_path", "{}"), IsOk());
  EXPECT_EQ(failed(*writer), R"({"no_path":1})");
  ASSERT_THAT(writer->ForgetFailures(), IsOk());
  EXPECT_TRUE(std::filesystem::exists(folder / "attempts.2.jsonl")) << "the first ones stay, too";
}

TEST(DatasetWriter, RecordsEveryFailedAttemptOnce) {
  const TemporaryFolder folder;
  const CampaignSpec spec = SyntheticSpec();
  {
    auto writer = OpenWith(folder.path(), spec, 0);
    ASSERT_THAT(writer->RecordFailure(4, 0, "no_path", R"({"planner":"rrt"})"), IsOk());
    ASSERT_THAT(writer->RecordFailure(4, 0, "no_path", "{}"), IsOk());
    ASSERT_THAT(writer->RecordFailure(4, 1, "slipped", "not json \xff"), IsOk());
  }
  std::ofstream(folder / "attempts.jsonl", std::ios::app) << R"({"index":9,"att)";  // torn by a crash
  {
    auto writer = OpenWith(folder.path(), spec, 0);
    ASSERT_THAT(writer->RecordFailure(4, 1, "slipped", "{}"), IsOk());
    ASSERT_THAT(writer->RecordFailure(9, 0, "slipped", "{}"), IsOk());
    ASSERT_THAT(writer->WriteMaster(), IsOk());
  }

  const std::string text = Slurp(folder / "attempts.jsonl");
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 4);  // three whole lines and the torn one
  const auto info = DatasetInfo(folder.path());
  ASSERT_THAT(info, IsOk());
  EXPECT_EQ((*info)["failed_attempts"].dump(), R"({"no_path":1,"slipped":2})");
  const auto first = Json::parse(text.substr(0, text.find('\n')));
  EXPECT_EQ(first["seed"], EpisodeSeed(spec, 4, 0));
  EXPECT_EQ(first["details"]["planner"], "rrt");
}

TEST(DatasetInfo, CountsWhatIsThere) {
  const TemporaryFolder folder;
  CampaignSpec spec = SyntheticSpec();
  auto writer = OpenWith(folder.path(), spec, 9);
  ASSERT_THAT(writer, IsOk());
  Episode failed = MakeSyntheticEpisode(spec, 9);
  failed.success = false;
  failed.outcome = "too_slow";
  ASSERT_THAT(writer->Commit(failed), IsOk());
  ASSERT_THAT(writer->WriteMaster(), IsOk());

  const auto info = DatasetInfo(folder.path());

  ASSERT_THAT(info, IsOk());
  const OrderedJson& statistics = (*info)["statistics"];
  EXPECT_EQ(statistics["episodes"], 10);
  EXPECT_EQ(statistics["successes"], 9);
  EXPECT_EQ(statistics["steps"], 500);
  EXPECT_EQ(statistics["samples"], 100);
  EXPECT_EQ(statistics["frames"], 100);
  EXPECT_EQ(statistics["seconds"], 4.0);
  EXPECT_EQ(statistics["tasks"].dump(), R"({"pick":4,"push":3,"put_down":3})");
  EXPECT_EQ(statistics["outcomes"].dump(), R"({"success":9,"too_slow":1})");
  std::uint64_t bytes = 0;
  for (std::uint64_t i = 0; i < 10; ++i) bytes += std::filesystem::file_size(EpisodePath(folder.path(), i));
  EXPECT_EQ(statistics["bytes"], bytes);
  EXPECT_THAT((*info)["unreadable"], testing::IsEmpty());
  EXPECT_EQ((*info)["features"].back()["shape"].dump(), R"(["N",32,32,3])");

  // the description on disk says the same
  OrderedJson on_disk = OrderedJson::parse(Slurp(folder / "dataset.json"))["statistics"];
  on_disk.erase("failed_attempts");
  EXPECT_EQ(on_disk, statistics);
}

TEST(DatasetWriter, OfAGroupEachIsCommittedOrRefusedForItself) {
  const TemporaryFolder folder;
  const CampaignSpec spec = SyntheticSpec();
  auto writer = DatasetWriter::Open(folder.path(), spec);
  ASSERT_THAT(writer, IsOk());
  ASSERT_THAT(writer->Commit(MakeSyntheticEpisode(spec, 1)), IsOk());
  std::vector<Episode> episodes;
  for (const std::uint64_t index : {0, 1, 2, 3}) episodes.push_back(MakeSyntheticEpisode(spec, index));
  episodes[2].spec_sha256 = std::string(64, '0');
  std::vector<EpisodeView> views;
  std::vector<ArrivedEpisode> group;
  for (const Episode& episode : episodes) views.push_back({episode, StreamsOf(episode)});
  for (const EpisodeView& view : views)
    group.push_back({&view, Sha256Hex(EncodeEpisode(view.episode)), {.worker = "w"}});

  const auto statuses = writer->CommitGroup(group);

  ASSERT_EQ(statuses.size(), 4u);
  EXPECT_THAT(statuses[0], IsOk());
  EXPECT_THAT(statuses[1], IsOk()) << "it was there";
  EXPECT_THAT(statuses[2], HasCode(Code::kInvalidArgument));
  EXPECT_THAT(statuses[2], MessageHas("another spec"));
  EXPECT_THAT(statuses[3], IsOk());
  EXPECT_THAT(writer->committed(), testing::ElementsAre(0, 1, 3));
  const auto report = Verify(folder.path(), Quarantine::kNo);
  ASSERT_THAT(report, IsOk());
  EXPECT_EQ(report->good, 3u);
  EXPECT_TRUE(report->bad.empty());
}

// While its policy is away, an attempt is made again under its own number; then it may fail for itself.
TEST(DatasetWriter, RecordsAFailureBesideAPolicyErrorOfTheSameAttempt) {
  const TemporaryFolder folder;
  const CampaignSpec spec = SyntheticSpec();
  for (int start = 0; start < 2; ++start) {
    auto writer = DatasetWriter::Open(folder.path(), spec);
    ASSERT_THAT(writer, IsOk());
    ASSERT_THAT(writer->RecordFailure(3, 0, "policy_error", "{}"), IsOk());
    ASSERT_THAT(writer->RecordFailure(3, 0, "slipped", R"({"a": 1})"), IsOk());
    ASSERT_THAT(writer->RecordFailure(3, 0, "slipped", std::string(3 << 20, '[')), IsOk());
  }
  std::vector<std::string> outcomes;
  ForEachAttempt(folder.path(), [&](const AttemptLine& line) {
    EXPECT_EQ(line.index, 3u);
    EXPECT_EQ(line.attempt, 0u);
    outcomes.push_back(line.outcome);
  });
  EXPECT_EQ(outcomes, (std::vector<std::string>{"policy_error", "slipped"}));
}

TEST(ForEachAttempt, LeavesOutWhatIsTornTooLongOrNotUnderstood) {
  const TemporaryFolder folder;
  const auto count = [&] {
    std::vector<std::uint64_t> indices;
    ForEachAttempt(folder.path(), [&](const AttemptLine& line) { indices.push_back(line.index); });
    return indices;
  };
  EXPECT_TRUE(count().empty());
  const auto line = [](int index, const std::string& more) {
    return R"({"index": )" + std::to_string(index) + R"(, "attempt": 0, "outcome": "slip")" + more + "}";
  };
  std::ofstream(folder / "attempts.jsonl")
      << line(1, "") << "\n\nnot json\n[3]\n{\"index\": 2}\n"
      << R"({"index": 4, "attempt": 4294967296, "outcome": "slip"})"
      << "\n"
      << line(5, R"(, "details": ")" + std::string(3 * kMaxAttemptLine, 'x') + "\"") << "\n"
      << line(6, R"(, "details": ")" + std::string(kMaxAttemptLine / 2, 'x') + "\"") << "\n"
      << "{\"index\": 7, \"att\n"
      << line(8, "");
  EXPECT_EQ(count(), (std::vector<std::uint64_t>{1, 6, 8}));
}

// the link was taken for a folder that is yet to be made: all was forgotten, and made again
TEST(DatasetWriter, EpisodesOnADiskThatIsAwayAreNotNone) {
  const TemporaryFolder folder;
  const CampaignSpec spec = SyntheticSpec();
  const Path data = folder / "d";
  {
    auto writer = DatasetWriter::Open(data, spec);
    ASSERT_THAT(writer, IsOk());
    ASSERT_THAT(writer->Commit(MakeSyntheticEpisode(spec, 0, 10)), IsOk());
    ASSERT_THAT(writer->WriteMaster(), IsOk());
  }
  const std::string journal = *ReadTextFile(data / "commits.jsonl");
  std::filesystem::rename(data / "episodes", folder / "away");
  std::filesystem::create_directory(data / "episodes");  // a mount point without its disk
  EXPECT_THAT(DatasetWriter::Open(data, spec), MessageHas("is the disk of"));
  EXPECT_EQ(*ReadTextFile(data / "commits.jsonl"), journal);
  std::filesystem::remove(data / "episodes");
  std::filesystem::create_directory_symlink(folder / "disk", data / "episodes");

  EXPECT_THAT(DatasetWriter::Open(data, spec), HasCode(Code::kUnavailable));
  EXPECT_THAT(Verify(data, Quarantine::kYes), HasCode(Code::kUnavailable));

  EXPECT_EQ(*ReadTextFile(data / "commits.jsonl"), journal);

  std::filesystem::remove(data / "episodes");
  std::filesystem::rename(folder / "away", data / "episodes");
  ASSERT_THAT(DeleteEpisodes(data, {0}), IsOk());
  EXPECT_THAT(DatasetWriter::Open(data, spec), IsOk()) << "removed on purpose";
}

}  // namespace dataset_writer_test
}  // namespace etude::store
