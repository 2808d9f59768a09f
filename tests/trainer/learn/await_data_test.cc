// SPDX-License-Identifier: Apache-2.0
// Tests trainer/learn/await_data.cc
#include "trainer/learn/await_data.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <thread>

#include "tests/trainer/learn/tiny_run.h"

namespace etude::learn {
namespace await_data_test {

using ::testing::HasSubstr;

TEST(AwaitData, DoesNotFixNormalisationOnTooFewWhenTheCollectorIsSilent) {
  const TemporaryFolder folder;
  const auto dataset = TinyDataset(folder / "d", 3);
  const TrainConfig config = TinyConfig({"data.min_episodes=8"});

  const Status waited = AwaitData(*dataset, config, {.follow = true, .patience = std::chrono::milliseconds(1)});

  ASSERT_FALSE(waited);
  EXPECT_EQ(waited.error().code, Code::kExhausted);
  EXPECT_THAT(waited.error().message, HasSubstr("of 8 training episodes"));
  EXPECT_THAT(waited.error().message, HasSubstr("collector"));
}

TEST(AwaitData, WaitsForBothSplits) {
  const TemporaryFolder folder;
  const auto spec = SyntheticSpec(kTinyPicture, kTinyPicture);
  const auto dataset = TinyDataset(folder / "d", 2);
  const TrainConfig config = TinyConfig({"data.min_episodes=8", "data.min_valid=1"});
  std::thread collector([&] { AddSyntheticEpisodes(folder / "d", spec, 2, 30); });

  const Status waited = AwaitData(*dataset, config, {.follow = true});
  collector.join();

  ASSERT_TRUE(waited) << waited.error().message;
  EXPECT_GE(dataset->snapshot()->episode_count(data::Split::kTrain), 8u);
  EXPECT_GE(dataset->snapshot()->episode_count(data::Split::kValid), 1u);
}

TEST(AwaitData, EndsWithTheWordsOfItsCollector) {
  const TemporaryFolder folder;
  const auto dataset = TinyDataset(folder / "d", 2);
  const Status waited =
      AwaitData(*dataset, TinyConfig(), {.follow = true, .source = []() -> Status {
                                           return Fail(Code::kUnavailable, "the collector stopped: disk gone");
                                         }});
  ASSERT_FALSE(waited);
  EXPECT_THAT(waited.error().message, HasSubstr("disk gone"));
}

}  // namespace await_data_test
}  // namespace etude::learn
