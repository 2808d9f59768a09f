// SPDX-License-Identifier: Apache-2.0
// A hierarchy small enough for finite differences, with inputs and labels for it.
#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "services/core/config.h"
#include "services/episode/action.h"
#include "trainer/policy/policy.h"
#include "trainer/policy/torch.h"

namespace etude::policy {

inline ModuleConfig* FindModule(PolicyConfig& config, const std::string& name) {
  for (ModuleConfig& module : config.modules)
    if (module.name == name) return &module;
  return nullptr;
}

/// What TinyConfig says besides its modules.
inline constexpr char kTinyEncoders[] = R"(
name: tiny
image:
  crop: [10, 20, 24, 16]
  layers:
    - {kind: conv, channels: 16, kernel: 3, stride: 2}
    - {kind: conv, channels: 16, kernel: 3, stride: 2, norm: instance}
    - {kind: residual, channels: 16}
language: {buckets: 64, width: 8, hidden: 8}
joint_hidden: [8]
width: 8
heads: 2
objects: [red, blue, green]
precision: float32
)";

/// The base hierarchy on a 24x16 crop with 6x4 tokens; gradients pass everywhere.
inline PolicyConfig TinyConfig() {
  const std::string yaml = std::string(kTinyEncoders) + R"(
modules:
  - {name: LANG, level: 1, reads: [language, joints], attend: [language], decoder: {entity: target, quantity: class}}
  - {name: EE2D, level: 2, reads: [joints, image], attend: ["image@ee"],
     decoder: {entity: ee, quantity: pixel, readout: soft_argmax}}
  - {name: TAR2D, level: 2, query: LANG, reads: [image, self], attend: ["image@target"],
     decoder: {entity: target, quantity: pixel, readout: soft_argmax, hidden: [4], inputs: [register, soft_argmax],
               detach: false}}
  - {name: EE3D, level: 3, reads: [joints, EE2D], attend: [joints, EE2D],
     decoder: {entity: ee, quantity: pose, readout: mlp, hidden: [8], inputs: [register, joints], detach: false}}
  - {name: TAR3D, level: 3, reads: [TAR2D, EE3D], attend: [TAR2D],
     decoder: {entity: target, quantity: position, readout: mlp, hidden: [8, 8], detach: false,
               inputs: [register, "soft_argmax:TAR2D", "pixel:TAR2D", joints, "fourier:joints", "position:EE3D"]}}
  - {name: DISP, level: 4, reads: [EE3D, TAR3D, language], attend: [EE3D, TAR3D],
     decoder: {entity: target, quantity: displacement, readout: difference, from: [EE3D, TAR3D],
               inputs: ["position:EE3D", "position:TAR3D"], detach: false}}
  - {name: CTRL, level: 5, reads: [all], attend: [language, joints, EE3D, TAR3D, DISP],
     decoder: {entity: ee, quantity: trajectory, readout: relative, from: [EE3D], hidden: [12, 12], detach: false,
               inputs: [register, language, "class:LANG", "fourier:displacement:DISP", "displacement:DISP"]}}
)";
  const auto config = FromJson<PolicyConfig>(ParseYaml(yaml, "tiny").value(), "tiny");
  EXPECT_TRUE(config) << config.error().message;
  return *config;
}

/// With CTRL2, which corrects what CTRL plans and drives.
inline PolicyConfig CorrectedConfig() {
  PolicyConfig config = TinyConfig();
  ModuleConfig added = *FindModule(config, "CTRL");
  added.name = "CTRL2";
  added.reads = {"DISP"};
  added.attend = {};
  added.decoder.readout = "correction";
  added.decoder.from = {"CTRL"};
  added.decoder.inputs = {"register", "trajectory:CTRL"};
  config.modules.push_back(added);
  return config;
}

inline Normalization TinyNormalization(int joints = 3) {
  return {.joint_mean = torch::full({joints}, 0.1),
          .joint_std = torch::full({joints}, 0.5),
          .position_mean = torch::tensor({0.0F, 0.2F, 0.1F}),
          .position_std = torch::tensor({0.2F, 0.1F, 0.08F}),
          .displacement_std = torch::tensor({0.2F, 0.1F, 0.05F}),
          .offset_std = torch::tensor({0.1F, 0.1F, 0.05F}).expand({kWaypoints, 3})};
}

inline std::shared_ptr<Policy> MakePolicy(const PolicyConfig& config, std::uint64_t seed = 1, int joints = 3) {
  auto policy = Policy::Create(config, TinyNormalization(joints), seed);
  EXPECT_TRUE(policy) << policy.error().message;
  return *policy;
}

/// The tiny policy with attention of either kind.
class BothAttentions : public testing::TestWithParam<const char*> {
 protected:
  BothAttentions() : config_(TinyConfig()) { config_.attention = GetParam(); }
  PolicyConfig config_;
};

/// Random inputs of B images and S sentences.
inline Inputs MakeInputs(const PolicyConfig& config, int batch, int sentences, int joints = 3) {
  torch::manual_seed(17);
  Inputs inputs;
  inputs.images = torch::randint(0, 256, {batch, 3, config.image.crop[3], config.image.crop[2]}, torch::kUInt8)
                      .contiguous(torch::MemoryFormat::ChannelsLast);
  inputs.crop_origin =
      torch::tensor({static_cast<float>(config.image.crop[0]), static_cast<float>(config.image.crop[1])}) +
      torch::randint(-2, 3, {batch, 2}, torch::kFloat32);
  inputs.joints = torch::randn({batch, joints});
  inputs.sentences = {"pick up red can", "push the blue box", "put down green bottle", "raise it"};
  inputs.sentence_index = torch::randint(0, 4, {batch, sentences}, torch::kInt64);
  return inputs;
}

/// Random labels of every kind, all valid and in view.
inline Labels MakeLabels(const PolicyConfig& config, int batch, int sentences) {
  torch::manual_seed(18);
  const auto pixel = [&](int count) {
    return torch::tensor({config.image.crop[0] + 4.0F, config.image.crop[1] + 4.0F}) +
           torch::rand({batch, count, 2}) * torch::tensor({config.image.crop[2] - 8.0F, config.image.crop[3] - 8.0F});
  };
  Labels labels;
  labels["target.class"] =
      torch::randint(0, static_cast<int>(config.objects.size()), {batch, sentences}, torch::kInt64);
  labels["target.pixel"] = pixel(sentences);
  labels["target.position"] = 0.2 * torch::randn({batch, sentences, 3});
  labels["target.pose"] = 0.2 * torch::randn({batch, sentences, 9});
  labels["ee.pixel"] = pixel(1);
  labels["ee.position"] = 0.2 * torch::randn({batch, 1, 3});
  labels["ee.pose"] = 0.2 * torch::randn({batch, 1, 9});
  labels["target.displacement"] = 0.2 * torch::randn({batch, sentences, 3});
  labels["ee.trajectory"] = 0.2 * torch::randn({batch, 1, 12, 10});
  labels["ee.trajectory"].select(-1, 9).copy_(torch::rand({batch, 1, 12}).round());
  return labels;
}

inline float MaxDifference(const torch::Tensor& a, const torch::Tensor& b) { return (a - b).abs().max().item<float>(); }

}  // namespace etude::policy
