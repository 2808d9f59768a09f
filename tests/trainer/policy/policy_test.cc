// SPDX-License-Identifier: Apache-2.0
// Tests trainer/policy/policy.cc and graph.cc
#include "trainer/policy/policy.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <thread>

#include "tests/trainer/policy/fixtures.h"
#include "trainer/policy/torch_process.h"

namespace etude::policy {
namespace policy_test {

using testing::HasSubstr;
using torch::Tensor;

/// Parameters whose name starts with `prefix`.
std::int64_t CountParameters(const Policy& policy, const std::string& prefix = "") {
  std::int64_t count = 0;
  for (const auto& item : policy.named_parameters())
    if (item.key().starts_with(prefix)) count += item.value().numel();
  return count;
}

// as for the default camera
PolicyConfig Preset(const std::string& name) {
  PolicyConfig config = LoadConfig<PolicyConfig>("trainer/experiments/policies/" + name + "/base.yaml").value();
  if (config.image.crop.empty()) config.image.crop = {40, 75, 144, 80};
  if (config.tasks.empty()) config.tasks = {"pick", "push", "put_down"};
  return config;
}

Inputs WithSentence(Inputs inputs, int s) {
  inputs.sentence_index = inputs.sentence_index.narrow(1, s, 1).contiguous();
  return inputs;
}

Labels WithSentence(const Labels& labels, int s) {
  Labels one = labels;
  for (auto& [name, label] : one)
    if (label.size(1) > 1) label = label.narrow(1, s, 1).contiguous();
  return one;
}

INSTANTIATE_TEST_SUITE_P(Policy, BothAttentions, testing::Values("module", "shared"));

TEST_P(BothAttentions, GradientsEqualFiniteDifferences) {
  const auto policy = MakePolicy(config_);
  policy->to(torch::kFloat64);
  Inputs inputs = MakeInputs(config_, 3, 2);
  Labels labels = MakeLabels(config_, 3, 2);
  inputs.crop_origin = inputs.crop_origin.to(torch::kFloat64);
  for (auto& [name, label] : labels)
    if (label.is_floating_point()) label = label.to(torch::kFloat64);
  const auto loss = [&] { return policy->Loss(inputs, policy->Forward(inputs), labels).total; };
  loss().backward();

  int checked = 0;
  for (const auto& item : policy->named_parameters()) {
    Tensor flat = item.value().data().view(-1);
    const Tensor grad = item.value().grad();
    ASSERT_TRUE(grad.defined()) << item.key() << " has no gradient";
    // the steepest entry of each tensor: one that a wrong formula would show in
    const auto i = grad.abs().view(-1).argmax().item<std::int64_t>();
    const double value = flat[i].item<double>(), step = 1e-6;
    flat[i] = value + step;
    const double above = loss().item<double>();
    flat[i] = value - step;
    const double below = loss().item<double>();
    flat[i] = value;
    const double expected = (above - below) / (2 * step), actual = grad.view(-1)[i].item<double>();
    EXPECT_NEAR(actual, expected, 1e-5 + 1e-4 * std::abs(expected)) << item.key();
    ++checked;
  }
  EXPECT_GT(checked, 50);
}

TEST_P(BothAttentions, SentencesTogetherEqualSentencesOneByOne) {
  const auto policy = MakePolicy(config_);
  policy->eval();
  const Inputs inputs = MakeInputs(config_, 4, 3);
  const Outputs together = policy->Forward(inputs);
  EXPECT_EQ(together.at("EE2D").register_token.size(1), 1);
  EXPECT_EQ(together.at("EE3D").decoded.at("pose").size(1), 1);
  EXPECT_EQ(together.at("CTRL").decoded.at("trajectory").sizes(), torch::IntArrayRef({4, 3, 12, 10}));
  for (int s = 0; s < 3; ++s) {
    for (const auto& [name, one] : policy->Forward(WithSentence(inputs, s))) {
      const ModuleOutput& all = together.at(name);
      const auto at = all.register_token.size(1) == 1 ? 0 : s;
      EXPECT_LT(MaxDifference(all.register_token.select(1, at), one.register_token.select(1, 0)), 1e-5) << name;
      EXPECT_LT(MaxDifference(all.attention.select(1, at), one.attention.select(1, 0)), 1e-5) << name;
      for (const auto& [kind, value] : one.decoded)
        EXPECT_LT(MaxDifference(all.decoded.at(kind).select(1, at), value.select(1, 0)), 1e-3) << name;
    }
  }
}

TEST_P(BothAttentions, RelabelledLossIsTheMeanOverSentences) {
  const auto policy = MakePolicy(config_);
  policy->eval();
  const Inputs inputs = MakeInputs(config_, 4, 3);
  const Labels labels = MakeLabels(config_, 4, 3);
  const auto together = policy->Loss(inputs, policy->Forward(inputs), labels).terms;
  std::map<std::string, double> mean;
  for (int s = 0; s < 3; ++s) {
    const Inputs one = WithSentence(inputs, s);
    for (const auto& [name, term] : policy->Loss(one, policy->Forward(one), WithSentence(labels, s)).terms)
      mean[name] += term / 3;
  }
  ASSERT_EQ(together.size(), mean.size());
  for (const auto& [name, term] : together) {
    if (name != "CTRL.decode") {
      EXPECT_NEAR(term, mean.at(name), 1e-4 * (1 + std::abs(term))) << name;
    }
  }
  const Inputs first = WithSentence(inputs, 0);
  EXPECT_NEAR(together.at("CTRL.decode"),
              policy->Loss(first, policy->Forward(first), WithSentence(labels, 0)).terms.at("CTRL.decode"), 1e-4);
}

TEST_P(BothAttentions, AttentionRowsSumToOneAndHaveNamedColumns) {
  const auto policy = MakePolicy(config_);
  const Outputs outputs = policy->Forward(MakeInputs(config_, 2, 2));
  for (const auto& [name, output] : outputs) {
    const auto keys = policy->KeysOf(name);
    const bool image = keys[0] == "image";
    EXPECT_EQ(output.attention.size(2), (image ? 24 - 1 : 0) + static_cast<int>(keys.size())) << name;
    EXPECT_LT(MaxDifference(output.attention.sum(-1), torch::ones_like(output.attention.sum(-1))), 1e-5);
    EXPECT_EQ(output.soft_argmax.defined(), image);
  }
  EXPECT_THAT(policy->KeysOf("EE2D"), testing::ElementsAre("image", "joints"));
  EXPECT_THAT(policy->KeysOf("CTRL"),
              testing::ElementsAre("image", "language", "joints", "LANG", "EE2D", "TAR2D", "EE3D", "TAR3D", "DISP"));
}

TEST_P(BothAttentions, WeightsRoundTripBitByBit) {
  const auto a = MakePolicy(config_, 1), b = MakePolicy(config_, 2);
  const Inputs inputs = MakeInputs(config_, 4, 2);
  a->Forward(inputs);  // moves the running statistics
  a->eval();
  b->eval();
  const Tensor before = b->Forward(inputs).at("CTRL").register_token;

  ASSERT_TRUE(b->LoadStateTensors(a->StateTensors()));

  const Tensor wanted = a->Forward(inputs).at("CTRL").register_token,
               found = b->Forward(inputs).at("CTRL").register_token;
  EXPECT_TRUE(torch::equal(wanted, found));
  EXPECT_FALSE(torch::equal(before, found));
}

TEST(Policy, ForwardStopsAtTheLevel) {
  const auto policy = MakePolicy(TinyConfig());
  const Inputs inputs = MakeInputs(policy->config(), 2, 2);
  EXPECT_EQ(policy->levels(), 5);
  EXPECT_EQ(policy->grid(), std::make_pair(4, 6));
  EXPECT_EQ(policy->Forward(inputs, 1).size(), 1U);
  const Outputs outputs = policy->Forward(inputs, 3);
  EXPECT_EQ(outputs.size(), 5U);
  const auto terms = policy->Loss(inputs, outputs, MakeLabels(policy->config(), 2, 2), 2).terms;
  EXPECT_EQ(terms.size(), 6U);  // attention and decoder of LANG, EE2D, TAR2D
}

TEST(Policy, LossTermsSumToTheTotal) {
  const auto policy = MakePolicy(TinyConfig());
  const Inputs inputs = MakeInputs(policy->config(), 2, 2);
  const LossTerms loss = policy->Loss(inputs, policy->Forward(inputs), MakeLabels(policy->config(), 2, 2));
  double sum = 0;
  for (const auto& [name, term] : loss.terms) sum += term;
  EXPECT_EQ(loss.terms.size(), 14U);
  EXPECT_NEAR(loss.total.item<double>(), sum, 1e-4 * sum);
}

TEST(Policy, UnlabelledSamplesGiveFiniteGradients) {
  const auto policy = MakePolicy(TinyConfig());
  const Inputs inputs = MakeInputs(policy->config(), 2, 2);
  Labels labels = MakeLabels(policy->config(), 2, 2);
  for (const char* name : {"target.pixel", "target.position", "target.displacement"}) {
    labels[name][1][1].fill_(std::numeric_limits<float>::quiet_NaN());
    labels[std::string(name) + ".valid"] = torch::tensor({{true, true}, {true, false}});
  }
  const LossTerms loss = policy->Loss(inputs, policy->Forward(inputs), labels);
  loss.total.backward();
  EXPECT_TRUE(std::isfinite(loss.total.item<double>()));
  for (const Tensor& parameter : policy->parameters())
    EXPECT_TRUE(torch::isfinite(parameter.grad()).all().item<bool>());
}

TEST(Policy, AModuleCanBeRemovedAndAddedByName) {
  PolicyConfig without = TinyConfig();
  std::erase_if(without.modules, [](const ModuleConfig& module) { return module.name == "DISP"; });
  ModuleConfig* control = FindModule(without, "CTRL");
  std::erase(control->attend, "DISP");
  std::erase_if(control->decoder.inputs, [](const std::string& input) { return input.ends_with("DISP"); });
  PolicyConfig with = TinyConfig();
  ModuleConfig extra = *FindModule(with, "TAR2D");
  extra.name = "EXTRA";
  with.modules.push_back(extra);

  const auto base = MakePolicy(TinyConfig()), smaller = MakePolicy(without), larger = MakePolicy(with);

  EXPECT_TRUE(smaller->ParametersOf("DISP").empty());
  EXPECT_EQ(smaller->ParametersOf("TAR3D"), base->ParametersOf("TAR3D"));
  EXPECT_EQ(larger->ParametersOf("EXTRA").size(), base->ParametersOf("TAR2D").size());
  EXPECT_EQ(smaller->Forward(MakeInputs(without, 2, 2)).size(), 6U);
  EXPECT_EQ(larger->Forward(MakeInputs(with, 2, 2)).at("EXTRA").decoded.at("pixel").size(1), 2);
  const Status status = smaller->LoadStateTensors(base->StateTensors());
  ASSERT_FALSE(status);
  EXPECT_THAT(status.error().message, HasSubstr("'modules.DISP.attention.key_weight' is not of this policy"));
}

TEST(Policy, LoadingTensorsThatDoNotFitChangesNothing) {
  const auto policy = MakePolicy(TinyConfig());
  const auto other = MakePolicy(TinyConfig(), 2);
  auto tensors = other->StateTensors();
  tensors.erase("image.narrow.weight");
  tensors["image.narrow.bias"] = torch::zeros({3});
  const Tensor before = policy->StateTensors().at("language.vectors").clone();

  const Status status = policy->LoadStateTensors(tensors);

  ASSERT_FALSE(status);
  EXPECT_THAT(status.error().message, HasSubstr("'image.narrow.weight' is missing"));
  EXPECT_THAT(status.error().message, HasSubstr("'image.narrow.bias' is (3), not (8)"));
  EXPECT_TRUE(torch::equal(policy->StateTensors().at("language.vectors"), before));
}

// What the shared encoder makes of the picture is nothing to a module that has its own, and the other way round.
TEST(Policy, AModuleMayLookThroughAnEncoderOfItsOwn) {
  PolicyConfig config = TinyConfig();
  FindModule(config, "TAR2D")->own_image = true;
  const auto policy = MakePolicy(config);
  policy->eval();
  const Inputs inputs = MakeInputs(config, 2, 2);
  const auto pixels = [&](const char* module) { return policy->Forward(inputs).at(module).decoded.at("pixel"); };
  const auto blind = [&](const std::string& encoder) {
    const torch::NoGradGuard no_grad;
    for (const char* tensor : {"narrow.weight", "position.weight"}) policy->StateTensors().at(encoder + tensor).zero_();
  };
  const Tensor hand = pixels("EE2D"), target = pixels("TAR2D");
  blind("image.");
  EXPECT_FALSE(torch::equal(pixels("EE2D"), hand));
  EXPECT_TRUE(torch::equal(pixels("TAR2D"), target));
  const Tensor blind_hand = pixels("EE2D");
  blind("modules.TAR2D.image.");
  EXPECT_FALSE(torch::equal(pixels("TAR2D"), target));
  EXPECT_TRUE(torch::equal(pixels("EE2D"), blind_hand));
}

// The others have no demonstration, so that training need not work them out; nor what such a trajectory corrects.
TEST(Policy, TrainsTrajectoriesOnTheFirstSentenceAlone) {
  PolicyConfig config = CorrectedConfig();
  const auto plans = [](const PolicyConfig& graph, bool training) {
    const auto policy = MakePolicy(graph);
    policy->train(training);
    const Outputs outputs = policy->Forward(MakeInputs(graph, 2, 3));
    return std::pair(outputs.at("CTRL").decoded.at("trajectory"), outputs.at("CTRL2").decoded.at("trajectory"));
  };
  const auto [served, served_corrected] = plans(config, false);
  EXPECT_EQ(served.size(1), 3);
  EXPECT_EQ(served_corrected.size(1), 3);
  const auto [first, first_corrected] = plans(config, true);
  EXPECT_EQ(first.size(1), 1);
  EXPECT_EQ(first_corrected.size(1), 1);

  // one that says something of every sentence needs all of them
  ModuleConfig reader = *FindModule(config, "LANG");
  reader.name = "LATE";
  reader.level = config.modules.back().level + 1;
  reader.reads = {"CTRL"};
  reader.attend = {};
  config.modules.push_back(reader);
  const auto [read, corrected] = plans(config, true);
  EXPECT_EQ(read.size(1), 3);
  EXPECT_EQ(corrected.size(1), 1);
  EXPECT_LT(MaxDifference(first, read.narrow(1, 0, 1)), 1e-5);
  EXPECT_LT(MaxDifference(first_corrected, corrected), 1e-5);
}

TEST(Policy, StateHoldsNormalisationAndRunningStatistics) {
  const auto state = MakePolicy(TinyConfig())->StateTensors();
  EXPECT_TRUE(torch::equal(state.at("normalization_offset_std"), TinyNormalization().offset_std));
  EXPECT_TRUE(state.contains("image.layer0_0_norm.running_mean"));
}

TEST(Policy, TheSeedDecidesTheWeightsAndNothingElse) {
  torch::manual_seed(33);
  const Tensor next = torch::rand({1});
  torch::manual_seed(33);
  const auto a = MakePolicy(TinyConfig(), 7);
  EXPECT_TRUE(torch::equal(torch::rand({1}), next));
  const auto b = MakePolicy(TinyConfig(), 7), c = MakePolicy(TinyConfig(), 8);
  const auto wa = a->StateTensors(), wb = b->StateTensors(), wc = c->StateTensors();
  for (const auto& [name, tensor] : wa) EXPECT_TRUE(torch::equal(tensor, wb.at(name))) << name;
  EXPECT_FALSE(torch::equal(wa.at("image.narrow.weight"), wc.at("image.narrow.weight")));
}

TEST(Policy, ADisplacementBetweenModulesStartsAtTheirDifference) {
  auto policy = MakePolicy(TinyConfig());
  policy->eval();
  const auto outputs = policy->Forward(MakeInputs(TinyConfig(), 2, 3));
  const Tensor hand = outputs.at("EE3D").decoded.at("pose").narrow(-1, 0, 3);
  const Tensor difference = outputs.at("TAR3D").decoded.at("position") - hand;
  EXPECT_TRUE(torch::equal(outputs.at("DISP").decoded.at("displacement"), difference));
}

TEST(Policy, ControlCannotMoveGroundingWhenDetached) {
  PolicyConfig config = TinyConfig();
  ModuleConfig* control = FindModule(config, "CTRL");
  control->reads = {"language", "joints", "EE3D", "TAR3D", "DISP"};
  for (const bool detach : {false, true}) {
    control->detach = control->decoder.detach = detach;
    const auto policy = MakePolicy(config);
    const Inputs inputs = MakeInputs(config, 2, 2);
    const Outputs only{{"CTRL", policy->Forward(inputs).at("CTRL")}};
    policy->Loss(inputs, only, MakeLabels(config, 2, 2)).total.backward();
    const auto moved = [&](const char* name) {
      const Tensor grad = policy->named_parameters()[name].grad();
      return grad.defined() && grad.abs().max().item<float>() > 0;
    };
    for (const char* name : {"image.layer0_0_weight", "modules.TAR2D.attention.key_weight",
                             "modules.TAR3D.decoder.bias", "modules.EE3D.decoder.from.joints"})
      EXPECT_EQ(moved(name), !detach) << name;
    EXPECT_TRUE(moved("language.vectors"));  // verbs are learned here alone
    EXPECT_TRUE(moved("joints.layer0.weight"));
  }
}

TEST(Policy, Bfloat16IsCloseToFloat32) {
  PolicyConfig config = TinyConfig();
  const auto exact = MakePolicy(config);
  config.precision = "bf16";
  const auto rounded = MakePolicy(config);
  const Inputs inputs = MakeInputs(config, 4, 2);
  const Tensor a = exact->Forward(inputs).at("TAR2D").soft_argmax, b = rounded->Forward(inputs).at("TAR2D").soft_argmax;
  // without AVX-512 bf16 is a scalar reference, tens of times slower than float32, which is what is used there
  EXPECT_EQ(MaxDifference(a, b) > 0, HasFastBf16());
  EXPECT_LT(MaxDifference(a, b), 0.5);
}

TEST(Policy, AnswersSeveralThreadsAlike) {
  const auto policy = MakePolicy(TinyConfig());
  policy->eval();
  const Inputs inputs = MakeInputs(policy->config(), 2, 1);
  std::vector<Tensor> results(4);
  std::vector<std::thread> threads;
  for (Tensor& result : results)
    threads.emplace_back([&] {
      torch::NoGradGuard no_grad;
      for (int i = 0; i < 20; ++i) result = policy->Forward(inputs).at("CTRL").decoded.at("trajectory");
    });
  for (std::thread& thread : threads) thread.join();
  for (const Tensor& result : results) EXPECT_TRUE(torch::equal(result, results[0]));
}

TEST(Policy, StatisticsOfTheWrongShapeAreRefused) {
  Normalization bad = TinyNormalization();
  bad.offset_std = torch::ones({3});
  EXPECT_FALSE(Policy::Create(TinyConfig(), bad, 1));
}

TEST(Policy, ParametersAreFoundByTheNamesOfWhatTheyRead) {
  const auto state = MakePolicy(TinyConfig())->StateTensors();
  EXPECT_EQ(state.at("modules.TAR3D.decoder.from.fourier:joints").sizes(), torch::IntArrayRef({8, 6}));
  EXPECT_EQ(state.at("modules.CTRL.decoder.from.class:LANG").sizes(), torch::IntArrayRef({12, 3}));
  EXPECT_EQ(state.at("modules.CTRL.segments.DISP").sizes(), torch::IntArrayRef({8}));

  // the order of a list is no part of the weights: the same names, and loaded weights say the same
  PolicyConfig other = TinyConfig();
  ModuleConfig* control = FindModule(other, "CTRL");
  std::reverse(control->decoder.inputs.begin(), control->decoder.inputs.end());
  control->reads = {"DISP", "TAR3D", "EE3D", "TAR2D", "EE2D", "LANG", "joints", "language", "image"};
  const auto a = MakePolicy(TinyConfig(), 1), b = MakePolicy(other, 2);
  ASSERT_TRUE(b->LoadStateTensors(a->StateTensors()));
  a->eval();
  b->eval();
  const Inputs inputs = MakeInputs(TinyConfig(), 2, 2);
  EXPECT_LT(MaxDifference(a->Forward(inputs).at("CTRL").decoded.at("trajectory"),
                          b->Forward(inputs).at("CTRL").decoded.at("trajectory")),
            1e-5);
}

TEST(Policy, ACropThatNobodyResolvedIsRefused) {
  PolicyConfig config = TinyConfig();
  config.image.crop.clear();
  const auto policy = Policy::Create(config, TinyNormalization(), 1);
  ASSERT_FALSE(policy);
  EXPECT_THAT(policy.error().message, HasSubstr("image.crop"));
}

TEST(Presets, PaperHasItsSizes) {
  const PolicyConfig config = Preset("paper");
  const auto policy = MakePolicy(config, 1, 7);
  EXPECT_EQ(policy->grid(), std::make_pair(28, 28));
  // what is known of the original: 4.51 M convolutions (and 0.087 M to tokens), 2.79 M controller, 0.148 M an attention
  // layer
  EXPECT_NEAR(static_cast<double>(CountParameters(*policy, "image.")), 4.51e6 + 0.087e6, 0.01e6);
  EXPECT_NEAR(static_cast<double>(CountParameters(*policy, "modules.CTRL.decoder")), 2.79e6, 0.01e6);
  EXPECT_NEAR(static_cast<double>(CountParameters(*policy, "attention1.")), 0.148e6, 0.001e6);
  // it has 9.12 M in all; it also maps queries of tokens and keys of slots that nobody uses (0.49 M)
  EXPECT_NEAR(static_cast<double>(CountParameters(*policy) - CountParameters(*policy, "language.")), 9.12e6 - 0.49e6,
              0.12e6);
  policy->eval();
  torch::NoGradGuard no_grad;
  const Outputs outputs = policy->Forward(MakeInputs(config, 1, 1, 7));
  EXPECT_EQ(outputs.at("EE2D").attention.size(2), 784 + 3);
  EXPECT_EQ(outputs.at("CTRL").attention.size(2), 784 + 8);
  EXPECT_EQ(outputs.at("CTRL").decoded.at("trajectory").sizes(), torch::IntArrayRef({1, 1, 12, 10}));
  EXPECT_EQ(outputs.at("TAR3D").decoded.at("pose").size(2), 9);
}

// no soft-argmax: one linear layer from the register to a pixel, as the paper says it
TEST(Presets, PaperReadsPixelsFromTheRegisterAlone) {
  const PolicyConfig config = Preset("paper");
  for (const char* name : {"EE2D", "TAR2D"}) {
    const auto module = std::ranges::find(config.modules, name, &ModuleConfig::name);
    ASSERT_NE(module, config.modules.end());
    EXPECT_EQ(module->decoder.readout, "linear");
    EXPECT_EQ(module->decoder.inputs, std::vector<std::string>{"register"});
  }
}

TEST(Presets, CompactIsSmall) {
  const PolicyConfig config = Preset("compact");
  const auto policy = MakePolicy(config, 1, 7);
  EXPECT_EQ(policy->grid(), std::make_pair(20, 36));
  EXPECT_LT(CountParameters(*policy, "image."), 60'000);
  EXPECT_LT(CountParameters(*policy), 1'500'000);
  const Outputs outputs = policy->Forward(MakeInputs(config, 2, 6, 7));
  EXPECT_EQ(outputs.at("TAR3D").decoded.at("position").sizes(), torch::IntArrayRef({2, 6, 3}));
  EXPECT_EQ(outputs.at("CTRL").decoded.at("trajectory").sizes(), torch::IntArrayRef({2, 1, 12, 10}));
}

}  // namespace policy_test
}  // namespace etude::policy
