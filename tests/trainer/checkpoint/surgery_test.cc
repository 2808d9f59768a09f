// SPDX-License-Identifier: Apache-2.0
// Tests trainer/checkpoint/surgery.cc
#include "trainer/checkpoint/surgery.h"

#include <gmock/gmock.h>

#include <set>

#include "tests/trainer/checkpoint/example_checkpoint.h"
#include "tests/trainer/policy/fixtures.h"
#include "trainer/policy/compose.h"
#include "trainer/policy/parts.h"

namespace etude::checkpoint {
namespace surgery_test {

using policy::FindModule;
using policy::PolicyConfig;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::UnorderedElementsAre;

// the base hierarchy with one module more, which CTRL reads
PolicyConfig WithObstacle() {
  PolicyConfig config = policy::TinyConfig();
  policy::ModuleConfig obstacle = *FindModule(config, "TAR3D");
  obstacle.name = "OBST3D";
  obstacle.decoder.entity = "obstacle";
  config.modules.push_back(obstacle);
  FindModule(config, "CTRL")->decoder.inputs.push_back("position:OBST3D");  // it reads all
  EXPECT_TRUE(config.Validate());
  return config;
}

std::map<std::string, torch::Tensor> Initial(const PolicyConfig& config, int joints = kExampleJoints) {
  return policy::MakePolicy(config, 99, joints)->StateTensors();
}

class SurgeryTest : public ::testing::Test {
 protected:
  SurgeryTest() : source_(ExampleCheckpoint(policy::TinyConfig())) {
    for (auto& [name, tensor] : source_.tensors)
      if (name.starts_with("normalization_")) tensor.fill_(0.5);
  }
  Result<Surgery> Do(const PolicyConfig& config, const SurgeryPlan& plan = {}, int joints = kExampleJoints) {
    return Operate(source_, plan, config, Initial(config, joints), here_);
  }

