// SPDX-License-Identifier: Apache-2.0
// Tests worker/view/replay.cc
#include "worker/view/replay.h"

#include <gmock/gmock.h>

#include <cmath>
#include <cstring>
#include <filesystem>

#include "services/core/config.h"
#include "services/episode/codec.h"
#include "services/spec/episode_plan.h"
#include "services/store/dataset.h"
#include "tests/support/matchers.h"
#include "tests/support/sketch_robot.h"
#include "tests/support/temporary_folder.h"
#include "worker/task/attempt.h"

namespace etude {
namespace replay_test {

CampaignSpec QuickSpec() {
  CampaignSpec spec;
  spec.tasks = {"pick"};
  spec.objects = {"coke", "milk", "bread"};
  spec.seed = 20;
  spec.image_stride = 125;
  spec.camera.width = spec.camera.height = 64;
  return spec;
}

OrderedJson Json(const Path& path) { return OrderedJson::parse(ReadTextFile(path).value_or("{}"), nullptr, false); }

// The first attempt at `index` that `wanted` likes.
std::optional<std::uint32_t> FindAttempt(const CampaignSpec& spec, std::uint64_t index,
                                         const std::function<bool(const task::AttemptResult&)>& wanted) {
  auto runner = task::AttemptRunner::Open(spec);
  if (!runner) return std::nullopt;
  for (std::uint32_t attempt = 0; attempt < 20; ++attempt)
    if (wanted(runner->Demonstrate(index, attempt).value())) return attempt;
  return std::nullopt;
}

TEST(ReplayAttempt, FollowsTheWeightsOfTheJournalAndKeepsThem) {
  CampaignSpec spec = QuickSpec();
  spec.tasks = {"pick", "push"};
  spec.adaptive_sampling = {.share = 0.9, .largest_ratio = 3, .every = 10};
  const SamplingEntry entry{.from_index = 10, .weights = WeightsFor({{"push", "milk", 3, 90, 9}}, spec)};
  std::uint64_t index = 10;
  while (!PlanEpisode(spec, index, 0, entry.weights).follows_weights) ++index;
  auto runner = task::AttemptRunner::Open(spec);
  ASSERT_THAT(runner, IsOk());
  std::uint32_t attempt = 0;
  task::AttemptResult made;
  for (; attempt < 20; ++attempt) {
    made = runner->Demonstrate(index, attempt, entry.weights).value();
    if (made.outcome == task::AttemptOutcome::kSuccess) break;
  }
  ASSERT_EQ(made.outcome, task::AttemptOutcome::kSuccess) << made.reason;
  EXPECT_EQ(WeightsOf(made.episode.details), WeightsSha256(entry.weights));

  TemporaryFolder folder;
  const ReplayOptions options{.index = index, .attempt = attempt, .out = folder / "out", .sampling = entry};
  ASSERT_THAT(ReplayAttempt(spec, options, {}), IsOk());

  const auto reader = store::DatasetReader::Open(folder / "out");
  ASSERT_THAT(reader, IsOk());
  const auto again = reader->ReadWhole(index);
  ASSERT_THAT(again, IsOk());
  EXPECT_EQ(EncodeEpisode(*again), EncodeEpisode(made.episode));
  const auto report = store::Verify(folder / "out", store::Quarantine::kNo);
  ASSERT_THAT(report, IsOk());
  EXPECT_EQ(report->good, 1u) << "its journal came along";
}

TEST(ReplayAttempt, MakesASuccessAgain) {
  const CampaignSpec spec = QuickSpec();
  const auto attempt =
      FindAttempt(spec, 0, [](const auto& result) { return result.outcome == task::AttemptOutcome::kSuccess; });
  ASSERT_TRUE(attempt);
  TemporaryFolder folder;
  ASSERT_THAT(ReplayAttempt(spec, {.index = 0, .attempt = *attempt, .out = folder / "out"}, {}), IsOk());

  const auto reader = store::DatasetReader::Open(folder / "out");
  ASSERT_THAT(reader, IsOk());
  const auto episode = reader->ReadWhole(0);
  ASSERT_THAT(episode, IsOk());
  const OrderedJson plan = Json(folder / "out/plan.json"), geometry = Json(folder / "out/geometry.json");
  EXPECT_EQ(plan["outcome"], "success");
  EXPECT_EQ(plan["steps"], episode->steps());
  ASSERT_FALSE(plan["motions"].empty());
  ASSERT_FALSE(plan["nearest"].empty());
  int with_points = 0;
  for (const auto& near : plan["nearest"]) {
    if (!near.contains("a_m") || near["distance_m"] <= 0) continue;
    double square = 0;
    for (int i = 0; i < 3; ++i) square += std::pow(near["a_m"][i].get<double>() - near["b_m"][i].get<double>(), 2);
    EXPECT_NEAR(std::sqrt(square), near["distance_m"].get<double>(), 1e-4) << near.dump();
    ++with_points;
  }
  EXPECT_GT(with_points, 0) << "points as far apart as the distance says";

  // where the bodies were is where the episode says that the objects were
  const auto bytes = ReadBinaryFile(folder / "out/poses.f32");
  ASSERT_THAT(bytes, IsOk());
  const std::size_t bodies = geometry["bodies"].size();
  ASSERT_EQ(bytes->size(), static_cast<std::size_t>(episode->steps()) * bodies * 7 * sizeof(float));
  const auto at = std::find(geometry["bodies"].begin(), geometry["bodies"].end(), OrderedJson(episode->target));
  ASSERT_NE(at, geometry["bodies"].end());
  const std::size_t target = static_cast<std::size_t>(at - geometry["bodies"].begin());
  const int last = episode->steps() - 1;
  std::array<float, 7> row{};
  std::memcpy(row.data(), bytes->data() + (last * bodies + target) * sizeof row, sizeof row);
  const auto expected = episode->FindObject(episode->target)->pose.row(last);
  EXPECT_THAT(row, testing::Pointwise(testing::FloatEq(), std::vector<float>(expected.begin(), expected.end())));
}

TEST(ReplayAttempt, ShowsAFailureUpToItsEnd) {
  CampaignSpec spec = QuickSpec();
  // pushes so hard that what is held is lost
  spec.randomization.disturbance = 0.2;
  spec.randomization.disturbance_probability = 1;
  const auto failed_late = [](const task::AttemptResult& result) {
    return result.outcome != task::AttemptOutcome::kSuccess && result.outcome != task::AttemptOutcome::kSceneInvalid;
  };
  TemporaryFolder folder;
  for (std::uint64_t index = 0; index < 4; ++index) {
    const auto attempt = FindAttempt(spec, index, failed_late);
    if (!attempt) continue;
    const Path out = folder / std::to_string(index);
    ASSERT_THAT(ReplayAttempt(spec, {.index = index, .attempt = *attempt, .out = out}, {}), IsOk());
    const OrderedJson plan = Json(out / "plan.json");
    EXPECT_NE(plan["outcome"], "success");
    EXPECT_FALSE(plan["reason"].get<std::string>().empty());
    if (plan["steps"] == 0) continue;
    const auto reader = store::DatasetReader::Open(out);
    ASSERT_THAT(reader, IsOk());
    const auto episode = reader->ReadWhole(index);
    ASSERT_THAT(episode, IsOk());
    EXPECT_FALSE(episode->success);
    EXPECT_EQ(episode->outcome, plan["outcome"]);
    EXPECT_FALSE(episode->cameras[0].streams.empty());
    return;
  }
  FAIL() << "no attempt failed after it had moved";
}

// before, all was simulated and then nlohmann's exception ended it
TEST(ReplayAttempt, NamesOfARobotMayBeOfAnyBytes) {
  SketchRobot robot;
  robot.InMjcf("<geom type=\"capsule\" size=\"0.034 0.03\"",
               "<geom name=\"Gelenk_\xfc\" type=\"capsule\" size=\"0.034 0.03\"");
  CampaignSpec spec = QuickSpec();
  spec.robots = {robot.yaml()};
  TemporaryFolder folder;
  ASSERT_THAT(ReplayAttempt(spec, {.index = 0, .attempt = 0, .out = folder / "out"}, {}), IsOk());
  EXPECT_TRUE(Json(folder / "out/geometry.json").is_object());
}

TEST(ReplayAttempt, SaysWhyNothingMoved) {
  CampaignSpec spec = QuickSpec();
  spec.tasks = {"place_left"};
  spec.scenes = "first_draw";
  std::optional<std::uint32_t> attempt;
  std::uint64_t index = 0;
  for (; !attempt && index < 4; ++index)
    attempt = FindAttempt(spec, index, [](const auto& r) { return r.outcome == task::AttemptOutcome::kSceneInvalid; });
  ASSERT_TRUE(attempt);
  TemporaryFolder folder;
  ASSERT_THAT(ReplayAttempt(spec, {.index = index - 1, .attempt = *attempt, .out = folder / "out"}, {}), IsOk());
  const OrderedJson plan = Json(folder / "out/plan.json");
  EXPECT_EQ(plan["outcome"], "scene_invalid");
  EXPECT_EQ(plan["steps"], 0);
  EXPECT_FALSE(plan["reason"].get<std::string>().empty());
  EXPECT_FALSE(std::filesystem::exists(folder / "out/dataset.json"));
  EXPECT_TRUE(std::filesystem::exists(folder / "out/geometry.json"));
}

TEST(ReplayAttempt, RefusesAFolderWithSomethingInIt) {
  TemporaryFolder folder;
  ASSERT_TRUE(WriteFileAtomically(folder / "precious", "x"));
  EXPECT_THAT(ReplayAttempt(QuickSpec(), {.out = folder.path()}, {}), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(
      ReplayAttempt(QuickSpec(),
                    {.out = folder / "other", .sampling = SamplingEntry{.weights = {.tasks = {{"fly", 1}}}}}, {}),
      MessageHas("sampling weights"))
      << "of a campaign that follows none";
  CampaignSpec rollout = QuickSpec();
  rollout.mode = "rollout";
  EXPECT_THAT(ReplayAttempt(rollout, {.out = folder / "new"}, {}), HasCode(Code::kInvalidArgument));
}

}  // namespace replay_test
}  // namespace etude
