// SPDX-License-Identifier: Apache-2.0
// Tests trainer/policy/loss.cc against scalar loops.
#include "trainer/policy/loss.h"

#include <cmath>
#include <limits>

#include "tests/trainer/policy/fixtures.h"

namespace etude::policy {
namespace loss_test {

using torch::Tensor;

struct LossCase {
  TokenGrid grid{TinyConfig().image};
  Tensor origin = torch::tensor({{10.0F, 20.0F}, {11.0F, 18.0F}});
  Labels labels;
  ModuleOutput output;
  ModuleConfig module;
  std::vector<std::string> keys{"image", "language", "joints"};

  LossCase() {
    torch::manual_seed(5);
    labels["target.pixel"] = torch::tensor(
        {{{15.0F, 24.0F}, {31.5F, 33.0F}, {20.0F, 28.0F}}, {{12.0F, 19.0F}, {33.0F, 30.0F}, {22.2F, 27.1F}}});
    output.attention = torch::softmax(2 * torch::randn({2, 3, 24 + 2}), -1);
    module.attend = {"image@target"};
  }
  Masked Attend(const std::string& kind) {
    return AttentionLoss(module, {.kind = kind}, keys, output, labels, origin, grid);
  }
  double Decode(const char* entity, const char* quantity) {
    module.decoder.entity = entity;
    module.decoder.quantity = quantity;
    return DecodeLoss(TinyConfig(), module, output, labels, origin, grid).item<double>();
  }
};

/// Gaussian weights of all patches, normalised, in plain C++.
std::vector<double> ScalarTarget(double u, double v) {
  std::vector<double> weights;
  double sum = 0;
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 6; ++column) {
      const double du = u / 4 - (column + 0.5), dv = v / 4 - (row + 0.5);
      weights.push_back(std::exp(-(du * du + dv * dv) / (2 * 0.6 * 0.6)));
      sum += weights.back();
    }
  }
  for (double& weight : weights) weight /= sum;
  return weights;
}

// a trajectory's module is evaluated for the demonstrated sentence, and the other ones' objects are not its
TEST(AttentionLoss, OfOneSentenceIsToThatOnesLabel) {
  for (const char* kind : {"log", "mse"}) {
    LossCase c;
    const Tensor all = c.Attend(kind).loss;
    c.output.attention = c.output.attention.narrow(1, 0, 1);
    const Tensor first = c.Attend(kind).loss;
    ASSERT_EQ(first.sizes(), (std::vector<std::int64_t>{2, 1})) << kind;
    EXPECT_TRUE(torch::equal(first, all.narrow(1, 0, 1))) << kind;
  }
}

TEST(AttentionLoss, LogIsTheCrossEntropyToAGaussianPatch) {
  LossCase c;
  const Masked masked = c.Attend("log");
  for (int b = 0; b < 2; ++b) {
    for (int s = 0; s < 3; ++s) {
      const auto at = c.labels["target.pixel"][b][s] - c.origin[b];
      const auto target = ScalarTarget(at[0].item<double>(), at[1].item<double>());
      double expected = 0;
      for (int p = 0; p < 24; ++p) expected -= target[p] * std::log(c.output.attention[b][s][p].item<double>());
      EXPECT_NEAR(masked.loss[b][s].item<double>(), expected, 1e-4);
    }
  }
  EXPECT_TRUE(masked.valid.all().item<bool>());
}

TEST(AttentionLoss, MseIsOfTheMassOnTheKeySet) {
  LossCase c;
  c.module.attend = {"image@target", "joints"};
  const Masked masked = c.Attend("mse");
  // (15, 24) from (10, 20) lies in row 1, column 1
  const double mass = (c.output.attention[0][0][7] + c.output.attention[0][0][25]).item<double>();
  EXPECT_NEAR(masked.loss[0][0].item<double>(), (mass - 1) * (mass - 1), 1e-6);
}

