// SPDX-License-Identifier: Apache-2.0
// Tests trainer/learn/begin.cc and runs that begin with a checkpoint
#include <fmt/ranges.h>
#include <gmock/gmock.h>

#include <filesystem>
#include <set>

#include "tests/trainer/learn/trainer_fixture.h"
#include "trainer/checkpoint/readiness.h"
#include "trainer/learn/begin.h"
#include "trainer/policy/parts.h"

namespace etude::learn {
namespace trainer_test {

using ::testing::HasSubstr;

// A base policy on disk, then a run that begins with it.
class InitTest : public TrainerTest {
 protected:
  void SetUp() override {
    TrainerTest::SetUp();
    // trained once for all of them; each has a file of its own
    static checkpoint::Checkpoint trained;
    static std::vector<std::uint8_t> encoded;
    if (encoded.empty()) {
      ASSERT_TRUE(Train(TinyConfig({"steps=20", "ema=0.9"}), folder_ / "base", false, Keeping(trained)));
      const auto bytes = checkpoint::Encode(trained);
      ASSERT_TRUE(bytes);
      encoded.assign(bytes->begin(), bytes->end());
    }
    source_ = trained;
    ASSERT_TRUE(WriteFileAtomically(file_, encoded));
  }
  static Hooks Keeping(checkpoint::Checkpoint& last) {
    Hooks hooks;
    hooks.on_checkpoint = [&last](const checkpoint::Checkpoint& kept) -> Status {
      last.metadata = kept.metadata;
      for (const auto& [name, tensor] : kept.tensors) last.tensors[name] = tensor.detach().clone();
      return {};
    };
    return hooks;
  }
  TrainConfig Begun(std::vector<std::string> overrides) const {
    overrides.insert(overrides.begin(), {"init.from=" + file_.string(), "ema=0.9"});
    return TinyConfig(std::move(overrides));
  }

  Path file_ = folder_ / "base.safetensors";
  checkpoint::Checkpoint source_;
};

TEST_F(InitTest, ARunThatGoesOnByAnotherExperimentIsTold) {
  EXPECT_EQ(OtherRecipe(source_.metadata, Begun({"name=other"})), Begun({}).name);
  EXPECT_EQ(OtherRecipe(source_.metadata, Begun({})), "");
}

// encoders with their running statistics and averaged weights included; what is new starts to learn at its level
TEST_F(InitTest, FrozenPartsStayBitForBitWhileModulesAreAdded) {
  const std::set<std::string> frozen{"image", "language", "joints", "LANG",  "TASK",
                                     "EE2D",  "TAR2D",    "EE3D",   "TAR3D", "DISP"};
  checkpoint::Checkpoint grown;
  ASSERT_TRUE(Train(Begun({"add=[obstacle]", fmt::format("init.freeze=[{}]", fmt::join(frozen, ", "))}),
                    folder_ / "run", false, Keeping(grown)));

  int same = 0, moved = 0;
  for (const auto& [name, tensor] : grown.tensors) {
    const std::string part = policy::PartOfTensor(name);
    if (!part.empty() && !frozen.contains(part)) {
      moved += part == "CTRL" && source_.tensors.contains(name) && !torch::equal(tensor, source_.tensors.at(name));
      continue;
    }
    ++same;
    EXPECT_TRUE(torch::equal(tensor, source_.tensors.at(name))) << name;
  }
  EXPECT_GT(same, 60);
  EXPECT_GT(moved, 5);
  const std::string stages = ReadTextFile(folder_ / "run/curriculum.jsonl").value_or("");
  EXPECT_THAT(stages, HasSubstr("\"from\":2")) << stages;
  EXPECT_THAT(stages, testing::Not(HasSubstr("\"from\":1,"))) << stages;
  EXPECT_EQ(grown.metadata.modules.at("TAR2D").trained_steps, source_.metadata.modules.at("TAR2D").trained_steps);
}

// No episode here has an obstacle, and no sentence speaks of one: what is new has no label, and its weights are those
// that it was drawn with. Nothing of that may drive.
TEST_F(InitTest, AModuleWithoutALossWasNotTrained) {
  checkpoint::Checkpoint grown;
  ASSERT_TRUE(Train(Begun({"add=[obstacle]", "data.clauses=0", "curriculum.enabled=false"}), folder_ / "run", false,
                    Keeping(grown)));
  const auto& modules = grown.metadata.modules;
  EXPECT_EQ(modules.contains("OBST2D") ? modules.at("OBST2D").trained_steps : 0, 0u);
  EXPECT_GT(modules.at("CTRL").trained_steps, source_.metadata.modules.at("CTRL").trained_steps);
  const std::string why = checkpoint::WhyUntrained(grown.metadata);
  EXPECT_THAT(why, HasSubstr("OBST2D has 0 trained steps"));
  EXPECT_THAT(why, HasSubstr("OBST3D has no validation error"));
  EXPECT_THAT(why, testing::Not(HasSubstr("TAR3D")));
}

TEST_F(InitTest, NothingIsKeptOfARunThatBeginsFromNothing) {
  const Status frozen = Train(TinyConfig({"init.freeze=[TAR3D]"}), folder_ / "run");
  ASSERT_FALSE(frozen);
  EXPECT_THAT(frozen.error().message, HasSubstr("init.freeze: TAR3D: nothing was learned yet"));
}

TEST_F(InitTest, WhereEverythingIsFrozenThereIsNothingToTrain) {
  std::string all;
  for (const auto& part : policy::PartsOf(TinyConfig().policy)) all += (all.empty() ? "" : ", ") + part;
  const Status frozen = Train(Begun({"init.freeze=[" + all + "]"}), folder_ / "run");
  ASSERT_FALSE(frozen);
  EXPECT_THAT(frozen.error().message, HasSubstr("nothing is left to train"));
}

// What was measured with the joints of before says nothing of what reads new ones.
TEST_F(InitTest, WhatReadsSomethingNewMayNotDriveBeforeItIsMeasuredAgain) {
  ASSERT_EQ(checkpoint::WhyUntrained(source_.metadata), "");
  checkpoint::Checkpoint first;
  Hooks hooks;
  hooks.on_checkpoint = [&first](const checkpoint::Checkpoint& kept) -> Status {
    if (first.metadata.modules.empty()) first.metadata = kept.metadata;
    return {};
  };
  ASSERT_TRUE(
      Train(Begun({"steps=20", "init.fresh=[joints]", "curriculum.latest_last=0.9"}), folder_ / "run", false, hooks));
  ASSERT_FALSE(first.metadata.modules.empty());
  EXPECT_THAT(checkpoint::WhyUntrained(first.metadata), HasSubstr("CTRL has no validation error"));
  EXPECT_TRUE(first.metadata.modules.at("TAR2D").error) << "it reads nothing of the joints";
}

TEST_F(InitTest, AModuleOfAnObjectThatIsNotThereIsRefused) {
  CampaignSpec spec = SyntheticSpec(kTinyPicture, kTinyPicture);
  spec.objects = {"cube", "coke"};
  AddSyntheticEpisodes(folder_ / "few", spec, 0, 24);
  dataset_ = data::Dataset::Open(folder_ / "few").value();
  const Status refused = Train(TinyConfig({"policy=compact/multi_obstacle"}), folder_ / "run");
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("which the data do not have"));
}

// as where a run begins with a checkpoint
TEST_F(InitTest, ARunThatGoesOnFreezesNothingThatHasNotLearned) {
  const std::vector<std::string> first{"steps=20", "curriculum.latest_last=0.95"};
  Hooks ends;  // at step 10, long before CTRL's stage
  ends.on_checkpoint = [](const checkpoint::Checkpoint&) -> Status { return Fail(Code::kInternal, "no folder"); };
  ASSERT_FALSE(Train(TinyConfig(first), folder_ / "whole", false, ends));
  const auto resumed = [&](const std::string& frozen) {
    std::vector<std::string> overrides = first;
    overrides.insert(overrides.end(), {"init.freeze=[" + frozen + "]"});
    return Train(TinyConfig(overrides), folder_ / "whole", true);
  };
  const Status refused = resumed("CTRL");
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, Code::kInvalidArgument);
  EXPECT_THAT(refused.error().message, HasSubstr("CTRL: not trained yet"));
  const Status learned = resumed("LANG");
  EXPECT_TRUE(learned) << learned.error().message;
}

