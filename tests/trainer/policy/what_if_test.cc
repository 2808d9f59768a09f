// SPDX-License-Identifier: Apache-2.0
// Tests trainer/policy/what_if.cc
#include "trainer/policy/what_if.h"

#include <gmock/gmock.h>

#include "tests/trainer/policy/fixtures.h"

namespace etude::policy {
namespace what_if_test {

using testing::HasSubstr;

std::string ErrorOf(const std::string& text) {
  const auto parsed = ParseWhatIf(text, TinyConfig());
  return parsed ? "" : parsed.error().message;
}

TEST(WhatIf, IsReadFromTextThatIsNotTrusted) {
  const auto what_if = ParseWhatIf(
      R"({"sentence": "push", "hide": [[1, 2, 3, 4]], "say": {"TAR3D": {"position": [1, 2, 3]}, "LANG": {"class": "red"}}})",
      TinyConfig());
  ASSERT_TRUE(what_if) << what_if.error().message;
  EXPECT_EQ(what_if->sentence, "push");
  EXPECT_EQ(what_if->hide.size(), 1u);
  EXPECT_EQ(what_if->say.size(), 2u);
  EXPECT_FALSE(what_if->worth);
  EXPECT_TRUE(ParseWhatIf("", TinyConfig())->empty());
  const auto worth = ParseWhatIf(R"({"worth": true})", TinyConfig());
  ASSERT_TRUE(worth) << worth.error().message;
  EXPECT_TRUE(worth->worth);
  EXPECT_TRUE(worth->empty()) << "nothing is to be answered otherwise";

  EXPECT_THAT(ErrorOf("[1]"), HasSubstr("JSON map"));
  EXPECT_THAT(ErrorOf(std::string(100000, '[')), HasSubstr("JSON map"));
  EXPECT_THAT(ErrorOf(R"({"sentense": "x"})"), HasSubstr("did you mean 'sentence'"));
  EXPECT_THAT(ErrorOf(R"({"worth": 1})"), HasSubstr("worth: must be true or false"));
  EXPECT_THAT(ErrorOf(R"({"hide": [[1, 2, 3]]})"), HasSubstr("[u0, v0, width, height]"));
  EXPECT_THAT(ErrorOf(R"({"hide": [[1, 2, 3, 1e300]]})"), HasSubstr("lies in no picture"));
  EXPECT_THAT(ErrorOf(R"({"say": {"TAR3E": {"position": [1, 2, 3]}}})"), HasSubstr("did you mean 'TAR3D'"));
  EXPECT_THAT(ErrorOf(R"({"say": {"TAR3D": {"pixel": [1, 2]}}})"), HasSubstr("it says 'position'"));
  EXPECT_THAT(ErrorOf(R"({"say": {"TAR3D": {"position": [1, 2]}}})"), HasSubstr("must be 3 numbers"));
  EXPECT_THAT(ErrorOf(R"({"say": {"TAR3D": {"position": [1, 2, 1e300]}}})"), HasSubstr("lies nowhere near"));
  EXPECT_THAT(ErrorOf(R"({"say": {"EE3D": {"pose": [1, 2, 3, 1, 0, 0, 0, 1, 0]}}})"),
              HasSubstr("must be 3 numbers; its rotation stays"));
  EXPECT_THAT(ErrorOf(R"({"say": {"LANG": {"class": "rde"}}})"), HasSubstr("did you mean 'red'"));
  EXPECT_THAT(ErrorOf(R"({"say": {"CTRL": {"trajectory": [1]}}})"), HasSubstr("cannot be replaced"));
}

TEST(WhatIf, RefusesWhatNothingReads) {
  const std::string said = ErrorOf(R"({"say": {"EE2D": {"pixel": [1, 2]}}})");
  EXPECT_THAT(said, HasSubstr("say.EE2D.pixel: nothing reads what EE2D says here, only its register is read (by EE3D, "
                              "CTRL)"));
  EXPECT_THAT(said, HasSubstr("say LANG.class or TAR2D.pixel or EE3D.pose or TAR3D.position or DISP.displacement "
                              "otherwise, or hide a part of the picture"));

  // as in the paper's graph
  PolicyConfig registers = TinyConfig();
  for (ModuleConfig& module : registers.modules) {
    module.decoder.inputs = {"register"};
    module.decoder.from.clear();
  }
  const auto parsed = ParseWhatIf(R"({"say": {"LANG": {"class": "red"}}})", registers);
  ASSERT_FALSE(parsed);
  EXPECT_EQ(parsed.error().code, Code::kInvalidArgument);
  EXPECT_THAT(parsed.error().message,
              HasSubstr("nothing reads what LANG says here, only its register is read (by "
                        "TAR2D, CTRL), which think replaces; no value that a module says is read in this policy"));
  // where it looks is not what it says
  FindModule(registers, "TAR3D")->decoder.inputs = {"register", "soft_argmax:TAR2D", "register:TAR2D"};
  EXPECT_FALSE(ParseWhatIf(R"({"say": {"TAR2D": {"pixel": [1, 2]}}})", registers));
  FindModule(registers, "TAR3D")->decoder.inputs = {"register", "pixel:TAR2D"};
  EXPECT_TRUE(ParseWhatIf(R"({"say": {"TAR2D": {"pixel": [1, 2]}}})", registers));
}

TEST(WhatIf, HidesWhatLiesInTheCrop) {
  torch::Tensor images = torch::zeros({1, 3, 16, 24}, torch::kUInt8);
  const torch::Tensor origin = torch::tensor({{10.0F, 20.0F}});
  WhatIf what_if;
  what_if.hide = {{12, 21, 4, 2}, {0, 0, 11, 21}, {500, 500, 9, 9}};
  Hide(what_if, images, origin);

  torch::Tensor wanted = torch::zeros({16, 24}, torch::kUInt8);
  wanted.narrow(0, 1, 2).narrow(1, 2, 4).fill_(128);
  wanted[0][0] = 128;  // what of the second one is in the crop
  EXPECT_TRUE(torch::equal(images[0][1], wanted));
}

/// A policy that is asked one observation.
class Asked : public ::testing::Test {
 protected:
  Asked() {
    policy_->eval();
    inputs_.sentences = {"pick up red can"};
    inputs_.sentence_index.zero_();
  }
  Outputs Ask(const std::string& text) const {
    const auto what_if = ParseWhatIf(text, config_);
    EXPECT_TRUE(what_if) << what_if.error().message;
    return policy_->Forward(inputs_, 0, SayInstead(*what_if, config_, ThoughtsOf(*what_if, *policy_, inputs_)));
  }
  Outputs Ask() const { return policy_->Forward(inputs_); }