// the sum is met by one key alone; each of them by nothing but all
TEST(AttentionLoss, MseOfEachKeyIsMetByEqualSharesAlone) {
  LossCase c;
  c.module.attend = {"image@target", "joints"};
  const double patch = c.output.attention[0][0][7].item<double>(), joints = c.output.attention[0][0][25].item<double>();
  EXPECT_NEAR(c.Attend("mse_each").loss[0][0].item<double>(),
              0.5 * ((2 * patch - 1) * (2 * patch - 1) + (2 * joints - 1) * (2 * joints - 1)), 1e-6);
  c.module.attend = {"language", "joints"};
  c.output.attention.zero_();
  c.output.attention.select(-1, 25).fill_(1);
  EXPECT_NEAR(c.Attend("mse").loss[0][0].item<double>(), 0, 1e-6);
  EXPECT_NEAR(c.Attend("mse_each").loss[0][0].item<double>(), 1, 1e-6);
  c.output.attention.select(-1, 24).fill_(0.5);
  c.output.attention.select(-1, 25).fill_(0.5);
  EXPECT_NEAR(c.Attend("mse_each").loss[0][0].item<double>(), 0, 1e-6);
  LossCase one;
  EXPECT_TRUE(torch::equal(one.Attend("mse_each").loss, one.Attend("mse").loss));
}

TEST(AttentionLoss, LogOfSeveralKeysIsOfTheirSum) {
  LossCase c;
  c.module.attend = {"language", "joints"};
  const Masked masked = c.Attend("log");
  const double mass = (c.output.attention[1][2][24] + c.output.attention[1][2][25]).item<double>();
  EXPECT_NEAR(masked.loss[1][2].item<double>(), -std::log(mass), 1e-5);
  EXPECT_EQ(masked.valid.sizes(), torch::IntArrayRef({2, 1}));
}

TEST(AttentionLoss, PixelsOutsideTheCropOrUnlabelledDoNotCount) {
  LossCase c;
  const double all = c.Attend("log").Mean().item<double>();
  c.labels["target.pixel"][0][1] = torch::tensor({34.5F, 33.0F});  // the crop ends at u = 34
  c.labels["target.pixel"][1][0].fill_(std::numeric_limits<float>::quiet_NaN());
  c.labels["target.pixel.valid"] = torch::tensor({{true, true, true}, {false, true, true}});

  const Masked masked = c.Attend("log");

  EXPECT_TRUE(torch::equal(masked.valid, torch::tensor({{true, false, true}, {false, true, true}})));
  const double expected =
      (masked.loss[0][0] + masked.loss[0][2] + masked.loss[1][1] + masked.loss[1][2]).item<double>() / 4;
  EXPECT_NEAR(masked.Mean().item<double>(), expected, 1e-5);
  EXPECT_NE(masked.Mean().item<double>(), all);
}

TEST(AttentionLoss, OfASetIsTheMeanOverItsMembersInView) {
  LossCase c;
  c.module.attend = {"image@others"};
  const Tensor one = torch::tensor({15.0F, 24.0F}), two = torch::tensor({31.5F, 33.0F}),
               out = torch::tensor({90.0F, 9.0F});
  const auto set = [&](const std::vector<Tensor>& pixels) {
    Tensor value = torch::zeros({2, 3, 8, 2}), valid = torch::zeros({2, 3, 8}, torch::kBool);
    for (std::size_t k = 0; k < pixels.size(); ++k) {
      const auto slot = static_cast<std::int64_t>(2 * k);  // where they stand does not matter
      value[0][0][slot] = pixels[k];
      valid[0][0][slot] = true;
    }
    c.labels["others.pixel"] = value;
    c.labels["others.pixel.valid"] = valid;
    return c.Attend("log");
  };
  const double first = set({one}).loss[0][0].item<double>(), second = set({two}).loss[0][0].item<double>();

  EXPECT_NEAR(set({one, two}).loss[0][0].item<double>(), (first + second) / 2, 1e-4);
  EXPECT_NEAR(set({one, out}).loss[0][0].item<double>(), first, 1e-4);
  const Tensor valid = set({one, two}).valid;
  EXPECT_TRUE(valid[0][0].item<bool>());
  EXPECT_EQ(valid.sum().item<std::int64_t>(), 1) << "the other samples have no others";
  EXPECT_FALSE(set({out}).valid.any().item<bool>());

  c.module.attend = {"image@others", "joints"};  // the mass: both patches and the key, each once
  const Masked mass = set({one, two, two});
  const auto& map = c.output.attention[0][0];
  const Tensor both = map[7] + map[3 * 6 + 5] + map[25];
  EXPECT_NEAR(mass.loss[0][0].item<double>(), -std::log(both.item<double>()), 1e-5);
}

