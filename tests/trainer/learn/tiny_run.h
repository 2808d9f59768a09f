// SPDX-License-Identifier: Apache-2.0
// A training run small enough for tests: preset compact's graph on synthetic pictures of 48 px.
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

#include "tests/support/temporary_folder.h"
#include "tests/trainer/data/synthetic_dataset.h"
#include "trainer/learn/trainer.h"
#include "trainer/policy/crop.h"
#include "trainer/policy/names.h"

namespace etude::learn {

inline constexpr int kTinyPicture = 48;  // px

inline TrainConfig TinyConfig(std::vector<std::string> overrides = {}) {
  std::vector<std::string> all{"policy.image.crop=[2, 2, 44, 44]",
                               "policy.image.layers=[{kind: conv, channels: 16, kernel: 5, stride: "
                               "2}, {kind: residual, channels: 16}]",
                               "policy.width=32",
                               "policy.precision=float32",
                               "policy.joint_hidden=[32]",
                               "policy.language.buckets=1024",
                               "policy.language.width=32",
                               "policy.language.hidden=64",
                               "policy.tasks=[pick, push, put_down]",
                               "data.batch=16",
                               "data.jitter=2",
                               "data.cache_mb=64",
                               "data.min_episodes=8",
                               "data.min_valid=1",
                               "data.refresh_s=0.05",
                               "optimizer.warmup_steps=10",
                               "eval.every_steps=10",
                               "eval.frames=48",
                               "checkpoint.every_steps=10",
                               "threads.replicas=1",
                               "steps=20"};
  all.insert(all.end(), overrides.begin(), overrides.end());
  auto config = LoadTrainConfig("compact", "trainer/experiments", all);
  EXPECT_TRUE(config) << config.error().message;
  return config ? *config : TrainConfig{};
}

/// What batches of a policy on TinyDataset hold.
inline data::BatchContent TinyContent(const policy::PolicyConfig& policy, const CampaignSpec& spec) {
  return {policy::CropOf(policy.image),  kTinyPicture, kTinyPicture, spec.tasks, policy.objects,
          policy::LabelColumnsOf(policy)};
}

inline std::shared_ptr<data::Dataset> TinyDataset(const Path& folder, std::uint64_t episodes) {
  AddSyntheticEpisodes(folder, SyntheticSpec(kTinyPicture, kTinyPicture), 0, episodes);
  auto dataset = data::Dataset::Open(folder);
  EXPECT_TRUE(dataset) << dataset.error().message;
  return dataset ? *dataset : nullptr;
}

}  // namespace etude::learn
