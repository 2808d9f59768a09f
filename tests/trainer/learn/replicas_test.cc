// SPDX-License-Identifier: Apache-2.0
// Tests trainer/learn/replicas.cc
#include "trainer/learn/replicas.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "tests/support/matchers.h"
#include "tests/trainer/learn/tiny_run.h"
#include "trainer/data/statistics.h"
#include "trainer/learn/tensors.h"

namespace etude::learn {
namespace replicas_test {

constexpr int kReplicas = 3, kPictures = 12;

class ReplicasTest : public ::testing::Test {
 protected:
  void SetUp() override {
    at::set_num_threads(1);
    config_ = TinyConfig();
    const auto dataset = TinyDataset(folder_ / "d", 16);
    ASSERT_THAT(dataset->Refresh(), IsOk());
    const auto snapshot = dataset->snapshot();
    const auto statistics = data::ComputeStatistics(*snapshot);
    ASSERT_THAT(statistics, IsOk());
    normalization_ = ToNormalization(*statistics);
    auto grammar = language::Grammar::Load();
    ASSERT_THAT(grammar, IsOk());
    const data::BatchMaker maker(config_.data, TinyContent(config_.policy, dataset->spec()),
                                 std::make_shared<const language::Grammar>(std::move(*grammar)));
    const auto samples = data::SpreadFrames(*snapshot, data::Split::kTrain, 1, kPictures);
    ASSERT_EQ(samples.size(), static_cast<std::size_t>(kPictures));
    data::FrameScratch scratch;
    ASSERT_THAT(maker.Make(*snapshot, samples, 0, data::Augment::kNo, scratch, batch_), IsOk());
  }
  // All of them begin alike.
  std::vector<std::shared_ptr<policy::Policy>> NewPolicies(int count) const {
    std::vector<std::shared_ptr<policy::Policy>> policies;
    for (int k = 0; k < count; ++k) {
      auto policy = policy::Policy::Create(config_.policy, *normalization_, 1);
      EXPECT_THAT(policy, IsOk());
      (*policy)->train();
      policies.push_back(std::move(*policy));
    }
    return policies;
  }

  TemporaryFolder folder_;
  TrainConfig config_;
  std::optional<policy::Normalization> normalization_;
  data::Batch batch_;
};

TEST_F(ReplicasTest, EachHasTheGradientsOfItsPartAndTheLossIsTheirMean) {
  const auto side_by_side = NewPolicies(kReplicas);
  Replicas replicas(side_by_side);
  const auto mean = replicas.Backward(batch_, 0);
  ASSERT_THAT(mean, IsOk());

  double total = 0;
  for (int r = 0; r < kReplicas; ++r) {
    const auto alone = NewPolicies(1);
    const auto loss = Replicas(alone, r, kReplicas).Backward(batch_, 0);
    ASSERT_THAT(loss, IsOk());
    total += loss->total;
    const auto wanted = alone.front()->parameters();
    const auto found = side_by_side[static_cast<std::size_t>(r)]->parameters();
    ASSERT_EQ(found.size(), wanted.size());
    std::size_t compared = 0;
    for (std::size_t k = 0; k < wanted.size(); ++k) {
      ASSERT_EQ(found[k].grad().defined(), wanted[k].grad().defined()) << k;
      if (!wanted[k].grad().defined()) continue;
      EXPECT_TRUE(torch::allclose(found[k].grad(), wanted[k].grad(), 1e-5, 1e-7)) << "part " << r << " parameter " << k;
      ++compared;
    }
    EXPECT_GT(compared, 10u);
  }
  EXPECT_NEAR(mean->total, total / kReplicas, 1e-6);
}

TEST_F(ReplicasTest, WhatAPartThrowsIsTheRoundsErrorAndTheNextRoundIsWhole) {
  Replicas replicas(NewPolicies(kReplicas));
  const auto before = replicas.Backward(batch_, 0);
  ASSERT_THAT(before, IsOk());

  const auto index = std::exchange(batch_.sentence_index.back(), 1'000'000);  // of the last part
  const auto failed = replicas.Backward(batch_, 0);
  EXPECT_THAT(failed, HasCode(Code::kInternal));
  EXPECT_THAT(failed, MessageHas("forward and backward: "));

  batch_.sentence_index.back() = index;
  const auto after = replicas.Backward(batch_, 0);
  ASSERT_THAT(after, IsOk());
  EXPECT_NEAR(after->total, before->total, 1e-6);
}

TEST_F(ReplicasTest, OfFewerPicturesThanReplicasSomeHaveNothingToDo) {
  batch_.size = kReplicas - 1;
  const auto policies = NewPolicies(kReplicas);
  Replicas replicas(policies);
  const auto mean = replicas.Backward(batch_, 0);
  ASSERT_THAT(mean, IsOk());
  EXPECT_TRUE(std::isfinite(mean->total));
  int idle = 0;
  for (const auto& policy : policies) {
    bool learned = false;
    for (const auto& parameter : policy->parameters()) learned = learned || parameter.grad().defined();
    idle += !learned;
  }
  EXPECT_EQ(idle, 1);
}

}  // namespace replicas_test
}  // namespace etude::learn