  const torch::NoGradGuard no_grad_;
  const PolicyConfig config_ = TinyConfig();
  const std::shared_ptr<Policy> policy_ = MakePolicy(config_);
  Inputs inputs_ = MakeInputs(config_, 1, 1);
};

TEST_F(Asked, NobodyAttendsToWhatIsLookedAwayFrom) {
  const auto what_if = ParseWhatIf(R"({"look_away": [[-1000, -1000, 1008, 4000]]})", config_);  // the first 8 px
  ASSERT_TRUE(what_if) << what_if.error().message;
  EXPECT_FALSE(what_if->empty());
  inputs_.crop_origin.zero_();
  const Outputs before = Ask();
  inputs_.unattended = Unattended(*what_if, inputs_.crop_origin);
  const Outputs after = Ask();
  const auto [rows, columns] = policy_->grid();
  const double patch = static_cast<double>(inputs_.images.size(3)) / columns;
  for (const auto& [module, output] : after) {
    if (policy_->KeysOf(module)[0] != "image") continue;
    const torch::Tensor picture = output.head_attention.narrow(-1, 0, rows * columns).reshape({-1, rows, columns});
    const torch::Tensor was =
        before.at(module).head_attention.narrow(-1, 0, rows * columns).reshape({-1, rows, columns});
    for (std::int64_t column = 0; column < columns; ++column) {
      const bool away = (column + 0.5) * patch < 8;
      EXPECT_GT(was.select(-1, column).sum().item<double>(), 0) << module;
      EXPECT_EQ(picture.select(-1, column).sum().item<double>() == 0, away) << module << " column " << column;
    }
    EXPECT_NEAR(output.head_attention.sum(-1).min().item<double>(), 1, 1e-4) << "the rest has it all";
  }
  EXPECT_FALSE(ParseWhatIf(R"({"look_away": [[1, 2, 3]]})", config_));
}

// later modules read what is said instead; earlier ones, and a policy that nobody interferes with, do not notice
TEST_F(Asked, LaterModulesReadWhatIsSaidInstead) {
  const auto plain = Ask(), again = Ask("{}"),
             changed = Ask(R"({"say": {"TAR3D": {"position": [0.5, 0.25, 0.125]}, "LANG": {"class": "green"}}})");

  EXPECT_TRUE(torch::equal(plain.at("CTRL").decoded.at("trajectory"), again.at("CTRL").decoded.at("trajectory")));
  EXPECT_TRUE(torch::equal(plain.at("TAR2D").decoded.at("pixel"), changed.at("TAR2D").decoded.at("pixel")));
  EXPECT_TRUE(torch::equal(changed.at("TAR3D").decoded.at("position").flatten(), torch::tensor({0.5F, 0.25F, 0.125F})));
  EXPECT_EQ(changed.at("LANG").decoded.at("class").argmax(-1).item<std::int64_t>(), 2);
  const auto moved = changed.at("DISP").decoded.at("displacement") - plain.at("DISP").decoded.at("displacement");
  EXPECT_GT(moved.abs().max().item<float>(), 0.01F);
  EXPECT_FALSE(torch::equal(plain.at("CTRL").decoded.at("trajectory"), changed.at("CTRL").decoded.at("trajectory")));
}

TEST_F(Asked, APoseIsSaidElsewhereAndKeepsItsRotation) {
  const auto plain = Ask(), changed = Ask(R"({"say": {"EE3D": {"pose": [0.5, 0.25, 0.125]}}})");

  const torch::Tensor before = plain.at("EE3D").decoded.at("pose"), said = changed.at("EE3D").decoded.at("pose");
  EXPECT_TRUE(torch::equal(said.narrow(-1, 0, 3).flatten(), torch::tensor({0.5F, 0.25F, 0.125F})));
  EXPECT_TRUE(torch::equal(said.narrow(-1, 3, 6), before.narrow(-1, 3, 6)));
  EXPECT_FALSE(torch::equal(changed.at("DISP").decoded.at("displacement"), plain.at("DISP").decoded.at("displacement")))
      << "it is where the hand is";
}

// as the paper's graph is: what a module says reaches nobody, its register does
TEST_F(Asked, LaterModulesReadARegisterOfAnotherSentence) {
  const auto plain = Ask(), changed = Ask(R"({"think": {"LANG": "push the blue box"}})"),
             zero = Ask(R"({"think": {"LANG": "zero"}})");
  inputs_.sentences = {"push the blue box"};
  const auto other = Ask();

  EXPECT_TRUE(torch::equal(changed.at("LANG").register_token, other.at("LANG").register_token));
  EXPECT_TRUE(torch::equal(changed.at("LANG").decoded.at("class"), other.at("LANG").decoded.at("class")));
  EXPECT_TRUE(torch::equal(changed.at("TAR2D").register_token, other.at("TAR2D").register_token)) << "LANG asks for it";
  EXPECT_FALSE(torch::equal(changed.at("TAR2D").register_token, plain.at("TAR2D").register_token));
  EXPECT_FALSE(torch::equal(changed.at("CTRL").register_token, other.at("CTRL").register_token)) << "it hears, too";
  EXPECT_EQ(zero.at("LANG").register_token.abs().max().item<float>(), 0);
  EXPECT_TRUE(torch::equal(zero.at("LANG").decoded.at("class"), plain.at("LANG").decoded.at("class")));
  EXPECT_FALSE(torch::equal(zero.at("TAR2D").register_token, plain.at("TAR2D").register_token));
}

// its register is of the other sentence, its value what is said
TEST_F(Asked, AModuleMaySayOneThingAndThinkAnother) {
  const auto thought = Ask(R"({"think": {"LANG": "push the blue box"}})");
  const auto both = Ask(R"({"think": {"LANG": "push the blue box"}, "say": {"LANG": {"class": "green"}}})");
  EXPECT_TRUE(torch::equal(both.at("LANG").register_token, thought.at("LANG").register_token));
  EXPECT_EQ(both.at("LANG").decoded.at("class").argmax(-1).item<std::int64_t>(), 2);
  EXPECT_TRUE(torch::equal(both.at("TAR2D").register_token, thought.at("TAR2D").register_token));
}

TEST(WhatIf, ThoughtsAreCheckedAsWell) {
  EXPECT_THAT(ErrorOf(R"({"think": ["LANG"]})"), HasSubstr("think: must be a map of at most 8 modules"));
  EXPECT_THAT(ErrorOf(R"({"think": {"LNAG": "zero"}})"), HasSubstr("did you mean 'LANG'"));
  EXPECT_THAT(ErrorOf(R"({"think": {"LANG": 0}})"), HasSubstr("think.LANG: must be a sentence, or 'zero'"));
  EXPECT_THAT(ErrorOf(R"({"think": {"LANG": ""}})"), HasSubstr("must be a sentence"));
  EXPECT_THAT(ErrorOf(R"({"think": {"CTRL": "zero"}})"), HasSubstr("no module reads what CTRL thinks"));
}

TEST(WhatIf, HeadsOfAttentionHaveTheMapAsTheirMean) {
  const PolicyConfig config = TinyConfig();
  const auto policy = MakePolicy(config);
  const torch::NoGradGuard no_grad;
  for (const auto& [name, output] : policy->Forward(MakeInputs(config, 2, 2))) {
    EXPECT_EQ(output.head_attention.size(2), config.heads) << name;
    EXPECT_LT(MaxDifference(output.head_attention.mean(2), output.attention), 1e-6F) << name;
  }
}

}  // namespace what_if_test
}  // namespace etude::policy
