// SPDX-License-Identifier: Apache-2.0
// Tests trainer/data/statistics.cc
#include "trainer/data/statistics.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/synthetic_episode.h"

namespace etude::data {
namespace statistics_test {

std::shared_ptr<EpisodeEntry> Entry(std::uint64_t index, Split split) {
  auto entry = std::make_shared<EpisodeEntry>();
  entry->index = index;
  entry->split = split;
  entry->record.episode = MakeSyntheticEpisode(SyntheticSpec(), index, 50);
  entry->record.frames.resize(1);
  entry->record.frames[0].count = 10;
  entry->usable = UsableFrames(*entry);
  return entry;
}

TEST(ComputeStatistics, AgreesWithALoopOverTheTrainingSplit) {
  const Snapshot snapshot({Entry(0, Split::kTrain), Entry(1, Split::kTrain), Entry(2, Split::kValid)});

  const auto statistics = ComputeStatistics(snapshot);

  ASSERT_TRUE(statistics) << statistics.error().message;
  double sum = 0, square = 0, displacement = 0;
  int n = 0, m = 0;
  for (int e = 0; e < 2; ++e) {
    const Episode& episode = snapshot.episodes()[static_cast<std::size_t>(e)]->episode();
    for (int t = 0; t < 50; t += 5) {
      const double q = episode.joint_pos.row(t)[2];
      sum += q;
      square += q * q;
      ++n;
      for (const auto& object : episode.objects) {
        displacement += std::pow(object.pose.row(t)[1] - episode.eef_pos.row(t)[1], 2);
        ++m;
      }
    }
  }
  ASSERT_EQ(statistics->joint_mean.size(), 7u);
  EXPECT_NEAR(statistics->joint_mean[2], sum / n, 1e-5);
  EXPECT_NEAR(statistics->joint_std[2], std::max(0.05, std::sqrt(square / n - sum / n * sum / n)), 1e-5);
  EXPECT_NEAR(statistics->displacement_std[1], std::sqrt(displacement / m), 1e-5);
}

TEST(ComputeStatistics, KeepsAFloorUnderJointsThatDoNotMove) {
  auto entry = Entry(0, Split::kTrain);
  for (std::size_t i = 3; i < entry->record.episode.joint_pos.values.size(); i += 6)
    entry->record.episode.joint_pos.values[i] = 0.5f;

  const auto statistics = ComputeStatistics(Snapshot({entry}));

  ASSERT_TRUE(statistics);
  EXPECT_FLOAT_EQ(statistics->joint_std[3], 0.05f);
}

TEST(ComputeStatistics, SaysThatThereIsNothingToMeasure) {
  EXPECT_EQ(ComputeStatistics(Snapshot({Entry(0, Split::kValid)})).error().code, Code::kNotFound);
}

}  // namespace statistics_test
}  // namespace etude::data
