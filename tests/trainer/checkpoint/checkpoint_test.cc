// SPDX-License-Identifier: Apache-2.0
// Tests trainer/checkpoint/checkpoint.cc, metadata.cc and tensors.cc
#include "trainer/checkpoint/checkpoint.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "services/core/rng.h"
#include "services/store/safetensors.h"
#include "tests/trainer/checkpoint/example_checkpoint.h"
#include "tests/trainer/policy/fixtures.h"
#include "trainer/checkpoint/schema.h"
#include "trainer/policy/architecture.h"

namespace etude::checkpoint {
namespace checkpoint_test {

using ::testing::HasSubstr;

// a good checkpoint with one metadata value replaced
std::vector<std::uint8_t> With(const std::string& key, const std::string& value) {
  auto file = store::DecodeSafetensors(Encode(ExampleCheckpoint(policy::TinyConfig())).value()).value();
  file.metadata[key] = value;
  return store::EncodeSafetensors(file);
}

TEST(Checkpoint, ReadsBackExactlyAndAnswersTheSame) {
  const auto example = ExampleCheckpoint(policy::TinyConfig());
  const auto bytes = Encode(example);
  ASSERT_TRUE(bytes) << bytes.error().message;

  const auto again = Decode(*bytes);

  ASSERT_TRUE(again) << again.error().message;
  const Metadata &here = again->metadata, &there = example.metadata;
  EXPECT_EQ(here.run, "demo");
  EXPECT_EQ(here.step, 100u);
  EXPECT_EQ(here.metrics.at("TAR3D.cm"), 0.25);
  EXPECT_EQ(here.words, "can push red the");
  EXPECT_EQ(ToJson(here.embodiment), ToJson(there.embodiment));
  EXPECT_EQ(ToJson(here.policy), ToJson(there.policy));
  EXPECT_EQ(ModulesToJson(here.modules), ModulesToJson(there.modules));
  EXPECT_EQ(here.train_config, there.train_config);
  ASSERT_EQ(again->tensors.size(), example.tensors.size());
  for (const auto& [name, tensor] : example.tensors)
    EXPECT_TRUE(torch::equal(again->tensors.at(name), tensor.contiguous())) << name;
  auto policy = BuildPolicy(*again);
  ASSERT_TRUE(policy) << policy.error().message;
  for (const auto& [name, tensor] : (*policy)->StateTensors())
    EXPECT_TRUE(torch::equal(tensor, example.tensors.at(name))) << name;
  EXPECT_FALSE((*policy)->is_training());
  EXPECT_EQ(Encode(*again).value(), *bytes);
}

TEST(Checkpoint, IsReadWhateverVersionOfTheProgramWroteIt) {
  const auto checkpoint = Decode(With("version", "99.0.0"));
  ASSERT_TRUE(checkpoint) << checkpoint.error().message;
  EXPECT_EQ(checkpoint->metadata.version, "99.0.0");
}

TEST(Checkpoint, SaysInTheFileWhyItIsRefused) {
  auto example = ExampleCheckpoint(policy::TinyConfig());
  example.metadata.modules["CTRL"] = {};
  EXPECT_EQ(ToText(example.metadata).at("refused"), "CTRL has 0 trained steps");
  EXPECT_EQ(Summary(example.metadata)["refused"], "CTRL has 0 trained steps");
  EXPECT_EQ(Summary(example.metadata)["modules"]["DISP"]["trained_steps"], 100);
}

TEST(Checkpoint, IsRefusedWithItsReason) {
  const auto refused = [](const std::vector<std::uint8_t>& bytes, Code code, const std::string& reason) {
    const auto checkpoint = Decode(bytes);
    ASSERT_FALSE(checkpoint);
    EXPECT_EQ(checkpoint.error().code, code);
    EXPECT_THAT(checkpoint.error().message, HasSubstr(reason));
  };
  refused(With("format", "etude checkpoint 3"), Code::kInvalidArgument, "schema 3");
  refused(With("format", "other"), Code::kCorrupt, "format");
  refused(With("format", "etude checkpoint 0"), Code::kCorrupt, "format");
  refused(With("architecture", std::string(64, 'a')), Code::kCorrupt, "architecture");
  refused(With("policy_config", "{}"), Code::kCorrupt, "architecture");
  refused(With("step", "many"), Code::kCorrupt, "step");
  refused(With("embodiment", "{\"joints\": -4}"), Code::kCorrupt, "joints");
  refused(With("embodiment", "{\"joints\": 4, \"width\": 2000000000}"), Code::kCorrupt, "2000000000");
  refused(With("embodiment", "{\"jonts\": 4}"), Code::kCorrupt, "did you mean 'joints'");
  refused(With("modules", "{\"CTRL\": 3}"), Code::kCorrupt, "CTRL");
  refused(With("metrics", "{"), Code::kCorrupt, "metrics");
  // nesting without end is no way to end the process
  refused(With("train_config", std::string(1'000'000, '[')), Code::kCorrupt, "train_config");
  refused({1, 2, 3}, Code::kCorrupt, "");
}

// sizes that the file claims and does not hold: before, gigabytes were allocated, or read beside the picture
TEST(Checkpoint, ClaimsAreCheckedBeforeAnythingIsAllocated) {
  const auto claim = [](auto change) {
    auto example = ExampleCheckpoint(policy::TinyConfig());
    change(example.metadata.policy);
    const auto checkpoint = Decode(Encode(example).value());
    EXPECT_FALSE(checkpoint);
    return checkpoint ? std::string() : checkpoint.error().message;
  };
  EXPECT_THAT(claim([](auto& p) { p.language.buckets = 1 << 24, p.language.width = 4096; }),
              HasSubstr("the file holds"));
  EXPECT_THAT(claim([](auto& p) { p.modules.back().decoder.hidden = {65536, 65536}; }), HasSubstr("the file holds"));
  EXPECT_THAT(claim([](auto& p) { p.image.crop = {-1000, 0, 24, 16}; }), HasSubstr("crop"));
  EXPECT_THAT(claim([](auto& p) { p.image.crop = {2147483600, 0, 100, 16}; }), HasSubstr("crop"));
}

TEST(Checkpoint, DoesNotBuildWhenATensorIsMissingOrHasAnotherShape) {
  auto example = ExampleCheckpoint(policy::TinyConfig());
  auto& tensor = example.tensors.begin()->second;
  tensor = torch::zeros({tensor.numel() + 1});
  const auto odd = Decode(Encode(example).value());
  ASSERT_TRUE(odd) << odd.error().message;
  EXPECT_EQ(BuildPolicy(*odd).error().code, Code::kCorrupt);

  example.tensors["another"] = example.tensors.begin()->second;
  example.tensors.erase(example.tensors.begin());
  const auto missing = Decode(Encode(example).value());
  ASSERT_TRUE(missing) << missing.error().message;
  EXPECT_EQ(BuildPolicy(*missing).error().code, Code::kCorrupt);
}

// whatever bytes change: a clear refusal or a checkpoint, never a crash
TEST(Checkpoint, SurvivesDamagedBytes) {
  const auto good = Encode(ExampleCheckpoint(policy::TinyConfig())).value();
  Rng rng(5);
  for (int i = 0; i < 300; ++i) {
    auto bytes = good;
    if (rng.Bernoulli(0.3)) bytes.resize(rng.Below(bytes.size()));
    const std::size_t region = std::min<std::size_t>(bytes.size(), 20000);  // mostly the header
    for (int k = 0; k < 4 && region > 0; ++k) bytes[rng.Below(region)] = static_cast<std::uint8_t>(rng.Below(256));
    const auto checkpoint = Decode(bytes);
    if (checkpoint) {
      const auto built = BuildPolicy(*checkpoint);
      EXPECT_TRUE(built || !built.error().message.empty());
    } else {
      EXPECT_FALSE(checkpoint.error().message.empty());
    }
  }
}

}  // namespace checkpoint_test
}  // namespace etude::checkpoint