TEST(PatchTarget, SumsToOneAtTheBorderToo) {
  const LossCase c;
  const Tensor corner = c.origin.unsqueeze(1).expand({2, 3, 2}).contiguous();
  EXPECT_TRUE(torch::allclose(PatchTarget(corner, c.origin, c.grid, 0.6).sum(-1), torch::ones({2, 3})));
}

double ScalarSmoothL1(double difference, double beta) {
  const double d = std::abs(difference);
  return d < beta ? 0.5 * d * d / beta : d - 0.5 * beta;
}

TEST(DecodeLoss, PositionIsSmoothL1InMetres) {
  LossCase c;
  c.output.decoded["position"] = torch::tensor({{{0.1F, 0.2F, 0.3F}}, {{0.0F, 0.0F, 0.0F}}});
  c.labels["ee.position"] = torch::tensor({{{0.102F, 0.25F, 0.3F}}, {{0.5F, 0.5F, 0.5F}}});
  c.labels["ee.position.valid"] = torch::tensor({{true}, {false}});
  const double expected = 20 * (ScalarSmoothL1(0.002, 0.003) + ScalarSmoothL1(0.05, 0.003)) / 3;
  EXPECT_NEAR(c.Decode("ee", "position"), expected, 1e-5);
}

TEST(DecodeLoss, ClassIsTheCrossEntropyOverObjects) {
  LossCase c;
  c.output.decoded["class"] = torch::tensor({{{1.0F, 2.0F, 0.5F}}});
  c.labels["target.class"] = torch::tensor({{2}}, torch::kInt64);
  const double expected = -0.5 + std::log(std::exp(1.0) + std::exp(2.0) + std::exp(0.5));
  EXPECT_NEAR(c.Decode("target", "class"), expected, 1e-5);
}

TEST(DecodeLoss, TrajectoryCountsValidWaypointsOfTheFirstSentence) {
  LossCase c;
  c.output.decoded["trajectory"] = torch::zeros({1, 2, 12, 10});
  c.output.decoded["trajectory"][0][1].fill_(99);  // another sentence: not labelled
  c.output.gripper_logits = torch::full({1, 2, 12}, 0.7F);
  c.output.waypoint_scale = torch::linspace(0.01, 0.12, 12);  // the fourth one: 4 cm
  Tensor label = torch::zeros({1, 1, 12, 10});
  label[0][0][3][1] = 0.03F;  // m
  label[0][0][3][5] = 0.5F;   // of the rotation
  label[0][0][3][9] = 1;      // closed
  label[0][0][4].fill_(std::numeric_limits<float>::quiet_NaN());
  c.labels["ee.trajectory"] = label;
  Tensor valid = torch::zeros({1, 1, 12}, torch::kBool);
  valid[0][0][3] = true;
  c.labels["ee.trajectory.valid"] = valid;
  const double expected =
      2 * ScalarSmoothL1(0.03 / 0.04, 0.05) / 3 + ScalarSmoothL1(0.5, 0.1) / 6 + 0.5 * std::log(1 + std::exp(-0.7));
  EXPECT_NEAR(c.Decode("ee", "trajectory"), expected, 1e-5);
}

TEST(DecodeLoss, AnAbsentLabelIsNoLoss) {
  LossCase c;
  c.module.decoder.entity = "target";
  c.module.decoder.quantity = "displacement";
  c.output.decoded["displacement"] = torch::zeros({2, 3, 3});
  EXPECT_FALSE(DecodeLoss(TinyConfig(), c.module, c.output, c.labels, c.origin, c.grid).defined());
}

}  // namespace loss_test
}  // namespace etude::policy