  Checkpoint source_;
  Embodiment here_ = ExampleEmbodiment();
};

TEST_F(SurgeryTest, CopiesAllThatBothHaveAndBeginsTheRestAnew) {
  const PolicyConfig config = WithObstacle();
  const auto initial = Initial(config);

  const auto surgery = Do(config);

  ASSERT_TRUE(surgery) << surgery.error().message;
  EXPECT_THAT(surgery->fresh, ElementsAre("OBST3D"));
  ASSERT_EQ(surgery->tensors.size(), initial.size());
  for (const auto& [name, tensor] : surgery->tensors) {
    if (name.starts_with("normalization_")) continue;
    const auto original = source_.tensors.find(name);
    if (original != source_.tensors.end()) {
      EXPECT_TRUE(torch::equal(tensor, original->second)) << name;
    } else if (policy::PartOfTensor(name) == "OBST3D") {
      EXPECT_TRUE(torch::equal(tensor, initial.at(name))) << name;
    } else if (name.find(".decoder.") != std::string::npos) {
      EXPECT_EQ(tensor.abs().max().item<float>(), 0) << name << ": at first it decodes what its original did";
    }
  }
  ASSERT_TRUE(surgery->grown.contains("CTRL"));
  EXPECT_THAT(surgery->grown.at("CTRL"), UnorderedElementsAre("decoder.from.position:OBST3D", "segments.OBST3D"));
  EXPECT_THAT(surgery->differences, IsEmpty());
}

TEST_F(SurgeryTest, KeepsTheStatisticsThatCopiedPartsWereTrainedWith) {
  const auto all = Do(policy::TinyConfig());
  ASSERT_TRUE(all);
  for (const auto& [name, tensor] : all->tensors)
    if (name.starts_with("normalization_")) {
      EXPECT_FLOAT_EQ(tensor.flatten()[0].item<float>(), 0.5F) << name;
    }
  const auto own_joints = Do(policy::TinyConfig(), {.fresh = {"joints"}});
  ASSERT_TRUE(own_joints);
  EXPECT_FLOAT_EQ(own_joints->tensors.at("normalization_joint_mean")[0].item<float>(), 0.1F);
  EXPECT_FLOAT_EQ(own_joints->tensors.at("normalization_position_mean")[0].item<float>(), 0.5F);
}

TEST_F(SurgeryTest, TakesNoStatisticsThatNoCopiedPartKnows) {
  const PolicyConfig config = policy::TinyConfig();
  const auto initial = Initial(config);
  struct Case {
    std::vector<std::string> copy;
    std::set<std::string> taken;
  };
  for (const Case& some :
       {Case{{"image", "language", "LANG"}, {}}, Case{{"TAR3D"}, {"position_mean", "position_std"}},
        Case{{"CTRL"}, {"displacement_std", "offset_std"}}, Case{{"joints"}, {"joint_mean", "joint_std"}}}) {
    const auto surgery = Do(config, {.copy = some.copy});
    ASSERT_TRUE(surgery) << surgery.error().message;
    for (const auto& [name, tensor] : surgery->tensors) {
      if (!name.starts_with("normalization_")) continue;
      const bool taken = some.taken.contains(name.substr(std::string("normalization_").size()));
      EXPECT_TRUE(torch::equal(tensor, taken ? source_.tensors.at(name) : initial.at(name)))
          << name << " with " << some.copy.back();
    }
  }
}

TEST_F(SurgeryTest, BeginsAnewWhatKnowsAnotherRobot) {
  PolicyConfig config = policy::TinyConfig();
  FindModule(config, "EE3D")->decoder.inputs = {"register", "joint_token"};
  FindModule(config, "TAR3D")->decoder.inputs = {"register", "position:EE3D"};
  config.robot_specific = {"joints"};
  source_ = ExampleCheckpoint(config);
  here_.robot = "panda";

  const auto surgery = Do(config, {}, 9);
  ASSERT_TRUE(surgery) << surgery.error().message;
  EXPECT_THAT(surgery->fresh, ElementsAre("joints"));
  EXPECT_EQ(surgery->tensors.at("normalization_joint_mean").numel(), 9);
  EXPECT_THAT(surgery->differences, ElementsAre(HasSubstr("robot: panda here, ur5 there")));

  const auto frozen = Do(config, {.freeze = {"joints"}}, 9);
  ASSERT_FALSE(frozen);
  EXPECT_THAT(frozen.error().message, HasSubstr("joints: frozen, but not copied"));
}

TEST_F(SurgeryTest, RefusesEveryPartThatDoesNotFitByName) {
  PolicyConfig config = policy::TinyConfig();
  FindModule(config, "TAR3D")->decoder.hidden = {9};
  FindModule(config, "LANG")->decoder.entity = "reference";
  FindModule(config, "DISP")->query = "TAR3D";

  const auto surgery = Do(config);

  ASSERT_FALSE(surgery);
  EXPECT_EQ(surgery.error().code, Code::kInvalidArgument);
  for (const char* part :
       {"TAR3D: hidden is", "LANG: entity is \"target\" there, \"reference\" here", "DISP: query is"})
    EXPECT_THAT(surgery.error().message, HasSubstr(part));
  EXPECT_TRUE(Do(config, {.fresh = {"TAR3D", "LANG", "DISP"}}));
}

// the same shapes, another meaning
TEST_F(SurgeryTest, RefusesWeightsThatWouldComputeSomethingElse) {
  PolicyConfig config = policy::TinyConfig();
  config.objects = {"red", "green", "blue"};
  const auto classes = Do(config);
  ASSERT_FALSE(classes);
  EXPECT_THAT(classes.error().message, HasSubstr("LANG: objects is"));
  config = policy::TinyConfig();
  config.heads = 4;
  const auto heads = Do(config);
  ASSERT_FALSE(heads);
  EXPECT_THAT(heads.error().message, HasSubstr("CTRL: heads is 2 there, 4 here"));
  config = policy::TinyConfig();
  config.image.pixel_mean = 3;
  const auto pixels = Do(config);
  ASSERT_FALSE(pixels);
  EXPECT_THAT(pixels.error().message, HasSubstr("image: pixel_mean is"));
}

// What an encoder, or all of them, would compute otherwise; begun anew, an encoder may be any.
TEST_F(SurgeryTest, RefusesEncodersThatAreOthersUnlessTheyBeginAnew) {
  struct Case {
    const char* part;
    const char* says;
    void (*change)(PolicyConfig&);
  };
  for (const Case& other :
       {Case{"image", "image: pixel_scale is 60.0 there, 30.0 here",
             [](PolicyConfig& config) { config.image.pixel_scale = 30; }},
        Case{"language", "language: language is {", [](PolicyConfig& config) { config.language.hidden = 9; }},
        Case{"joints", "joints: joint_hidden is [8] there, [9] here",
             [](PolicyConfig& config) { config.joint_hidden = {9}; }}}) {
    PolicyConfig config = policy::TinyConfig();
    other.change(config);
    const auto surgery = Do(config);
    ASSERT_FALSE(surgery) << other.part;
    EXPECT_EQ(surgery.error().code, Code::kInvalidArgument);
    EXPECT_THAT(surgery.error().message, HasSubstr(other.says));
    EXPECT_THAT(surgery.error().message, HasSubstr("begin with run demo step 100"));
    const auto anew = Do(config, {.fresh = {other.part}});
    ASSERT_TRUE(anew) << anew.error().message;
    EXPECT_THAT(anew->fresh, ElementsAre(other.part));
  }
  PolicyConfig config = policy::TinyConfig();
  config.activation = "relu";
  const auto surgery = Do(config, {.fresh = {"image"}});
  ASSERT_FALSE(surgery);
  for (const char* part : {"CTRL: activation is", "joints: activation is"})
    EXPECT_THAT(surgery.error().message, HasSubstr(part)) << "it is a matter of every part";
}

TEST_F(SurgeryTest, TakesEncodersWhateverModulesHeadsAndActivationsAre) {
  PolicyConfig config = policy::TinyConfig();
  config.heads = 4;
  EXPECT_TRUE(Do(config, {.copy = {"image", "language", "joints"}}));
  const auto module = Do(config, {.copy = {"image", "EE2D"}});
  ASSERT_FALSE(module);
  EXPECT_THAT(module.error().message, HasSubstr("EE2D: heads is 2 there, 4 here"));
  config = policy::TinyConfig();
  config.activation = "relu";
  EXPECT_TRUE(Do(config, {.copy = {"image"}}));
  EXPECT_FALSE(Do(config, {.copy = {"joints"}}));
}

TEST_F(SurgeryTest, RefusesAModuleThatReadLessNow) {
  PolicyConfig config = policy::TinyConfig();
  FindModule(config, "CTRL")->decoder.inputs = {"register", "language"};
  const auto surgery = Do(config);
  ASSERT_FALSE(surgery);
  EXPECT_THAT(surgery.error().message, HasSubstr("decoder.from.class:LANG is there and not here"));
}

TEST_F(SurgeryTest, ANewKeyThatNoTensorIsNamedAfterIsGrowth) {
  PolicyConfig config = policy::TinyConfig();
  FindModule(config, "DISP")->reads.push_back("image");
  const auto surgery = Do(config);
  ASSERT_TRUE(surgery) << surgery.error().message;
  EXPECT_THAT(surgery->grown.at("DISP"), ElementsAre("reads.image"));
  EXPECT_EQ(FirstLevelToLearn(config, *surgery), 4);
}

// its new columns are zero and would stay so: what is added could never drive
TEST_F(SurgeryTest, RefusesToFreezeAModuleThatReadsMore) {
  const auto surgery = Do(WithObstacle(), {.freeze = {"TAR3D", "CTRL"}});
  ASSERT_FALSE(surgery);
  EXPECT_EQ(surgery.error().code, Code::kInvalidArgument);
  for (const char* said : {"CTRL: frozen, but it reads what its original did not", "decoder.from.position:OBST3D",
                           "leave it out of init.freeze"})
    EXPECT_THAT(surgery.error().message, HasSubstr(said));
  EXPECT_THAT(surgery.error().message, testing::Not(HasSubstr("TAR3D: frozen")));
  const auto some = Do(WithObstacle(), {.freeze = {"TAR3D"}});
  EXPECT_TRUE(some) << some.error().message;
}

TEST_F(SurgeryTest, NamesWhatMovesTheAnswersOfFrozenModules) {
  const auto surgery = Do(policy::TinyConfig(), {.freeze = {"joints", "LANG", "EE3D", "EE2D"}});
  ASSERT_TRUE(surgery) << surgery.error().message;
  EXPECT_THAT(surgery->moved.at("LANG"), ElementsAre("language"));
  EXPECT_THAT(surgery->moved.at("EE2D"), ElementsAre("image"));
  EXPECT_FALSE(surgery->moved.contains("EE3D")) << "all that it reads is frozen";
}

// The paper's way to attend: modules of a level share their attention, no tensor is named after what a module reads,
// and most read all that stands before them.
class SharedSurgeryTest : public SurgeryTest {
 protected:
  SharedSurgeryTest() { source_ = ExampleCheckpoint(Base()); }
  static PolicyConfig Base() {
    PolicyConfig config = policy::TinyConfig();
    config.attention = "shared";
    for (const char* name : {"EE3D", "TAR3D", "DISP"}) FindModule(config, name)->reads = {"all"};
    EXPECT_TRUE(config.Validate());
    return config;
  }
  // @param keep  as when it is added to a checkpoint
  static PolicyConfig WithAddition(bool keep) {
    const auto addition = ParseYaml(R"(
modules:
  - {name: OBST2D, level: 2, reads: [all], decoder: {entity: obstacle, quantity: pixel}}
  - {name: OBST3D, level: 3, reads: [all], attend: [OBST2D],
     decoder: {entity: obstacle, quantity: position, readout: mlp, hidden: [8]}}
  - {name: CTRL, attend: [OBST3D]}
)",
                                    "addition");
    const OrderedJson before = ToJson(Base());
    OrderedJson graph = policy::Compose(before, addition.value());
    if (keep) policy::KeepReads(before, graph);
    const auto config = FromJson<PolicyConfig>(graph, "added");
    EXPECT_TRUE(config && config->Validate());
    return *config;
  }
  static std::vector<std::string> AllBut(const std::string& left_out) {
    std::vector<std::string> names{"image", "language", "joints",     "LANG",       "EE2D",       "TAR2D",     "EE3D",
                                   "TAR3D", "DISP",     "attention1", "attention2", "attention3", "attention4"};
    std::erase(names, left_out);
    return names;
  }
  static policy::Outputs Answers(const PolicyConfig& config, const std::map<std::string, torch::Tensor>& tensors) {
    const auto network = policy::MakePolicy(config, 5, kExampleJoints);
    EXPECT_TRUE(network->LoadStateTensors(tensors));
    network->eval();
    const torch::NoGradGuard no_grad;
    return network->Forward(policy::MakeInputs(config, 2, 2, kExampleJoints));
  }
};

TEST_F(SharedSurgeryTest, FrozenModulesAnswerBitForBitWhatTheyDidWhenModulesAreAdded) {
  const PolicyConfig config = WithAddition(true);
  const auto surgery = Do(config, {.freeze = AllBut("")});
  ASSERT_TRUE(surgery) << surgery.error().message;
  EXPECT_THAT(surgery->fresh, UnorderedElementsAre("OBST2D", "OBST3D"));
  ASSERT_EQ(surgery->grown.size(), 1u);
  EXPECT_THAT(surgery->grown.at("CTRL"), UnorderedElementsAre("reads.OBST2D", "reads.OBST3D"));
  EXPECT_THAT(surgery->frozen_attention.at("attention2"), ElementsAre("OBST2D"));
  EXPECT_THAT(surgery->frozen_attention.at("attention3"), ElementsAre("OBST3D"));
  EXPECT_EQ(surgery->frozen_attention.size(), 2u) << "where nothing learns there is nothing to say";
  EXPECT_THAT(surgery->moved, IsEmpty());

  const auto before = Answers(Base(), source_.tensors), after = Answers(config, surgery->tensors);
  for (const char* name : {"LANG", "EE2D", "TAR2D", "EE3D", "TAR3D", "DISP"}) {
    EXPECT_TRUE(torch::equal(before.at(name).register_token, after.at(name).register_token)) << name;
    for (const auto& [quantity, value] : before.at(name).decoded)
      EXPECT_TRUE(torch::equal(value, after.at(name).decoded.at(quantity))) << name << "." << quantity;
  }
}

// a policy's file that says "all" of everything
TEST_F(SharedSurgeryTest, WhatReadsMoreHasGrown) {
  const PolicyConfig config = WithAddition(false);
  const auto surgery = Do(config);
  ASSERT_TRUE(surgery) << surgery.error().message;
  for (const char* name : {"EE3D", "TAR3D"}) EXPECT_THAT(surgery->grown.at(name), ElementsAre("reads.OBST2D"));
  EXPECT_THAT(surgery->grown.at("DISP"), UnorderedElementsAre("reads.OBST2D", "reads.OBST3D"));
  EXPECT_FALSE(surgery->grown.contains("TAR2D"));
  const auto frozen = Do(config, {.freeze = AllBut("")});
  ASSERT_FALSE(frozen);
  EXPECT_THAT(frozen.error().message, HasSubstr("EE3D: frozen, but it reads what its original did not"));
  EXPECT_THAT(frozen.error().message, HasSubstr("(reads.OBST2D): leave it out"));
  const auto before = Answers(Base(), source_.tensors), after = Answers(config, surgery->tensors);
  EXPECT_FALSE(torch::equal(before.at("EE3D").register_token, after.at("EE3D").register_token));
}

TEST_F(SharedSurgeryTest, RefusesToFreezeAModuleWhoseAttentionLearns) {
  const PolicyConfig config = WithAddition(true);
  const auto alone = Do(config, {.freeze = AllBut("attention4")});
  ASSERT_FALSE(alone);
  EXPECT_THAT(alone.error().message, HasSubstr("DISP: frozen, but attention4, which their level shares, learns: freeze "
                                               "attention4 too; leave parts out"));
  const auto beside = Do(config, {.freeze = AllBut("attention3")});
  ASSERT_FALSE(beside);
  EXPECT_THAT(beside.error().message, HasSubstr("EE3D, TAR3D: frozen, but attention3"));
  EXPECT_THAT(beside.error().message, HasSubstr("freeze attention3 too (OBST3D would learn with it as it is)"));
}

// what a run that goes on is asked for, without any surgery
TEST_F(SharedSurgeryTest, ChecksWhatIsFrozenByItself) {
  EXPECT_TRUE(CheckFreeze(Base(), {}));
  EXPECT_TRUE(CheckFreeze(Base(), {"DISP", "attention4"}));
  EXPECT_TRUE(CheckFreeze(policy::TinyConfig(), {"DISP"})) << "each module attends by itself";
  const Status alone = CheckFreeze(Base(), {"DISP"});
  ASSERT_FALSE(alone);
  EXPECT_THAT(alone.error().message, HasSubstr("init.freeze: DISP: frozen, but attention4"));
}

TEST_F(SharedSurgeryTest, RefusesModulesOfAnotherLevelOrThatReadLess) {
  PolicyConfig config = Base();
  FindModule(config, "CTRL")->level = 6;
  FindModule(config, "TAR3D")->reads = {"TAR2D"};
  ASSERT_TRUE(config.Validate());
  const auto surgery = Do(config);
  ASSERT_FALSE(surgery);
  EXPECT_THAT(surgery.error().message, HasSubstr("CTRL: level is 5 there, 6 here"));
  EXPECT_THAT(surgery.error().message, HasSubstr("TAR3D: reads.image is there and not here"));
  const auto anew = Do(config, {.fresh = {"CTRL", "TAR3D"}});
  EXPECT_TRUE(anew) << anew.error().message;

  source_ = ExampleCheckpoint(policy::TinyConfig());
  config = policy::TinyConfig();
  FindModule(config, "CTRL")->level = 6;
  EXPECT_TRUE(Do(config)) << "a module's own attention goes with it";
}

TEST_F(SharedSurgeryTest, LearningStartsWhereAttentionBeginsAnew) {
  const auto surgery = Do(Base(), {.fresh = {"attention2"}});
  ASSERT_TRUE(surgery) << surgery.error().message;
  EXPECT_EQ(FirstLevelToLearn(Base(), *surgery), 2);
}

TEST_F(SurgeryTest, ANewPartMayBeginLikeAnother) {
  const PolicyConfig config = WithObstacle();
  const auto plain = Do(config), surgery = Do(config, {.like = {"OBST3D=TAR3D"}});
  ASSERT_TRUE(surgery) << surgery.error().message;
  EXPECT_THAT(surgery->fresh, ElementsAre("OBST3D")) << "it learns";
  int of_it = 0;
  for (const auto& [name, tensor] : surgery->tensors) {
    if (policy::PartOfTensor(name) != "OBST3D") {
      EXPECT_TRUE(torch::equal(tensor, plain->tensors.at(name))) << name;
      continue;
    }
    ++of_it;
    std::string there = name;
    there.replace(there.find("OBST3D"), 6, "TAR3D");
    EXPECT_TRUE(torch::equal(tensor, source_.tensors.at(there))) << name;
  }
  EXPECT_GT(of_it, 4);
  EXPECT_EQ(surgery->alike.at("OBST3D"), (std::pair<std::string, int>("TAR3D", of_it)));
}

TEST_F(SurgeryTest, PartsMayBeginLikeEachOther) {
  const PolicyConfig config = policy::TinyConfig();
  const auto surgery = Do(config, {.fresh = {"EE2D", "TAR2D"}, .like = {"EE2D=TAR2D", "TAR2D=EE2D"}});
  ASSERT_TRUE(surgery) << surgery.error().message;
  int swapped = 0;
  for (const auto& [name, tensor] : surgery->tensors) {
    const std::string part = policy::PartOfTensor(name), other = part == "EE2D" ? "TAR2D" : "EE2D";
    if (part != "EE2D" && part != "TAR2D") continue;
    std::string there = name;
    there.replace(there.find(part), part.size(), other);
    const auto original = source_.tensors.find(there);
    if (original == source_.tensors.end() || original->second.sizes() != tensor.sizes()) continue;
    EXPECT_TRUE(torch::equal(tensor, original->second)) << name;
    ++swapped;
  }
  EXPECT_GT(swapped, 2);
}

// a first layer as wide as its inputs adds them to its outputs, and nothing added to them leaves that as it was
TEST_F(SurgeryTest, RefusesInputsThatTakeAwayWhatAModuleAddsThemTo) {
  PolicyConfig config = policy::TinyConfig();
  policy::ModuleConfig* lang = FindModule(config, "LANG");
  lang->decoder.readout = "mlp";
  lang->decoder.inputs = {"register"};
  lang->decoder.hidden = {config.width};
  source_ = ExampleCheckpoint(config);
  EXPECT_TRUE(Do(config));
  lang->decoder.inputs = {"register", "language"};
  const auto wider = Do(config);
  ASSERT_FALSE(wider);
  EXPECT_THAT(wider.error().message, HasSubstr("LANG: its decoder's first layer adds there and not here its inputs"));
  EXPECT_TRUE(Do(config, {.fresh = {"LANG"}}));

  lang->decoder.hidden = {2 * config.width};
  source_ = ExampleCheckpoint(config);
  EXPECT_TRUE(Do(config));
  lang->decoder.inputs = {"language", "register"};
  const auto turned = Do(config);
  ASSERT_FALSE(turned);
  EXPECT_THAT(turned.error().message,
              HasSubstr("decoder.inputs are [register, language] there and [language, register]"));
}

TEST_F(SurgeryTest, ANewPartIsLikeAnotherAsFarAsTheyAreOfOneSize) {
  PolicyConfig config = WithObstacle();
  policy::ModuleConfig* obstacle = FindModule(config, "OBST3D");
  ASSERT_FALSE(obstacle->decoder.hidden.empty());
  obstacle->decoder.hidden.back() += 8;
  const auto initial = Initial(config);
  const auto surgery = Do(config, {.like = {"OBST3D=TAR3D"}});
  ASSERT_TRUE(surgery) << surgery.error().message;
  int anew = 0;
  for (const auto& [name, tensor] : surgery->tensors)
    anew += policy::PartOfTensor(name) == "OBST3D" && torch::equal(tensor, initial.at(name)) ? 1 : 0;
  EXPECT_GT(anew, 0);
  EXPECT_GT(surgery->alike.at("OBST3D").second, 2);
  EXPECT_THAT(Do(config, {.like = {"OBST3D"}}).error().message, HasSubstr("'OBST3D' is not NEW=OLD"));
  EXPECT_THAT(Do(config, {.like = {"OBST3=TAR3D"}}).error().message, HasSubstr("did you mean 'OBST3D'"));
  EXPECT_THAT(Do(config, {.like = {"OBST3D=TAR3"}}).error().message, HasSubstr("did you mean 'TAR3D'"));
  EXPECT_THAT(Do(config, {.like = {"DISP=TAR3D"}}).error().message, HasSubstr("DISP: like TAR3D, but it is copied"));
}

TEST_F(SurgeryTest, ANewModulesOwnImageEncoderBeginsAsTheSources) {
  PolicyConfig config = WithObstacle();
  policy::ModuleConfig looks = *FindModule(config, "TAR2D");
  looks.name = "OBST2D";
  looks.own_image = true;
  looks.decoder.entity = "obstacle";
  config.modules.push_back(looks);
  const auto surgery = Do(config);
  ASSERT_TRUE(surgery) << surgery.error().message;
  int of_it = 0;
  for (const auto& [name, tensor] : surgery->tensors) {
    if (!name.starts_with("image.")) continue;
    ++of_it;
    EXPECT_TRUE(torch::equal(surgery->tensors.at("modules.OBST2D." + name), source_.tensors.at(name))) << name;
  }
  EXPECT_GT(of_it, 4);
  EXPECT_EQ(surgery->alike.at("OBST2D.image"), (std::pair<std::string, int>("image", of_it)));

  config.image.pixel_mean += 1;
  const auto anew = Do(config, {.fresh = {"image"}});
  ASSERT_TRUE(anew) << anew.error().message;
  EXPECT_FALSE(anew->alike.contains("OBST2D.image")) << "the same weights would see something else";
}

TEST_F(SurgeryTest, ChecksItsPlan) {
  const PolicyConfig config = WithObstacle();
  EXPECT_THAT(Do(config, {.copy = {"TAR2"}}).error().message, HasSubstr("did you mean 'TAR2D'"));
  EXPECT_THAT(Do(config, {.copy = {"LANG"}, .fresh = {"LANG"}}).error().message, HasSubstr("in copy and in fresh"));
  EXPECT_THAT(Do(config, {.copy = {"OBST3D"}}).error().message, HasSubstr("OBST3D: the checkpoint has no such part"));
  EXPECT_THAT(Do(config, {.freeze = {"OBST3D"}}).error().message, HasSubstr("OBST3D: frozen, but not copied"));
  const auto some = Do(config, {.copy = {"image", "language"}});
  ASSERT_TRUE(some);
  EXPECT_THAT(some->copied, ElementsAre("image", "language"));
}

TEST_F(SurgeryTest, LearningStartsWhereSomethingIsNew) {
  const PolicyConfig base = policy::TinyConfig(), more = WithObstacle();
  EXPECT_EQ(FirstLevelToLearn(more, *Do(more)), 3);  // OBST3D
  EXPECT_EQ(FirstLevelToLearn(base, *Do(base)), 5);
  EXPECT_EQ(FirstLevelToLearn(base, *Do(base, {.fresh = {"DISP"}})), 4);
  EXPECT_EQ(FirstLevelToLearn(base, *Do(base, {.fresh = {"image"}})), 2);
  EXPECT_EQ(FirstLevelToLearn(base, *Do(base, {.fresh = {"joints"}})), 3);  // EE3D attends to them
}

// a run that was stopped in its second stage: before, all that it had not begun was copied as if it were learned
TEST_F(SurgeryTest, WhatTheSourceHadNotBegunIsToBeLearned) {
  const PolicyConfig base = policy::TinyConfig();
  for (const char* module : {"EE3D", "TAR3D", "DISP", "CTRL"}) source_.metadata.modules.at(module) = {};
  const auto surgery = Do(base);
  ASSERT_TRUE(surgery) << surgery.error().message;
  EXPECT_THAT(surgery->untrained, ElementsAre("CTRL", "DISP", "EE3D", "TAR3D"));
  EXPECT_EQ(FirstLevelToLearn(base, *surgery), 3);
  EXPECT_THAT(Do(base, {.freeze = {"CTRL"}}).error().message, HasSubstr("CTRL: frozen, and not trained yet"));
}

}  // namespace surgery_test
}  // namespace etude::checkpoint
