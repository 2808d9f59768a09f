// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/results_folder.cc
#include "services/cli/results_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "services/core/config.h"
#include "services/core/hash.h"
#include "services/store/dataset.h"
#include "tests/support/matchers.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude::cli {
namespace results_folder_test {

// A dataset of the first `count` of six episodes: in whatever order, four are for training, one for validation and one
// for tests. An episode has two attempts.
Path WriteDataset(const Path& data, std::uint64_t count) {
  CampaignSpec spec = SyntheticSpec();
  spec.episodes = 6;
  spec.max_attempts = 2;
  spec.split = {.train = 4, .valid = 1, .test = 1};
  auto writer = store::DatasetWriter::Open(data, spec);
  EXPECT_THAT(writer, IsOk());
  for (std::uint64_t i = 0; writer && i < count; ++i)
    EXPECT_THAT(writer->Commit(MakeSyntheticEpisode(spec, i, 10)), IsOk());
  return data;
}

TEST(CountDemonstrations, TellsThemBySplit) {
  const TemporaryFolder folder;
  const auto count = CountDemonstrations(WriteDataset(folder.path() / "data", 6));
  ASSERT_THAT(count, IsOk());
  EXPECT_EQ(count->train, 4U);
  EXPECT_EQ(count->valid, 1U);
  EXPECT_EQ(count->all(), 6U);
  EXPECT_THAT(CountDemonstrations(folder.path() / "none"), HasCode(Code::kNotFound));
}

TEST(CheckWholeDataset, SaysHowManyAreMissing) {
  const TemporaryFolder folder;
  const Path some = WriteDataset(folder.path() / "some", 5), all = WriteDataset(folder.path() / "all", 6);
  EXPECT_THAT(CheckWholeDataset(some, 6), HasCode(Code::kNotFound));
  EXPECT_THAT(CheckWholeDataset(some, 6), MessageHas("5 of 6 demonstrations"));
  EXPECT_THAT(CheckWholeDataset(some, 0), MessageHas("5 of 6 demonstrations")) << "as many as the campaign asks for";
  EXPECT_THAT(CheckWholeDataset(some, 5), IsOk());
  EXPECT_THAT(CheckWholeDataset(all, 0), IsOk());
  EXPECT_THAT(CheckWholeDataset(folder.path() / "none", 1), HasCode(Code::kNotFound));
}

// no collector tries them again: a row that waited for them would never be made
TEST(CheckWholeDataset, CountsEpisodesThatWereGivenUp) {
  const TemporaryFolder folder;
  const Path data = WriteDataset(folder.path() / "data", 4);
  const auto write = [&](const std::vector<std::pair<int, int>>& attempts) {
    std::string lines;
    for (const auto& [index, attempt] : attempts)
      lines += OrderedJson{{"index", index}, {"attempt", attempt}, {"outcome", "dropped"}}.dump() + "\n";
    ASSERT_THAT(WriteFileAtomically(data / "attempts.jsonl", std::string_view(lines)), IsOk());
  };
  write({{4, 0}, {4, 1}, {5, 0}, {5, 0}});
  EXPECT_THAT(CheckWholeDataset(data, 0), MessageHas("4 of 6 demonstrations, and gave 1 up"))
      << "one attempt, written twice, is one";
  EXPECT_THAT(CheckWholeDataset(data, 5), IsOk());
  write({{1, 0}, {1, 1}, {4, 0}, {4, 1}, {9, 0}, {9, 1}});
  EXPECT_THAT(CheckWholeDataset(data, 0), MessageHas("gave 1 up")) << "1 was committed, 9 is none of them";
  write({{4, 0}, {4, 1}, {5, 0}, {5, 1}});
  EXPECT_THAT(CheckWholeDataset(data, 0), IsOk());
}

TEST(CheckEvaluated, IsOfTheCheckpointThatIsThere) {
  const TemporaryFolder folder;
  const Path evaluation = folder.path() / "eval", checkpoint = folder.path() / "latest.safetensors";
  const std::string weights = "weights";
  const auto write = [&](const OrderedJson& report) {
    ASSERT_THAT(WriteFileAtomically(evaluation / "eval.json", report.dump()), IsOk());
  };
  EXPECT_THAT(CheckEvaluated(evaluation, checkpoint), IsOk()) << "nothing is there";
  write({{"policy", {{"sha256", Sha256Hex(weights)}}}});
  EXPECT_THAT(CheckEvaluated(evaluation, checkpoint), IsOk()) << "the checkpoint is gone";
  ASSERT_THAT(WriteFileAtomically(checkpoint, weights), IsOk());
  EXPECT_THAT(CheckEvaluated(evaluation, checkpoint), IsOk());

  ASSERT_THAT(WriteFileAtomically(checkpoint, std::string_view("trained again")), IsOk());
  EXPECT_THAT(CheckEvaluated(evaluation, checkpoint), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(CheckEvaluated(evaluation, checkpoint), MessageHas("remove the former"));
  for (const OrderedJson& silent : {OrderedJson::object(), OrderedJson::array(), OrderedJson{{"policy", 3}}}) {
    write(silent);
    EXPECT_THAT(CheckEvaluated(evaluation, checkpoint), IsOk()) << silent;
  }
}

TEST(HasFinished, IsWhatTheLastEndSays) {
  const TemporaryFolder folder;
  EXPECT_FALSE(HasFinished(folder.path()));
  const auto says = [&](std::string_view lines) {
    EXPECT_THAT(WriteFileAtomically(folder.path() / "metrics.jsonl", lines), IsOk());
    return HasFinished(folder.path());
  };
  EXPECT_FALSE(says("{\"kind\":\"train\",\"elapsed_s\":9}\n"));
  EXPECT_FALSE(says("{\"kind\":\"end\",\"cause\":\"stopped\"}\n")) << "before, it became a row of results";
  EXPECT_TRUE(says("{\"kind\":\"end\",\"cause\":\"stopped\"}\n{\"kind\":\"end\",\"cause\":\"finished\"}\n"));
  EXPECT_FALSE(says("{\"kind\":\"end\",\"cause\":7}\n"));
}

TEST(TrainingSeconds, AreThoseOfTheLastEnd) {
  const TemporaryFolder folder;
  EXPECT_EQ(TrainingSeconds(folder.path()), std::nullopt);
  const auto write = [&](std::string_view lines) {
    ASSERT_THAT(WriteFileAtomically(folder.path() / "metrics.jsonl", lines), IsOk());
  };
  write("{\"kind\":\"train\",\"elapsed_s\":9}\n");
  EXPECT_EQ(TrainingSeconds(folder.path()), std::nullopt) << "it has not come to an end";
  write(
      "{\"kind\":\"end\",\"elapsed_s\":70.5}\n{\"kind\":\"train\",\"elapsed_s\":80}\n"
      "{\"kind\":\"end\",\"elapsed_s\":90.5}\n{\"kind\":\"checkpoint\"}\n");
  EXPECT_EQ(TrainingSeconds(folder.path()), 90.5) << "stopped, and gone on with";
  write("{\"kind\":\"end\",\"elapsed_s\":\"long\"}\n{\"kind\":\"end\"");
  EXPECT_EQ(TrainingSeconds(folder.path()), std::nullopt);
}

}  // namespace results_folder_test
}  // namespace etude::cli