TEST_F(InitTest, ResumesWithoutTheCheckpointThatItBeganWith) {
  const auto config = Begun({"steps=20"});
  ASSERT_TRUE(Train(config, folder_ / "run"));
  std::filesystem::remove(file_);
  auto longer = config;
  longer.steps = 30;
  EXPECT_TRUE(Train(longer, folder_ / "run", true));
  const Status gone = Train(config, folder_ / "other");
  ASSERT_FALSE(gone);
  EXPECT_THAT(gone.error().message, HasSubstr("base.safetensors"));
}

// asked before hours of collecting
TEST_F(InitTest, WhatCannotBeginIsKnownWithoutData) {
  EXPECT_TRUE(CheckBeginning(Begun({"init.freeze=[image]"}), false));
  const Status no_limit = CheckBeginning(Begun({"steps=0"}), false);
  ASSERT_FALSE(no_limit);
  EXPECT_THAT(no_limit.error().message, HasSubstr("give --steps"));
  const Status nothing_kept = CheckBeginning(TinyConfig({"init.freeze=[image]"}), false);
  ASSERT_FALSE(nothing_kept);
  EXPECT_THAT(nothing_kept.error().message, HasSubstr("nothing was learned yet"));
  const Status no_tower = CheckBeginning(TinyConfig({"policy.language=clip:" + (folder_ / "none").string()}), false);
  ASSERT_FALSE(no_tower);
  EXPECT_EQ(no_tower.error().code, Code::kNotFound);

  const auto begun = Begun({});
  std::filesystem::remove(file_);
  const Status gone = CheckBeginning(begun, false);
  ASSERT_FALSE(gone);
  EXPECT_THAT(gone.error().message, HasSubstr("base.safetensors"));
  EXPECT_TRUE(CheckBeginning(begun, true)) << "it has its own weights by then";
}

TEST_F(InitTest, RefusesPartsThatDoNotFitByName) {
  const Status wide = Train(Begun({"policy.joint_hidden=[16]"}), folder_ / "wide");
  ASSERT_FALSE(wide);
  EXPECT_THAT(wide.error().message, HasSubstr("joints: joint_hidden is [32] there, [16] here"));
  EXPECT_TRUE(Train(Begun({"policy.joint_hidden=[16]", "init.fresh=[joints]"}), folder_ / "wider"));
}

}  // namespace trainer_test
}  // namespace etude::learn
