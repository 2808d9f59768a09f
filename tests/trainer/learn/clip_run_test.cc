// SPDX-License-Identifier: Apache-2.0
// Tests trainer/learn: runs whose language is CLIP's
#include <gmock/gmock.h>

#include <filesystem>
#include <set>

#include "tests/trainer/learn/trainer_fixture.h"
#include "tests/trainer/policy/clip/tiny_clip.h"
#include "trainer/learn/run_state.h"
#include "trainer/policy/clip/text_encoder.h"
#include "trainer/policy/parts.h"

namespace etude::learn {
namespace trainer_test {

using ::testing::HasSubstr;

/// Runs whose language is CLIP's, of a folder that a test may change.
class ClipTest : public TrainerTest {
 protected:
  void SetUp() override {
    TrainerTest::SetUp();
    clip::WriteTinyClip(clip_, Model(1));
  }
  // a tower that reads sentences letter by letter
  static store::Safetensors Model(std::uint32_t seed) {
    return clip::TinyModel({.width = 64, .layers = 1, .hidden = 64, .positions = 256}, seed);
  }
  TrainConfig Config(std::vector<std::string> overrides = {}) const {
    overrides.insert(overrides.begin(), {"policy.language=clip:" + clip_.string(), "ema=0.9", "steps=10"});
    return TinyConfig(std::move(overrides));
  }

  Path clip_ = folder_ / "clip";
};

TEST_F(ClipTest, NothingThatARunLeavesHoldsTheTower) {
  const auto files = ReadBinaryFile(clip_ / "model.safetensors").value();
  std::vector<std::string> kept_names;
  Hooks hooks;
  hooks.on_checkpoint = [&](const checkpoint::Checkpoint& kept) -> Status {
    for (const auto& [name, tensor] : kept.tensors)
      if (policy::PartOfTensor(name) == "language") kept_names.push_back(name);
    EXPECT_EQ(kept.metadata.policy.language.clip_folder(), clip_.lexically_normal().string());
    EXPECT_EQ(kept.metadata.policy.language.sha256, clip::TextEncoder::Open(clip_).value()->sha256());
    return {};
  };
  const Status trained = Train(Config(), folder_ / "run", false, hooks);
  ASSERT_TRUE(trained) << trained.error().message;

  const std::vector<std::string> own{"language.norm.bias", "language.norm.weight", "language.projection.bias",
                                     "language.projection.weight"};
  EXPECT_THAT(std::set<std::string>(kept_names.begin(), kept_names.end()), testing::ElementsAreArray(own));
  const auto state = LoadRunState(folder_ / "run/training_state.safetensors");
  ASSERT_TRUE(state) << state.error().message;
  for (const auto* tensors : {&state->policy, &state->optimizer})
    for (const auto& [name, tensor] : *tensors) {
      const auto language = name.find("language.");
      if (language != std::string::npos) {
        EXPECT_THAT(own, testing::Contains(name.substr(language))) << name;
      }
    }
  // and what is its own is all there
  EXPECT_TRUE(state->optimizer.contains("first/language.projection.weight"));
  EXPECT_TRUE(state->optimizer.contains("average/language.projection.weight"));
  EXPECT_EQ(ReadBinaryFile(clip_ / "model.safetensors").value(), files);
}

TEST_F(ClipTest, GoesOnOnlyWithTheFolderThatItBeganWith) {
  ASSERT_TRUE(Train(Config(), folder_ / "run"));
  const auto resume = [&](std::vector<std::string> overrides) {
    auto config = LoadTrainConfig((folder_ / "run/config.yaml").string(), "trainer/experiments", overrides);
    EXPECT_TRUE(config) << config.error().message;
    return Train(*config, folder_ / "run", true);
  };
  std::filesystem::rename(clip_, folder_ / "moved");
  const Status gone = resume({"steps=12"});
  ASSERT_FALSE(gone);
  EXPECT_EQ(gone.error().code, Code::kNotFound);
  EXPECT_THAT(gone.error().message, HasSubstr(clip_.string()));

  // the same content elsewhere is the same language
  const std::string moved = "policy.language.encoder=clip:" + (folder_ / "moved").string();
  const Status found = resume({"steps=12", moved});
  EXPECT_TRUE(found) << found.error().message;

  clip::WriteTinyClip(clip_, Model(2));
  const Status other = resume({"steps=14", "policy.language.encoder=clip:" + clip_.string()});
  ASSERT_FALSE(other);
  EXPECT_THAT(other.error().message, HasSubstr("policy.language.encoder=clip:DIR"));
  // nor when the hash is forgotten
  const Status forgotten = Train(Config({"steps=14"}), folder_ / "run", true);
  ASSERT_FALSE(forgotten);
  EXPECT_THAT(forgotten.error().message, HasSubstr("architecture"));
}

TEST_F(ClipTest, SaysAtOnceThatTheFolderIsMissing) {
  std::filesystem::remove_all(clip_);
  const Status refused = Train(Config(), folder_ / "run");
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, Code::kNotFound);
  EXPECT_THAT(refused.error().message, HasSubstr("model.safetensors, vocab.json and merges.txt"));
}

}  // namespace trainer_test
}  // namespace etude::learn
