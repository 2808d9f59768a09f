// SPDX-License-Identifier: Apache-2.0
// Tests trainer/learn: runs on several datasets
#include <gmock/gmock.h>

#include "tests/trainer/learn/trainer_fixture.h"
#include "trainer/learn/run_state.h"

namespace etude::learn {
namespace trainer_test {

using ::testing::HasSubstr;

// Folders "d" (24 episodes) and "e" (16, of another seed), read as one.
class SeveralDatasets : public TrainerTest {
 protected:
  void SetUp() override {
    TrainerTest::SetUp();
    CampaignSpec other = SyntheticSpec(kTinyPicture, kTinyPicture);
    other.seed += 1;
    other.split = {3, 1, 0};  // one of four, exactly
    AddSyntheticEpisodes(folder_ / "e", other, 0, 16);
    Read({"d", "e"});
  }
  void Read(const std::vector<std::string>& names) {
    std::vector<Path> folders;
    for (const auto& name : names) folders.push_back(folder_ / name);
    auto dataset = data::Dataset::Open(folders);
    ASSERT_TRUE(dataset) << dataset.error().message;
    dataset_ = *dataset;
  }
  static std::string Words(const Status& status) { return status ? "" : status.error().message; }
};

TEST_F(SeveralDatasets, TrainAndValidateOnAllOfThemAndTheRunSaysWhich) {
  ASSERT_EQ(Words(Train(TinyConfig({"steps=10"}), folder_ / "run")), "");

  const auto snapshot = dataset_->snapshot();
  EXPECT_EQ(snapshot->episodes().size(), 40u);
  const auto state = LoadRunState(folder_ / "run/training_state.safetensors");
  ASSERT_TRUE(state) << state.error().message;
  EXPECT_EQ(state->validation.size(), snapshot->episode_count(data::Split::kValid));
  EXPECT_GE(state->validation.back(), data::EpisodeEntry::NumberOf(1, 0)) << "of the second, too";
  EXPECT_EQ(state->datasets, (std::vector<std::string>{dataset_->spec_sha256(0), dataset_->spec_sha256(1)}));
  const std::string config = ReadTextFile(folder_ / "run/config.yaml").value();
  for (const char* name : {"d", "e"}) EXPECT_THAT(config, HasSubstr((folder_ / name).string()));

  Read({"d"});
  ASSERT_EQ(Words(Train(TinyConfig({"steps=10"}), folder_ / "alone")), "");
  EXPECT_THAT(ReadTextFile(folder_ / "alone/config.yaml").value(), ::testing::Not(HasSubstr("datasets")));
  EXPECT_EQ(LoadRunState(folder_ / "alone/training_state.safetensors")->datasets.size(), 1u);
  Read({"e"});
  EXPECT_THAT(Words(Train(TinyConfig({"steps=20"}), folder_ / "alone", true)),
              HasSubstr("a dataset of another campaign file"))
      << "before, it was validated on another dataset's episodes of the same numbers";
}

TEST_F(SeveralDatasets, ARunGoesOnWithThemInTheirOrderAndMayGetMore) {
  ASSERT_EQ(Words(Train(TinyConfig({"steps=10"}), folder_ / "run")), "");
  Read({"e", "d"});
  EXPECT_THAT(Words(Train(TinyConfig({"steps=20"}), folder_ / "run", true)), HasSubstr("same order"));
  Read({"d"});
  EXPECT_THAT(Words(Train(TinyConfig({"steps=20"}), folder_ / "run", true)), HasSubstr("same order"));
  CampaignSpec third = SyntheticSpec(kTinyPicture, kTinyPicture);
  third.seed += 2;
  AddSyntheticEpisodes(folder_ / "f", third, 0, 8);
  Read({"d", "e", "f"});
  EXPECT_EQ(Words(Train(TinyConfig({"steps=20"}), folder_ / "run", true)), "");
  EXPECT_EQ(LoadRunState(folder_ / "run/training_state.safetensors")->datasets.size(), 3u);
}

TEST_F(SeveralDatasets, ThatDoNotGoTogetherAreRefusedByName) {
  AddSyntheticEpisodes(folder_ / "large", SyntheticSpec(64, 64), 0, 24);
  Read({"d", "large"});
  const std::string camera = Words(Train(TinyConfig({"steps=10"}), folder_ / "run"));
  for (const std::string& text : {std::string("camera width"), (folder_ / "large").string(), (folder_ / "d").string()})
    EXPECT_THAT(camera, HasSubstr(text));
  CampaignSpec panda = SyntheticSpec(kTinyPicture, kTinyPicture);
  panda.robots = {"panda"};
  AddSyntheticEpisodes(folder_ / "panda", panda, 0, 24);
  Read({"d", "panda"});
  const std::string robot = Words(Train(TinyConfig({"steps=10"}), folder_ / "run"));
  for (const std::string& text : {std::string("the panda's"), (folder_ / "panda").string()})
    EXPECT_THAT(robot, HasSubstr(text));
  // before, two cameras that stand still at different places were taken for one that moves
  CampaignSpec elsewhere = SyntheticSpec(kTinyPicture, kTinyPicture);
  elsewhere.camera.position[0] += 0.1;
  AddSyntheticEpisodes(folder_ / "elsewhere", elsewhere, 0, 24);
  Read({"d", "elsewhere"});
  EXPECT_THAT(Words(Train(TinyConfig({"steps=10"}), folder_ / "run")), HasSubstr("camera pose"));
}

}  // namespace trainer_test
}  // namespace etude::learn
