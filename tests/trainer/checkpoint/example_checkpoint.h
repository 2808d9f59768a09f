// SPDX-License-Identifier: Apache-2.0
// A small policy as a checkpoint that may drive a robot: trained and measured, as it says.
#pragma once

#include <gtest/gtest.h>

#include "services/episode/action.h"
#include "trainer/checkpoint/checkpoint.h"

namespace etude::checkpoint {

inline constexpr int kExampleJoints = 7;
inline constexpr int kExamplePicture = 48;  // px

inline Embodiment ExampleEmbodiment() {
  return {.robot = "ur5",
          .joints = kExampleJoints,
          .width = kExamplePicture,
          .height = kExamplePicture,
          .fovy = 1.0,
          .camera_pose = {0.9, 0, 0.8, 1, 0, 0, 0},
          .rotation = kRotationFormat,
          .control_rate = 125,
          .waypoints = 12,
          .horizon = 120};
}

inline Checkpoint ExampleCheckpoint(const policy::PolicyConfig& config, std::uint64_t step = 100,
                                    std::uint64_t seed = 1) {
  auto policy = policy::Policy::Create(config, policy::Normalization::Unit(kExampleJoints), seed);
  EXPECT_TRUE(policy) << policy.error().message;
  Checkpoint checkpoint;
  Metadata& metadata = checkpoint.metadata;
  metadata.run = "demo";
  metadata.step = step;
  metadata.stage = metadata.stages = 5;
  metadata.stage_name = "CTRL";
  metadata.metrics = {{"TAR3D.cm", 0.25}};
  metadata.dataset = "fingerprint";
  metadata.words = "can push red the";
  metadata.train_episodes = 12;
  metadata.embodiment = ExampleEmbodiment();
  metadata.policy = config;
  metadata.train_config = {{"name", "example"}, {"checkpoint", {{"keep", 2}}}};
  for (const auto& module : config.modules) metadata.modules[module.name] = {step, 0.01};
  for (const auto& [name, tensor] : (*policy)->StateTensors()) checkpoint.tensors[name] = tensor.detach().clone();
  return checkpoint;
}

}  // namespace etude::checkpoint
