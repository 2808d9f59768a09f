// SPDX-License-Identifier: Apache-2.0
// A training run small enough for tests: preset compact's graph on synthetic pictures of 48 px.
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

#include "tests/support/temporary_folder.h"
#include "tests/trainer/data/synthetic_dataset.h"
#include "tests/trainer/learn/tiny_config.h"
#include "trainer/learn/trainer.h"
#include "trainer/policy/crop.h"
#include "trainer/policy/names.h"

namespace etude::learn {

inline TrainConfig TinyConfig(std::vector<std::string> overrides = {}) {
  std::vector<std::string> all = TinyOverrides();
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
