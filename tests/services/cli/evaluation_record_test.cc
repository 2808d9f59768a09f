// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/evaluation_record.cc
#include "services/cli/evaluation_record.h"

#include <gtest/gtest.h>

#include "services/core/hash.h"
#include "services/store/safetensors.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::cli {
namespace evaluation_record_test {

std::vector<std::uint8_t> Checkpoint() {
  store::Safetensors content;
  content.metadata = {{"run", "demo"}, {"step", "900"}, {"dataset", "f00"}};
  content.tensors["w"] = {store::DType::kU8, {2}, {1, 2}};
  return store::EncodeSafetensors(content);
}

// A report of rollouts that ended with these checkpoints.
void WriteReport(const Path& out, const std::vector<std::uint64_t>& steps) {
  OrderedJson report = campaign::EvalReport(CampaignSpec(), {}, {.run_id = "0011", .run = "demo"});
  std::uint64_t index = 7;
  for (const auto step : steps) {
    campaign::RolloutRow row;
    row.index = index++;
    row.checkpoint_step = step;
    report["per_episode"].push_back(campaign::RowJson(row));
  }
  ASSERT_THAT(WriteFileAtomically(out / "eval.json", report.dump(1)), IsOk());
}

TEST(FactsOfCheckpoint, SaysWhatTheFileSays) {
  const auto facts = FactsOfCheckpoint(Checkpoint(), "runs/../a.safetensors");
  ASSERT_THAT(facts, IsOk());
  EXPECT_EQ(facts->refused, "");
  const campaign::EvalSubject& subject = facts->subject;
  EXPECT_EQ(subject.run, "demo");
  EXPECT_EQ(subject.step, 900u);
  EXPECT_EQ(subject.dataset, "f00");
  EXPECT_EQ(subject.sha256, Sha256Hex(Checkpoint()));
  EXPECT_EQ(subject.file, (std::filesystem::current_path() / "a.safetensors").string());
  EXPECT_THAT(FactsOfCheckpoint(std::vector<std::uint8_t>{1, 2, 3}, "b"), HasCode(Code::kCorrupt));
}

TEST(CompleteReport, NamesVideosAndTheOneCheckpointOfAFollowedRun) {
  const TemporaryFolder folder;
  WriteReport(folder / "eval", {900, 0, 900});
  const Path file = folder / "run/checkpoints/00000900.safetensors";
  ASSERT_THAT(WriteFileAtomically(file, Checkpoint()), IsOk());

  const auto report =
      CompleteReport(folder / "eval", folder / "run", {folder / "eval" / "videos" / "000008-pick-timeout.mp4"},
                     {folder / "eval" / "insights" / "000009.insights"});

  ASSERT_THAT(report, IsOk());
  EXPECT_EQ((*report)["policy"]["step"], 900);
  EXPECT_EQ((*report)["policy"]["sha256"], Sha256Hex(Checkpoint()));
  EXPECT_EQ((*report)["policy"]["file"], file.string());
  EXPECT_EQ((*report)["policy"]["run_id"], "0011") << "what was known stays";
  EXPECT_EQ((*report)["dataset"], "f00");
  EXPECT_FALSE((*report)["per_episode"][0].contains("video"));
  EXPECT_EQ((*report)["per_episode"][1]["video"], "videos/000008-pick-timeout.mp4");
  EXPECT_FALSE((*report)["per_episode"][1].contains("insight"));
  EXPECT_EQ((*report)["per_episode"][2]["insight"], "insights/000009.insights");
  EXPECT_EQ(OrderedJson::parse(*ReadTextFile(folder / "eval/eval.json")), *report);
  const std::string lines = *ReadTextFile(folder / "eval/eval.jsonl");
  EXPECT_EQ(OrderedJson::parse(lines.substr(0, lines.find('\n'))), (*report)["per_episode"][0]);
}

TEST(CompleteReport, TakesFoldersWhoseNamesAreNotUtf8) {
  const TemporaryFolder folder;
  WriteReport(folder / "eval", {900});
  const Path run = folder / "caf\xe9";
  ASSERT_THAT(WriteFileAtomically(run / "checkpoints/00000900.safetensors", Checkpoint()), IsOk());
  const auto report = CompleteReport(folder / "eval", run, {});
  ASSERT_THAT(report, IsOk());
  EXPECT_EQ((*report)["policy"]["sha256"], Sha256Hex(Checkpoint()));
  EXPECT_TRUE(OrderedJson::parse(*ReadTextFile(folder / "eval/eval.json")).is_object());
}

TEST(CompleteReport, NamesNoneOfSeveral) {
  const TemporaryFolder folder;
  WriteReport(folder / "eval", {900, 950});
  ASSERT_THAT(WriteFileAtomically(folder / "run/checkpoints/00000900.safetensors", Checkpoint()), IsOk());

  const auto report = CompleteReport(folder / "eval", folder / "run", {});

  ASSERT_THAT(report, IsOk());
  EXPECT_EQ((*report)["policy"]["step"], 0);
  EXPECT_EQ((*report)["policy"]["sha256"], "");
}

TEST(CompleteReport, ACheckpointThatIsGoneIsNotNamed) {
  const TemporaryFolder folder;
  WriteReport(folder / "eval", {900});
  const auto report = CompleteReport(folder / "eval", folder / "run", {});
  ASSERT_THAT(report, IsOk());
  EXPECT_EQ((*report)["policy"]["step"], 900);
  EXPECT_EQ((*report)["policy"]["sha256"], "");

  ASSERT_THAT(WriteFileAtomically(folder / "eval/eval.json", "[]"), IsOk());
  EXPECT_THAT(CompleteReport(folder / "eval", "", {}), HasCode(Code::kCorrupt));
}

}  // namespace evaluation_record_test
}  // namespace etude::cli
