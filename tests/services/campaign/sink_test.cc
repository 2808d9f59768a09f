// SPDX-License-Identifier: Apache-2.0
// Tests services/campaign/sink.cc
#include "services/campaign/sink.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "services/core/clock.h"
#include "services/core/hash.h"
#include "services/episode/codec.h"
#include "tests/support/matchers.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude::campaign {
namespace sink_test {

CampaignSpec RolloutSpec() {
  CampaignSpec spec = SyntheticSpec();
  spec.mode = "rollout";
  spec.episodes = 3;
  return spec;
}

store::CommitFacts Took(double wall_s) {
  store::CommitFacts facts;
  facts.timings.wall_s = wall_s;
  return facts;
}

Status Commit(EpisodeSink& sink, const Episode& episode, const store::CommitFacts& facts) {
  const EpisodeView view{episode, StreamsOf(episode)};
  const store::ArrivedEpisode arrived{&view, Sha256Hex(EncodeEpisode(episode)), facts};
  return sink.CommitGroup({&arrived, 1}).front();
}

std::vector<OrderedJson> Lines(const Path& file) {
  std::vector<OrderedJson> lines;
  std::istringstream text(ReadTextFile(file).value_or(""));
  for (std::string line; std::getline(text, line);) lines.push_back(OrderedJson::parse(line));
  return lines;
}

OrderedJson Report(const Path& out) { return OrderedJson::parse(ReadTextFile(out / "eval.json").value_or("null")); }

TEST(EvalSink, NowAndThenNoLinksAreWrittenThatAreThere) {
  const TemporaryFolder folder;
  auto sink = OpenSink(folder.path(), RolloutSpec(), {.run = "demo"}).value();
  ASSERT_THAT(Commit(*sink, MakeSyntheticEpisode(RolloutSpec(), 0), Took(1)), IsOk());
  ASSERT_THAT(sink->WriteProgress(), IsOk());
  ASSERT_TRUE(std::filesystem::remove(folder / "rollouts/dataset.hdf5"));
  ASSERT_THAT(sink->WriteProgress(), IsOk());
  EXPECT_FALSE(std::filesystem::exists(folder / "rollouts/dataset.hdf5"));
  EXPECT_EQ(Report(folder.path())["done"], 1);
}

TEST(EvalSink, ARolloutIsARowAtOnceAndTheReportSaysOfWhat) {
  const TemporaryFolder folder;
  const CampaignSpec spec = RolloutSpec();
  const EvalSubject subject{.run_id = "00112233445566aa",
                            .run = "demo",
                            .sha256 = std::string(64, 'a'),
                            .step = 900,
                            .file = "/runs/demo/checkpoints/00000900.safetensors",
                            .dataset = "f00"};
  auto sink = OpenSink(folder.path(), spec, subject);
  ASSERT_THAT(sink, IsOk());
  EXPECT_TRUE(Lines(folder / "eval.jsonl").empty());
  for (std::uint64_t i = 0; i < 3; ++i) {
    ASSERT_THAT(Commit(**sink, MakeSyntheticEpisode(spec, i), Took(1.5)), IsOk());
    EXPECT_EQ(Lines(folder / "eval.jsonl").size(), i + 1) << "nobody has to wait for the report";
  }

  const OrderedJson report = Report(folder.path());
  EXPECT_EQ(report["done"], 3);
  EXPECT_EQ(report["policy"].dump(), OrderedJson({{"run_id", subject.run_id},
                                                  {"run", "demo"},
                                                  {"sha256", subject.sha256},
                                                  {"step", 900},
                                                  {"file", subject.file}})
                                         .dump());
  EXPECT_EQ(report["dataset"], "f00");
  EXPECT_EQ(report["judge"], "strict");
  EXPECT_NEAR(report["created"].get<double>(), WallSeconds(), 120);
  const OrderedJson& row = report["per_episode"][1];
  EXPECT_EQ(row.dump(), Lines(folder / "eval.jsonl")[1].dump());
  EXPECT_EQ(row["robot"], MakeSyntheticEpisode(spec, 1).robot);
  EXPECT_TRUE(row.contains("reference"));
  EXPECT_TRUE(row.contains("success_latched"));
  EXPECT_EQ(row["wall_s"], 1.5);
}

// Whose rollout it is.
EvalSubject RollOutOnce(const Path& folder, const CampaignSpec& spec) {
  EvalSubject subject{.run_id = "00112233445566aa", .run = "demo", .sha256 = std::string(64, 'a'), .step = 900};
  auto sink = OpenSink(folder, spec, subject).value();
  EXPECT_THAT(Commit(*sink, MakeSyntheticEpisode(spec, 1), Took(2)), IsOk());
  EXPECT_THAT(sink->WriteIndex(), IsOk());
  return subject;
}

TEST(EvalSink, OneReportIsOfOnePolicy) {
  const TemporaryFolder folder;
  const CampaignSpec spec = RolloutSpec();
  const EvalSubject first = RollOutOnce(folder.path(), spec);
  const std::string report = ReadTextFile(folder / "eval.json").value();
  EvalSubject other_run = first, other_checkpoint = first;
  other_run.run_id = "ffeeddccbbaa9988";
  other_checkpoint.sha256 = std::string(64, 'b');
  EXPECT_THAT(OpenSink(folder.path(), spec, other_run), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(OpenSink(folder.path(), spec, other_checkpoint), HasCode(Code::kInvalidArgument));
  EXPECT_EQ(ReadTextFile(folder / "eval.json").value(), report);
  EXPECT_THAT(OpenSink(folder.path(), spec, first), IsOk());
}

TEST(EvalSink, RolloutsOfNobodyKnowsWhomAreNotGoneOnWith) {
  const TemporaryFolder folder;
  const CampaignSpec spec = RolloutSpec();
  const EvalSubject first = RollOutOnce(folder.path(), spec);
  std::filesystem::remove(folder / "eval.json");
  EXPECT_THAT(OpenSink(folder.path(), spec, first), MessageHas("no eval.json that says of whom"));
  EXPECT_FALSE(std::filesystem::exists(folder / "eval.json"));
}

// somebody kept the report, and not the gigabytes that it is of
TEST(EvalSink, AReportWithoutItsRolloutsIsNotWrittenAnew) {
  const TemporaryFolder folder;
  const std::string report = R"({"done": 3, "policy": {"run": "demo"}})";
  ASSERT_TRUE(WriteFileAtomically(folder / "eval.json", std::string_view(report)));
  EXPECT_THAT(OpenSink(folder.path(), RolloutSpec()), HasCode(Code::kInvalidArgument));
  EXPECT_EQ(ReadTextFile(folder / "eval.json").value(), report);
}

TEST(EvalSink, GoesOnWhereItStoppedWithoutARowTwice) {
  const TemporaryFolder folder;
  const CampaignSpec spec = RolloutSpec();
  {
    auto sink = OpenSink(folder.path(), spec, {.run = "demo", .sha256 = std::string(64, 'a'), .step = 900});
    ASSERT_THAT(sink, IsOk());
    ASSERT_THAT(Commit(**sink, MakeSyntheticEpisode(spec, 1), Took(2)), IsOk());
  }
  std::ofstream(folder / "eval.jsonl", std::ios::app) << "{\"index\": 2, \"to";
  const double created = Report(folder.path())["created"];

  auto sink = OpenSink(folder.path(), spec);
  ASSERT_THAT(sink, IsOk());
  ASSERT_THAT(Commit(**sink, MakeSyntheticEpisode(spec, 1), Took(9)), IsOk());
  ASSERT_THAT(Commit(**sink, MakeSyntheticEpisode(spec, 0), Took(3)), IsOk());
  ASSERT_THAT((*sink)->WriteIndex(), IsOk());

  const auto lines = Lines(folder / "eval.jsonl");
  ASSERT_EQ(lines.size(), 2u);
  EXPECT_EQ(lines[0]["index"], 1);
  EXPECT_EQ(lines[0]["wall_s"], 2) << "from the journal of the rollouts";
  EXPECT_EQ(lines[1]["index"], 0);
  const OrderedJson report = Report(folder.path());
  EXPECT_EQ(report["created"], created);
  EXPECT_EQ(report["policy"]["step"], 900) << "a start that names no checkpoint takes none away";
  EXPECT_EQ(report["done"], 2);
}

}  // namespace sink_test
}  // namespace etude::campaign
