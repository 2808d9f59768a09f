// SPDX-License-Identifier: Apache-2.0
// Tests trainer/publish/checkpoint.cc
#include "trainer/publish/checkpoint.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "services/core/rng.h"
#include "services/store/safetensors.h"
#include "tests/trainer/publish/example_checkpoint.h"

namespace etude::publish {
namespace {

using ::testing::HasSubstr;

// a good checkpoint with one metadata value replaced
std::vector<std::uint8_t> With(const std::string& key, const std::string& value) {
  const auto config = learn::TinyConfig();
  auto file = store::DecodeSafetensors(EncodeCheckpoint(ExampleRequest(config), "demo").value()).value();
  file.metadata[key] = value;
  return store::EncodeSafetensors(file);
}

TEST(Checkpoint, ReadsBackExactlyAndAnswersTheSame) {
  const auto config = learn::TinyConfig();
  const auto request = ExampleRequest(config);
  const auto bytes = EncodeCheckpoint(request, "demo");
  ASSERT_TRUE(bytes) << bytes.error().message;

  const auto checkpoint = DecodeCheckpoint(*bytes);

  ASSERT_TRUE(checkpoint) << checkpoint.error().message;
  EXPECT_EQ(checkpoint->info.run, "demo");
  EXPECT_EQ(checkpoint->info.step, 100u);
  EXPECT_EQ(checkpoint->info.joints, kExampleJoints);
  EXPECT_EQ(checkpoint->info.metrics["TAR3D.cm"], 0.25);
  EXPECT_EQ(ToJson(checkpoint->policy), ToJson(config.policy));
  EXPECT_EQ(checkpoint->info.train_config, ToJson(config));
  ASSERT_EQ(checkpoint->tensors.size(), request.tensors.size());
  for (const auto& [name, tensor] : request.tensors)
    EXPECT_TRUE(torch::equal(checkpoint->tensors.at(name), tensor.contiguous())) << name;
  auto policy = BuildPolicy(*checkpoint);
  ASSERT_TRUE(policy) << policy.error().message;
  for (const auto& [name, tensor] : (*policy)->StateTensors())
    EXPECT_TRUE(torch::equal(tensor, request.tensors.at(name))) << name;
  EXPECT_FALSE((*policy)->is_training());
  EXPECT_EQ(EncodeCheckpoint(request, "demo").value(), *bytes);
}

TEST(Checkpoint, IsRefusedWithItsReason) {
  const auto refused = [](const std::vector<std::uint8_t>& bytes, Code code, const std::string& reason) {
    const auto checkpoint = DecodeCheckpoint(bytes);
    ASSERT_FALSE(checkpoint);
    EXPECT_EQ(checkpoint.error().code, code);
    EXPECT_THAT(checkpoint.error().message, HasSubstr(reason));
  };
  refused(With("version", "9.9.9"), Code::kInvalidArgument, "version 9.9.9");
  refused(With("format", "other"), Code::kCorrupt, "format");
  refused(With("architecture", std::string(64, 'a')), Code::kCorrupt, "architecture");
  refused(With("policy_config", "{}"), Code::kCorrupt, "");
  refused(With("policy_config", "{\"widht\": 3}"), Code::kCorrupt, "did you mean 'width'");
  refused(With("step", "many"), Code::kCorrupt, "step");
  refused(With("joints", "-4"), Code::kCorrupt, "joints");
  refused(With("metrics", "{"), Code::kCorrupt, "metrics");
  refused({1, 2, 3}, Code::kCorrupt, "");
}

TEST(Checkpoint, DoesNotBuildWhenATensorIsMissingOrHasAnotherShape) {
  const auto config = learn::TinyConfig();
  auto request = ExampleRequest(config);
  auto& tensor = request.tensors.begin()->second;
  tensor = torch::zeros({3, 3, 3});
  const auto odd = DecodeCheckpoint(EncodeCheckpoint(request, "demo").value());
  ASSERT_TRUE(odd);
  EXPECT_EQ(BuildPolicy(*odd).error().code, Code::kCorrupt);

  request.tensors.erase(request.tensors.begin());
  const auto missing = DecodeCheckpoint(EncodeCheckpoint(request, "demo").value());
  ASSERT_TRUE(missing);
  EXPECT_EQ(BuildPolicy(*missing).error().code, Code::kCorrupt);
}

// whatever bytes change: a clear refusal or a checkpoint, never a crash
TEST(Checkpoint, SurvivesDamagedBytes) {
  const auto config = learn::TinyConfig();
  const auto good = EncodeCheckpoint(ExampleRequest(config), "demo").value();
  Rng rng(5);
  for (int i = 0; i < 300; ++i) {
    auto bytes = good;
    if (rng.Bernoulli(0.3)) bytes.resize(rng.Below(bytes.size()));
    const std::size_t region = std::min<std::size_t>(bytes.size(), 20000);  // mostly the header
    for (int k = 0; k < 4 && region > 0; ++k) bytes[rng.Below(region)] = static_cast<std::uint8_t>(rng.Below(256));
    const auto checkpoint = DecodeCheckpoint(bytes);
    if (checkpoint) {
      const auto built = BuildPolicy(*checkpoint);
      EXPECT_TRUE(built || !built.error().message.empty());
    } else {
      EXPECT_FALSE(checkpoint.error().message.empty());
    }
  }
}

}  // namespace
}  // namespace etude::publish
