// SPDX-License-Identifier: Apache-2.0
// Tests trainer/policy/quantities: what each quantity's label is, and that its loss, metric and words agree with it.
#include <gmock/gmock.h>

#include <cmath>

#include "services/core/rng.h"
#include "services/episode/action.h"
#include "tests/support/synthetic_episode.h"
#include "trainer/policy/quantities/output.h"
#include "trainer/policy/quantities/quantity.h"
#include "trainer/policy/quantities/rotation.h"
#include "trainer/policy/torch.h"

namespace etude::policy {
namespace quantities_test {

const Quantity& Named(const char* name) { return *FindQuantity(name); }

using torch::Tensor;

const Normalization& Unit() {
  static const Normalization unit = Normalization::Unit(3);
  return unit;
}

struct Label {
  std::vector<float> values;
  std::vector<std::uint8_t> valid;
};

// the label of one picture of a synthetic episode
Label LabelOf(const Quantity& quantity, const Episode& episode, int step, const char* entity, data::Region view) {
  const language::Command command{"pick", episode.target};
  const std::vector<std::string> classes{"coke", "milk", "cube", "pepsi", "bread", "bottle"};
  static const std::vector<std::string> tasks{"push", "pick"};
  const data::LabelContext context{episode, step, command, classes, view, tasks};
  std::int64_t size = 1;
  for (const auto n : quantity.label_shape()) size *= n;
  Label label{std::vector<float>(static_cast<std::size_t>(size)),
              std::vector<std::uint8_t>(static_cast<std::size_t>(quantity.label_parts()))};
  quantity.FillLabel(context, data::StatesOf(*data::ParseEntity(entity), context).at(0), label.values, label.valid);
  return label;
}

TEST(Quantities, LabelsAreReadOffTheEpisode) {
  const Episode episode = MakeSyntheticEpisode(SyntheticSpec(224, 224), 3);
  const Camera& camera = episode.cameras[0].camera;
  const data::Region all{0, 0, 224, 224};
  const int step = 20;
  const auto pose = episode.FindObject(episode.target)->pose.row(step), hand = episode.eef_pos.row(step);
  const Eigen::Vector3d p(pose[0], pose[1], pose[2]);

  EXPECT_THAT(LabelOf(Named("position"), episode, step, "target", all).values,
              testing::ElementsAre(pose[0], pose[1], pose[2]));
  EXPECT_THAT(LabelOf(Named("displacement"), episode, step, "target", all).values,
              testing::ElementsAre(pose[0] - hand[0], pose[1] - hand[1], pose[2] - hand[2]));
  const Label pixel = LabelOf(Named("pixel"), episode, step, "target", all);
  EXPECT_NEAR(pixel.values[0], camera.Project(p).x(), 1e-3);
  EXPECT_NEAR(pixel.values[1], camera.Project(p).y(), 1e-3);
  EXPECT_TRUE(pixel.valid[0]);
  const auto u = static_cast<int>(pixel.values[0]), v = static_cast<int>(pixel.values[1]);
  EXPECT_FALSE(LabelOf(Named("pixel"), episode, step, "target", {u + 1, v - 4, 8, 8}).valid[0]) << "out of view";
  EXPECT_TRUE(LabelOf(Named("pixel"), episode, step, "target", {u - 1, v - 4, 8, 8}).valid[0]);
  // an upright object, a hand turned by pi about x
  EXPECT_THAT(LabelOf(Named("pose"), episode, step, "target", all).values,
              testing::ElementsAre(pose[0], pose[1], pose[2], 1, 0, 0, 0, 1, 0));
  EXPECT_NEAR(LabelOf(Named("pose"), episode, step, "ee", all).values[7], -1, 1e-6);
  const Label named = LabelOf(Named("class"), episode, step, "object:milk", all);
  EXPECT_EQ(named.values[0], 1);
  const Label task = LabelOf(Named("task"), episode, step, "command", all);
  EXPECT_EQ(task.values[0], 1);
  EXPECT_TRUE(task.valid[0]);
  const Label points = LabelOf(Named("trajectory"), episode, step, "ee", all);
  EXPECT_EQ(points.values.size(), 120u);
  EXPECT_FLOAT_EQ(points.values[0], episode.actions_abs.row(step)[0]);
}

TEST(Quantities, WhatIsNotFiniteHasNoLabel) {
  Episode episode = MakeSyntheticEpisode(SyntheticSpec(), 3);
  for (auto& object : episode.objects) object.pose.values.assign(object.pose.values.size(), NAN);
  for (const Quantity* quantity : {&Named("pixel"), &Named("position"), &Named("pose"), &Named("displacement")})
    EXPECT_FALSE(LabelOf(*quantity, episode, 5, "target", {0, 0, 32, 32}).valid[0]) << quantity->name();
}

// A head that says its label has no loss and no error; its words are the label.
TEST(Quantities, TheLabelItselfIsTheBestAnswer) {
  const Episode episode = MakeSyntheticEpisode(SyntheticSpec(224, 224), 3);
  const Tensor origin = torch::zeros({1, 2});
  const PictureView view{origin, 224, 224};
  for (const char* form : {"6d", "euler_sincos"}) {
    for (const Quantity* quantity : {&Named("pixel"), &Named("position"), &Named("pose"), &Named("displacement")}) {
      const Label label = LabelOf(*quantity, episode, 11, "target", {0, 0, 224, 224});
      const Tensor value = torch::tensor(label.values).view({1, 1, -1});
      const Head head{.rotation = form};
      Tensor said = value;
      if (quantity->name() == "pose") said = WithRotation(value, 3, ToForm(value.narrow(-1, 3, 6), form));
      ModuleOutput output;
      output.decoded[std::string(quantity->name())] = said;
      const Target target{value, torch::ones({1, 1}, torch::kBool)};

      EXPECT_NEAR(quantity->Loss(head, {}, output, target, view).item<double>(), 0, 1e-6) << quantity->name();
      for (const Metric& metric : quantity->Measure(head, output, target))
        EXPECT_NEAR(metric.values.abs().max().item<double>(), 0, 0.1) << quantity->name() << metric.name;
      OrderedJson words;
      quantity->Say(head, output, words);
      ASSERT_EQ(words["value"].size(), label.values.size()) << quantity->name();
      for (std::size_t i = 0; i < label.values.size(); ++i)
        EXPECT_NEAR(words["value"][i].get<double>(), label.values[i], 2e-5) << quantity->name();
    }
  }
}

// The hand is one thing for all sentences of a picture, and a graph may say it for each of them.
TEST(Quantities, WhatIsSaidOfEachSentenceIsMeasuredByTheLabelOfThePicture) {
  const Tensor origin = torch::zeros({2, 2});
  torch::manual_seed(1);
  for (const char* name : {"pixel", "position", "pose", "displacement"}) {
    const Quantity& quantity = Named(name);
    const auto width = quantity.label_shape().at(0);
    const Tensor value = torch::rand({2, 1, width}), said = torch::rand({2, 3, width});
    const Tensor valid = torch::ones({2, 1}, torch::kBool);
    ModuleOutput output;
    output.decoded[name] = said;
    const Target once{value, valid}, each{value.expand({2, 3, width}), valid.expand({2, 3})};
    const auto metrics = quantity.Measure({}, output, once), expected = quantity.Measure({}, output, each);
    ASSERT_EQ(metrics.size(), expected.size());
    for (std::size_t i = 0; i < metrics.size(); ++i)
      EXPECT_TRUE(torch::allclose(metrics[i].values.expand({2, 3}), expected[i].values)) << name << metrics[i].name;
    EXPECT_NEAR(quantity.Loss({}, {}, output, once, {origin, 8, 8}).item<double>(),
                quantity.Loss({}, {}, output, each, {origin, 8, 8}).item<double>(), 1e-6)
        << name;
  }
}

TEST(Quantities, DecodeGivesBackWhatTheNetworkMeans) {
  ModuleOutput output;
  const Tensor from = torch::tensor({0.1F, 0.2F, 0.3F}).view({1, 1, 3}), zeros = torch::zeros({1, 1, 120});
  Named("trajectory").Decode({.readout = "relative"}, {Unit(), 4, &from}, zeros, output);
  EXPECT_TRUE(
      torch::allclose(output.decoded.at("trajectory").narrow(-1, 0, 3), from.unsqueeze(2).expand({1, 1, 12, 3})));
  Named("displacement").Decode({.readout = "difference"}, {Unit(), 4, &from}, zeros.narrow(-1, 0, 3), output);
  EXPECT_TRUE(torch::allclose(output.decoded.at("displacement"), from));
  output.soft_argmax = torch::tensor({100.0F, 50.0F}).view({1, 1, 2});
  Named("pixel").Decode({.readout = "soft_argmax"}, {Unit(), 4}, torch::ones({1, 1, 2}), output);
  EXPECT_TRUE(torch::allclose(output.decoded.at("pixel"), output.soft_argmax + 8));
  Named("pixel").Decode({}, {Unit(), 4}, torch::zeros({1, 1, 2}), output);
  EXPECT_EQ(output.decoded.at("pixel")[0][0][0].item<float>(), 112);
}

TEST(Quantities, ACorrectionAddsToAnothersTrajectory) {
  const Quantity& trajectory = Named("trajectory");
  const Head head{.readout = "correction"};
  EXPECT_TRUE(trajectory.starts_at_zero(head));
  Tensor plan = torch::rand({2, 1, kWaypoints, kWaypointSize});  // the gripper's probability between 0 and 1, too
  plan.select(-1, kWaypointSize - 1).mul_(0.98).add_(0.01);
  ModuleOutput output;
  trajectory.Decode(head, {Unit(), 4, &plan}, torch::zeros({2, 1, kWaypoints * kWaypointSize}), output);
  EXPECT_TRUE(torch::allclose(output.decoded.at("trajectory"), plan, 1e-5, 1e-5));

  Normalization wide = Unit();
  wide.offset_std = torch::full({kWaypoints, 3}, 0.5);
  const Tensor ones = torch::ones({2, 1, kWaypoints * kWaypointSize});
  trajectory.Decode(head, {wide, 4, &plan}, ones, output);
  const Tensor change = output.decoded.at("trajectory") - plan;
  EXPECT_TRUE(torch::allclose(change.narrow(-1, 0, 3), torch::full({2, 1, kWaypoints, 3}, 0.5), 1e-4, 1e-5));
  EXPECT_TRUE(torch::allclose(change.narrow(-1, 3, 6), torch::ones({2, 1, kWaypoints, 6}), 1e-4, 1e-5));
  const Tensor odds = plan.select(-1, kWaypointSize - 1) / (1 - plan.select(-1, kWaypointSize - 1)) * std::exp(1.0);
  EXPECT_TRUE(
      torch::allclose(output.decoded.at("trajectory").select(-1, kWaypointSize - 1), odds / (1 + odds), 1e-4, 1e-5));
}

TEST(Quantities, ATrajectoryIsReadByItsFormAlone) {
  const Quantity& trajectory = Named("trajectory");
  ModuleOutput here, there;
  const Tensor plan = torch::rand({1, 1, kWaypoints, kWaypointSize});
  Tensor moved = plan.clone();
  moved.narrow(-1, 0, 3) += torch::tensor({0.3F, -0.2F, 0.1F});
  here.decoded["trajectory"] = plan;
  there.decoded["trajectory"] = moved;
  const Tensor features = trajectory.Feature(here, Unit(), false, true);
  ASSERT_EQ(features.size(-1), trajectory.feature_width({}, false));
  EXPECT_TRUE(torch::allclose(features, trajectory.Feature(there, Unit(), false, true), 1e-4, 1e-5));
  const Tensor rows = features.view({kWaypoints, 4});
  EXPECT_TRUE(torch::allclose(rows.narrow(1, 0, 3), (plan - plan.narrow(2, 0, 1))[0][0].narrow(1, 0, 3), 1e-4, 1e-5));
  EXPECT_TRUE(torch::equal(rows.select(1, 3), plan[0][0].select(1, kWaypointSize - 1)));
}

TEST(Quantities, OneOfManyIsLearnedByCrossEntropyAndSaidByName) {
  const Tensor origin = torch::zeros({1, 2});
  const Head head{.classes = {"push", "pick", "put_down"}};
  for (const Quantity* quantity : {&Named("class"), &Named("task")}) {
    ModuleOutput output;
    const Tensor logits = torch::tensor({0.0F, 2.0F, 0.5F}).view({1, 1, 3});
    quantity->Decode(head, {Unit(), 4}, logits, output);
    const Target right{torch::ones({1, 1}), torch::ones({1, 1}, torch::kBool)};
    const Target none{torch::ones({1, 1}), torch::zeros({1, 1}, torch::kBool)};

    const double expected = -std::log(std::exp(2.0) / (1 + std::exp(2.0) + std::exp(0.5)));
    EXPECT_NEAR(quantity->Loss(head, {}, output, right, {origin, 8, 8}).item<double>(), expected, 1e-6);
    EXPECT_EQ(quantity->Loss(head, {}, output, none, {origin, 8, 8}).item<double>(), 0);
    EXPECT_TRUE(quantity->Measure(head, output, right).at(0).values.item<bool>());
    EXPECT_NEAR(quantity->Feature(output, Unit(), false, true)[0][0][1].item<double>(), std::exp(-expected), 1e-6);
    OrderedJson words;
    quantity->Say(head, output, words);
    EXPECT_EQ(words["value"], "pick");
    EXPECT_EQ(quantity->width(head), 3);
  }
}

TEST(Quantities, EachHasItsNameAndUnit) {
  EXPECT_THAT(QuantityNames(),
              testing::ElementsAre("class", "task", "pixel", "position", "pose", "displacement", "trajectory"));
  for (const auto& name : QuantityNames()) {
    EXPECT_EQ(FindQuantity(name)->name(), name);
    EXPECT_FALSE(FindQuantity(name)->unit().empty());
    EXPECT_FALSE(FindQuantity(name)->meaning().empty());
  }
  EXPECT_EQ(FindQuantity("speed"), nullptr);
}

TEST(Rotation, BothFormsAreTheSameRotationAs6D) {
  Rng rng(4);
  for (int i = 0; i < 20; ++i) {
    const Eigen::Quaterniond q = FromEuler({rng.Uniform(-3, 3), rng.Uniform(-1.5, 1.5), rng.Uniform(-3, 3)});
    const Rotation6D columns = ToRotation6D(q);
    Tensor label = torch::empty({6}, torch::kFloat64);
    std::copy(columns.begin(), columns.end(), label.data_ptr<double>());
    const Eigen::Vector3d angles = ToEuler(q);
    const Tensor euler = ToForm(label, "euler_sincos");
    for (int k = 0; k < 3; ++k) {
      EXPECT_NEAR(euler[2 * k].item<double>(), std::sin(angles[k]), 1e-9);
      EXPECT_NEAR(euler[2 * k + 1].item<double>(), std::cos(angles[k]), 1e-9);
    }
    EXPECT_TRUE(torch::allclose(To6D(3 * euler, "euler_sincos"), label)) << "sines and cosines need no unit length";
    EXPECT_TRUE(torch::allclose(To6D(3 * label, "6d"), label));
    EXPECT_NEAR(AngleDegrees(euler, "euler_sincos", label).item<double>(), 0, 1e-3);
  }
}

}  // namespace quantities_test
}  // namespace etude::policy
