// SPDX-License-Identifier: Apache-2.0
// Tests readout `ray` of trainer/policy/quantities/position.cc: a place through a camera that moves.
#include "services/episode/viewpoint.h"
#include "tests/support/matchers.h"
#include "tests/trainer/policy/fixtures.h"
#include "trainer/policy/names.h"

namespace etude::policy {
namespace ray_test {

PolicyConfig RayConfig() {
  PolicyConfig config = TinyConfig();
  DecoderConfig& decoder = FindModule(config, "TAR3D")->decoder;
  decoder.readout = "ray";
  decoder.from = {"TAR2D"};
  return config;
}

std::vector<Camera> SomeCameras() {
  std::vector<Camera> cameras(2, Camera{.width = 48, .height = 48});
  cameras[0].fovy = 0.9;
  cameras[0].X_WC = {{0.0, 1.5, 1.0}, FromEuler({-1.0, 0, 3.14})};
  cameras[1].fovy = 1.2;
  cameras[1].X_WC = {{0.2, 1.3, 1.2}, FromEuler({-0.8, 0.1, 3.0})};
  return cameras;
}

torch::Tensor ViewpointsOf(const std::vector<Camera>& cameras) {
  torch::Tensor all = torch::empty({static_cast<std::int64_t>(cameras.size()), kViewpointSize});
  for (std::size_t b = 0; b < cameras.size(); ++b) {
    const Viewpoint one = ViewpointOf(cameras[b]);
    all[static_cast<std::int64_t>(b)].copy_(torch::tensor(std::vector<float>(one.begin(), one.end())));
  }
  return all;
}

// What is drawn of the decoded place in the picture is the pixel that was decoded, whatever the camera.
TEST(Ray, IsWhereThePixelLooksAtTheHeightThatIsSaid) {
  const auto policy = MakePolicy(RayConfig());
  policy->eval();
  const auto cameras = SomeCameras();
  Inputs inputs = MakeInputs(RayConfig(), 2, 3);
  inputs.viewpoint = ViewpointsOf(cameras);
  const torch::NoGradGuard no_grad;
  const Outputs outputs = policy->Forward(inputs);
  const torch::Tensor pixel = outputs.at("TAR2D").decoded.at("pixel").contiguous();
  const torch::Tensor place = outputs.at("TAR3D").decoded.at("position").contiguous();
  ASSERT_EQ(place.sizes(), (std::vector<std::int64_t>{2, 3, 3}));
  for (std::int64_t b = 0; b < 2; ++b)
    for (std::int64_t s = 0; s < 3; ++s) {
      const auto p = place[b][s], u = pixel[b][s];
      const Eigen::Vector2d seen =
          cameras[static_cast<std::size_t>(b)].Project({p[0].item<double>(), p[1].item<double>(), p[2].item<double>()});
      EXPECT_NEAR(seen.x(), u[0].item<double>(), 1e-2);
      EXPECT_NEAR(seen.y(), u[1].item<double>(), 1e-2);
      EXPECT_NEAR(p[2].item<double>(), 0.1, 1e-6) << "it begins at the mean height";
    }
}

TEST(Ray, OfAPixelAboveTheHorizonIsFinite) {
  const auto policy = MakePolicy(RayConfig());
  Camera level{.width = 48, .height = 48, .fovy = 1.2};
  level.X_WC = {{0, 1.5, 1.0}, FromEuler({-1.5707963, 0, 3.1415926})};  // along the table
  Inputs inputs = MakeInputs(RayConfig(), 1, 1);
  inputs.viewpoint = ViewpointsOf({level});
  EXPECT_TRUE(policy->Forward(inputs).at("TAR3D").decoded.at("position").isfinite().all().item<bool>());
}

TEST(Ray, NeedsToKnowTheCamera) {
  EXPECT_TRUE(ReadsCamera(RayConfig()));
  EXPECT_FALSE(ReadsCamera(TinyConfig()));
  const auto policy = MakePolicy(RayConfig());
  const Inputs inputs = MakeInputs(RayConfig(), 1, 1);
  EXPECT_THROW(policy->Forward(inputs), c10::Error);
  EXPECT_NO_THROW(policy->Forward(inputs, 2)) << "below it nobody asks";
}

TEST(Ray, RefersToOneModuleThatDecodesAPixel) {
  PolicyConfig config = RayConfig();
  EXPECT_THAT(config.Validate(), IsOk());
  FindModule(config, "TAR3D")->decoder.from = {"EE3D"};
  EXPECT_THAT(config.Validate(), MessageHas("'EE3D' decodes no pixel"));
  FindModule(config, "TAR3D")->decoder.from = {};
  EXPECT_THAT(config.Validate(), MessageHas("ray needs 1 modules"));
  FindModule(config, "TAR3D")->decoder.from = {"TAR2D"};
  FindModule(config, "DISP")->decoder.readout = "ray";
  EXPECT_THAT(config.Validate(), MessageHas("'ray' is not one of"));
}

// Heights are learned through the ray: what moves a place along it has a gradient.
TEST(Ray, LearnsHeights) {
  const auto policy = MakePolicy(RayConfig());
  Inputs inputs = MakeInputs(RayConfig(), 2, 2);
  inputs.viewpoint = ViewpointsOf(SomeCameras());
  const Labels labels = MakeLabels(RayConfig(), 2, 2);
  policy->Loss(inputs, policy->Forward(inputs), labels, 3).total.backward();
  const auto parameters = policy->named_parameters();
  const torch::Tensor* last = parameters.find("modules.TAR3D.decoder.layer2.bias");
  ASSERT_NE(last, nullptr);
  ASSERT_TRUE(last->grad().defined());
  EXPECT_NE(last->grad()[2].item<float>(), 0);
}

}  // namespace ray_test
}  // namespace etude::policy
