// SPDX-License-Identifier: Apache-2.0
// A small untrained policy as a checkpoint.
#pragma once

#include <gtest/gtest.h>

#include "tests/trainer/learn/tiny_run.h"
#include "trainer/publish/checkpoint.h"

namespace etude::publish {

inline constexpr int kExampleJoints = 7;

/// `config` must outlive the request.
inline learn::CheckpointRequest ExampleRequest(const learn::TrainConfig& config, std::uint64_t step = 100,
                                               std::uint64_t seed = 1) {
  auto policy = policy::Policy::Create(config.policy, policy::Normalization::Unit(kExampleJoints), seed);
  EXPECT_TRUE(policy) << policy.error().message;
  learn::CheckpointRequest request;
  request.step = step;
  request.stage = 5;
  request.stages = 5;
  request.stage_name = "CTRL";
  request.metrics = {{"TAR3D.cm", 0.25}};
  request.dataset = "fingerprint";
  request.train_episodes = 12;
  request.joints = kExampleJoints;
  request.config = &config;
  for (const auto& [name, tensor] : (*policy)->StateTensors()) request.tensors[name] = tensor.detach().clone();
  return request;
}

}  // namespace etude::publish
