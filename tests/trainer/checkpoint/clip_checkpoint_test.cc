// SPDX-License-Identifier: Apache-2.0
// Tests what trainer/checkpoint does with a policy whose language is CLIP's: its weights are in no file, and the folder
// that has them is recognised by its content.
#include <gmock/gmock.h>

#include <filesystem>

#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"
#include "tests/trainer/checkpoint/example_checkpoint.h"
#include "tests/trainer/policy/clip/clip_policy.h"
#include "trainer/checkpoint/difference.h"
#include "trainer/checkpoint/graph_picture.h"
#include "trainer/checkpoint/sizes.h"
#include "trainer/checkpoint/surgery.h"
#include "trainer/policy/parts.h"

namespace etude::checkpoint {
namespace clip_checkpoint_test {

using policy::PolicyConfig;
using ::testing::AnyOf;
using ::testing::HasSubstr;
using ::testing::Not;

class ClipCheckpointTest : public ::testing::Test {
 protected:
  void SetUp() override {
    at::set_num_threads(1);
    clip::WriteTinyClip(folder_ / "here");
    config_ = policy::WithClip(folder_ / "here");
    example_ = ExampleCheckpoint(config_);
  }
  /// The same content in another place.
  PolicyConfig Elsewhere() const {
    clip::WriteTinyClip(folder_ / "there");
    return policy::WithClip(folder_ / "there");
  }

  TemporaryFolder folder_;
  PolicyConfig config_;
  Checkpoint example_;
};

TEST_F(ClipCheckpointTest, HoldsNoWeightOfTheTower) {
  const auto bytes = Encode(example_).value();
  EXPECT_LT(bytes.size(), std::filesystem::file_size(folder_ / "here/model.safetensors") / 4);
  const auto again = Decode(bytes);
  ASSERT_THAT(again, IsOk());
  for (const auto& [name, tensor] : again->tensors)
    if (policy::PartOfTensor(name) == "language") {
      EXPECT_THAT(name, AnyOf(HasSubstr("language.projection."), HasSubstr("language.norm.")));
    }
  EXPECT_EQ(again->metadata.policy.language.sha256, config_.language.sha256);
}

TEST_F(ClipCheckpointTest, IsReadWithoutTheFolderAndBuiltWithIt) {
  const auto checkpoint = Decode(Encode(example_).value()).value();
  const auto policy = BuildPolicy(checkpoint);
  ASSERT_THAT(policy, IsOk());
  for (const auto& [name, tensor] : (*policy)->StateTensors())
    EXPECT_TRUE(torch::equal(tensor, example_.tensors.at(name))) << name;
  const torch::Tensor tokens = (*policy)->EncodeSentences({"pick the cup"});

  std::filesystem::rename(folder_ / "here", folder_ / "moved");
  EXPECT_THAT(Decode(Encode(example_).value()), IsOk());
  const auto gone = BuildPolicy(checkpoint);
  EXPECT_THAT(gone, HasCode(Code::kNotFound));
  EXPECT_THAT(gone, MessageHas((folder_ / "here").string()));
  clip::Folders none;
  EXPECT_THAT(BuildPolicy(checkpoint, &none), HasCode(Code::kNotFound));

  clip::Folders moved((folder_ / "moved").string());
  const auto found = BuildPolicy(checkpoint, &moved);
  ASSERT_THAT(found, IsOk());
  EXPECT_TRUE(torch::equal((*found)->EncodeSentences({"pick the cup"}), tokens));
}

TEST_F(ClipCheckpointTest, IsNotBuiltWithOtherContent) {
  clip::WriteTinyClip(folder_ / "here", clip::TinyModel({}, 2));
  const auto changed = BuildPolicy(example_);
  EXPECT_THAT(changed, HasCode(Code::kInvalidArgument));
  EXPECT_THAT(changed, MessageHas("trained with " + config_.language.sha256.substr(0, 12)));

  Checkpoint unsaid = example_;
  unsaid.metadata.policy.language.sha256.clear();
  EXPECT_THAT(BuildPolicy(unsaid), MessageHas("not resolved"));
}

TEST_F(ClipCheckpointTest, ComparesAndCountsTheProjectionOnly) {
  Checkpoint second = example_;
  second.metadata.policy = Elsewhere();
  second.tensors["language.projection.weight"] = 2 * example_.tensors.at("language.projection.weight");
  for (const auto& part : Compare(example_, second)) {
    const bool language = part.part == "language";
    EXPECT_EQ(part.state, language ? PartDifference::State::kChanged : PartDifference::State::kSame) << part.part;
    if (language) {
      EXPECT_EQ(part.numbers, 8 * 48 + 8 + 8 + 8);
    }
  }
}

TEST_F(ClipCheckpointTest, ItsLanguageIsCopiedWhereTheContentIsTheSame) {
  const auto operate = [&](const PolicyConfig& config) {
    return Operate(example_, {.copy = {"language"}}, config,
                   policy::MakePolicy(config, 99, kExampleJoints)->StateTensors(), ExampleEmbodiment());
  };
  const auto same = operate(Elsewhere());
  ASSERT_THAT(same, IsOk());
  EXPECT_TRUE(
      torch::equal(same->tensors.at("language.projection.weight"), example_.tensors.at("language.projection.weight")));

  clip::WriteTinyClip(folder_ / "other", clip::TinyModel({}, 2));
  EXPECT_THAT(operate(policy::WithClip(folder_ / "other")), MessageHas("language: language is"));
  EXPECT_THAT(operate(policy::TinyConfig()), MessageHas("language: language is"));
}

TEST_F(ClipCheckpointTest, SizesAreThoseOfWhatIsThere) {
  PolicyConfig config = config_;
  config.language.buckets = 1 << 24;  // of an encoder that it does not have
  EXPECT_EQ(LeastParameters(config, kExampleJoints), LeastParameters(config_, kExampleJoints));
  EXPECT_LT(LeastParameters(config_, kExampleJoints), LeastParameters(policy::TinyConfig(), kExampleJoints));
  EXPECT_THAT(CheckSizes(config, kExampleJoints, 100'000), IsOk());
}

TEST_F(ClipCheckpointTest, ThePictureOfItsGraphNamesNoPlace) {
  const std::string svg = GraphSvg(example_.metadata);
  EXPECT_THAT(svg, HasSubstr("sentence, clip"));
  EXPECT_THAT(svg, Not(HasSubstr(folder_.path().string())));
}

}  // namespace clip_checkpoint_test
}  // namespace etude::checkpoint
