// SPDX-License-Identifier: Apache-2.0
// Tests trainer/checkpoint/schema.cc: files of schema 1, written by the program of that time, open for ever.
#include "trainer/checkpoint/schema.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "services/core/rng.h"
#include "services/episode/action.h"
#include "services/store/safetensors.h"
#include "trainer/checkpoint/checkpoint.h"
#include "trainer/checkpoint/readiness.h"
#include "trainer/policy/answer.h"
#include "trainer/policy/architecture.h"

namespace etude::checkpoint {
namespace schema_test {

using ::testing::HasSubstr;

const Path kData = "tests/trainer/checkpoint/data";

// the observation that the answers beside the files belong to
policy::Inputs FixtureInputs(const policy::PolicyConfig& config, const std::vector<float>& joints) {
  constexpr int kSide = 48;
  Rng rng(3);
  for (std::size_t i = 0; i < joints.size(); ++i) (void)rng.Uniform(-1, 1);
  std::vector<std::uint8_t> pixels(kSide * kSide * 3);
  for (auto& pixel : pixels) pixel = static_cast<std::uint8_t>(rng.Below(256));
  const auto& crop = config.image.crop;
  const auto whole = torch::from_blob(pixels.data(), {1, kSide, kSide, 3}, torch::kUInt8);
  policy::Inputs inputs;
  inputs.images =
      whole.slice(1, crop[1], crop[1] + crop[3]).slice(2, crop[0], crop[0] + crop[2]).clone().permute({0, 3, 1, 2});
  inputs.crop_origin = torch::tensor({static_cast<float>(crop[0]), static_cast<float>(crop[1])}).view({1, 2});
  inputs.joints = torch::tensor(joints).view({1, -1});
  inputs.sentences = {"pick up the red can"};
  inputs.sentence_index = torch::zeros({1, 1}, torch::kInt64);
  return inputs;
}

class Schema1 : public ::testing::TestWithParam<const char*> {};

TEST_P(Schema1, OpensAndAnswersAsItDid) {
  at::set_num_threads(1);
  const std::string name = GetParam();
  const auto checkpoint = ReadFile(kData / (name + "-schema1.safetensors"));
  ASSERT_TRUE(checkpoint) << checkpoint.error().message;
  const Metadata& metadata = checkpoint->metadata;
  EXPECT_EQ(metadata.run, "fixture-" + name);
  EXPECT_EQ(metadata.step, 20u);
  EXPECT_EQ(metadata.embodiment.joints, 7);
  EXPECT_EQ(metadata.embodiment.robot, "");  // schema 1 did not say
  EXPECT_EQ(metadata.modules.at("TAR3D").error, 0.065);
  EXPECT_EQ(metadata.modules.at("LANG").error, 0.5);
  EXPECT_TRUE(CheckTrained(metadata));

  const auto policy = BuildPolicy(*checkpoint);
  ASSERT_TRUE(policy) << policy.error().message;
  const auto answer = OrderedJson::parse(ReadTextFile(kData / (name + "-schema1.answer.json")).value());
  const torch::NoGradGuard no_grad;
  const auto outputs = (*policy)->Forward(FixtureInputs(metadata.policy, answer["joints"].get<std::vector<float>>()));
  const auto trajectory = outputs.at("CTRL").decoded.at("trajectory").flatten().contiguous();
  const auto expected = answer["waypoints"].get<std::vector<float>>();
  ASSERT_EQ(trajectory.numel(), static_cast<std::int64_t>(expected.size()));
  // an old head goes on saying sines and cosines; the server makes 6D of them
  for (std::size_t i = 0; i < expected.size(); ++i)
    EXPECT_NEAR(trajectory.data_ptr<float>()[i], expected[i], 1e-4) << i;
  const auto waypoints = policy::WaypointsOf(metadata.policy, outputs);
  ASSERT_EQ(waypoints.size(), expected.size());
  for (std::size_t k = 0; k < expected.size(); k += kWaypointSize) {
    const auto angle = [&](std::size_t n) { return std::atan2(expected[k + 3 + 2 * n], expected[k + 4 + 2 * n]); };
    EXPECT_LT(AngleBetween(FromVector(&waypoints[k]).X_WE.q, FromEuler({angle(0), angle(1), angle(2)})), 1e-3) << k;
  }
}

INSTANTIATE_TEST_SUITE_P(Fixtures, Schema1, ::testing::Values("compact", "paper"));

TEST(Schema1, SaysThatAnEarlyStageWasNotTrained) {
  auto file = store::ReadSafetensors(kData / "compact-schema1.safetensors");
  ASSERT_TRUE(file) << file.error().message;
  file->metadata["stage"] = "2";
  const auto early = Decode(store::EncodeSafetensors(*file));
  ASSERT_TRUE(early) << early.error().message;
  EXPECT_THAT(WhyUntrained(early->metadata), HasSubstr("CTRL has 0 trained steps"));
  EXPECT_EQ(early->metadata.modules.at("LANG").trained_steps, 20u);
}

TEST(Schema1, IsWrittenAsTodaysWhenItIsWrittenAgain) {
  const auto old = ReadFile(kData / "compact-schema1.safetensors");
  ASSERT_TRUE(old) << old.error().message;
  const auto bytes = Encode(*old);
  ASSERT_TRUE(bytes);
  const auto again = Decode(*bytes);
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(ToJson(again->metadata.policy), ToJson(old->metadata.policy));
  EXPECT_EQ(ToText(again->metadata), ToText(old->metadata));
}

TEST(Schema1, NoticesAConfigurationThatWasChanged) {
  auto file = store::ReadSafetensors(kData / "compact-schema1.safetensors");
  ASSERT_TRUE(file);
  auto policy = OrderedJson::parse(file->metadata["policy_config"]);
  policy["width"] = 32;
  file->metadata["policy_config"] = policy.dump();
  EXPECT_THAT(Decode(store::EncodeSafetensors(*file)).error().message, HasSubstr("architecture"));
}

}  // namespace schema_test
}  // namespace etude::checkpoint
