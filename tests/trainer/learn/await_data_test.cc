// SPDX-License-Identifier: Apache-2.0
// Tests trainer/learn/await_data.cc
#include "trainer/learn/await_data.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <thread>

#include "services/core/clock.h"
#include "tests/support/matchers.h"
#include "tests/support/wait_until.h"
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

// before, a trainer that hosts its collector waited for a year
TEST(AwaitData, TakesWhatThereIsWhenTheCollectionHasEnded) {
  const TemporaryFolder folder;
  auto spec = SyntheticSpec(kTinyPicture, kTinyPicture);
  spec.split = {0.5, 0.5, 0};
  AddSyntheticEpisodes(folder / "d", spec, 0, 12);  // of 20 that are planned
  const auto dataset = data::Dataset::Open(std::vector<Path>{folder / "d"});
  ASSERT_TRUE(dataset) << dataset.error().message;
  const TrainConfig config = TinyConfig({"data.min_episodes=29", "data.min_valid=1"});
  EXPECT_FALSE(AwaitData(**dataset, config, {.follow = true, .patience = std::chrono::milliseconds(1)}));
  EXPECT_TRUE(AwaitData(**dataset, config, {.follow = true, .over = [] { return true; }}));

  const auto empty = TinyDataset(folder / "e", 0);
  const Status waited = AwaitData(*empty, config, {.follow = true, .over = [] { return true; }});
  ASSERT_FALSE(waited);
  EXPECT_EQ(waited.error().code, Code::kNotFound);
}

TEST(AwaitData, RefusesACampaignThatPlansNothingToValidateOn) {
  const TemporaryFolder folder;
  auto spec = SyntheticSpec(kTinyPicture, kTinyPicture);
  spec.split = {1, 0, 0};
  AddSyntheticEpisodes(folder / "d", spec, 0, 2);
  const auto dataset = data::Dataset::Open(std::vector<Path>{folder / "d"});
  ASSERT_TRUE(dataset) << dataset.error().message;
  const Status waited = AwaitData(**dataset, TinyConfig(), {.follow = true});
  ASSERT_FALSE(waited);
  EXPECT_EQ(waited.error().code, Code::kInvalidArgument);
  EXPECT_THAT(waited.error().message, HasSubstr("no episode of split 'valid'"));
}

// its first episodes may all be of the first robot
TEST(AwaitData, RefusesACampaignOfSeveralRobotsBeforeItWaits) {
  const TemporaryFolder folder;
  auto spec = SyntheticSpec(kTinyPicture, kTinyPicture);
  spec.robots = {"ur5", "jaco2"};
  AddSyntheticEpisodes(folder / "d", spec, 0, 2);
  const auto dataset = data::Dataset::Open(std::vector<Path>{folder / "d"});
  ASSERT_TRUE(dataset) << dataset.error().message;
  const Status waited = AwaitData(**dataset, TinyConfig(), {.follow = true});
  EXPECT_THAT(waited, HasCode(Code::kInvalidArgument));
  EXPECT_THAT(waited, MessageHas("ur5, jaco2"));
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

// what is of another robot has to be seen before training begins
TEST(AwaitData, WaitsForAnEpisodeOfEachOfSeveralFolders) {
  const TemporaryFolder folder;
  auto spec = SyntheticSpec(kTinyPicture, kTinyPicture);
  AddSyntheticEpisodes(folder / "a", spec, 0, 30);
  spec.seed += 1;
  AddSyntheticEpisodes(folder / "b", spec, 0, 0);
  const auto dataset = data::Dataset::Open(std::vector<Path>{folder / "a", folder / "b"});
  ASSERT_TRUE(dataset) << dataset.error().message;
  const AwaitOptions follow{.follow = true, .patience = std::chrono::milliseconds(1)};

  const Status silent = AwaitData(**dataset, TinyConfig(), follow), now = AwaitData(**dataset, TinyConfig(), {});

  ASSERT_FALSE(silent);
  EXPECT_THAT(silent.error().message, HasSubstr("no episode of '" + (folder / "b").string() + "'"));
  ASSERT_FALSE(now);
  EXPECT_EQ(now.error().code, Code::kNotFound);
  EXPECT_THAT(now.error().message, HasSubstr("no episode of '" + (folder / "b").string() + "'"));
  const auto first_of = [&](const std::string& split) {
    std::uint64_t index = 0;
    while (SplitOf(spec, index) != split) ++index;
    return index;
  };
  AddSyntheticEpisodes(folder / "b", spec, first_of("train"), first_of("train") + 1);
  // what a module of the second folder alone is measured by: a validation set is never changed again
  EXPECT_THAT(AwaitData(**dataset, TinyConfig(), follow).error().message,
              HasSubstr("no validation episode of '" + (folder / "b").string() + "'"));
  AddSyntheticEpisodes(folder / "b", spec, first_of("valid"), first_of("valid") + 1);
  EXPECT_TRUE(AwaitData(**dataset, TinyConfig(), {.follow = true}));
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

TEST(AwaitData, OfAFinishedDatasetTakesWhatThereIs) {
  const TemporaryFolder folder;
  const auto dataset = TinyDataset(folder / "d", 24);
  EXPECT_THAT(AwaitData(*dataset, TinyConfig({"data.min_episodes=1000", "data.min_valid=100"}), {}), IsOk());

  const auto empty = TinyDataset(folder / "empty", 0);
  const Status nothing = AwaitData(*empty, TinyConfig(), {});
  EXPECT_THAT(nothing, HasCode(Code::kNotFound));
  EXPECT_THAT(nothing, MessageHas("--follow")) << "what to do";
}

TEST(AwaitData, AsksForNoMoreThanTheCampaignPlans) {
  const TemporaryFolder folder;
  CampaignSpec spec = SyntheticSpec(kTinyPicture, kTinyPicture);
  spec.episodes = 6;
  spec.split = {5, 1, 0};  // counts
  AddSyntheticEpisodes(folder / "d", spec, 0, 6, 10);
  auto dataset = data::Dataset::Open(folder / "d");
  ASSERT_THAT(dataset, IsOk());
  const TrainConfig config = TinyConfig({"data.min_episodes=1000", "data.min_valid=100"});
  const AwaitOptions options{.follow = true, .patience = std::chrono::milliseconds(1)};
  EXPECT_THAT(AwaitData(**dataset, config, options), IsOk()) << "all that will ever come is there";

  std::filesystem::remove(store::EpisodePath(folder / "d", 3));
  auto lacking = data::Dataset::Open(folder / "d");
  ASSERT_THAT(lacking, IsOk());
  EXPECT_THAT(AwaitData(**lacking, config, options), HasCode(Code::kExhausted));
}

// normalisation and the goals of the curriculum would be those of the other tasks
TEST(AwaitData, WaitsForEveryTaskButNotForever) {
  const TemporaryFolder folder;
  CampaignSpec spec = SyntheticSpec(kTinyPicture, kTinyPicture);
  spec.episodes = 200;
  const TrainConfig config = TinyConfig({"data.min_episodes=12", "data.min_valid=1"});
  const AwaitOptions options{.follow = true, .patience = std::chrono::milliseconds(1)};
  auto writer = store::DatasetWriter::Open(folder / "d", spec);
  ASSERT_THAT(writer, IsOk());
  auto dataset = data::Dataset::Open(folder / "d");
  ASSERT_THAT(dataset, IsOk());
  std::uint64_t next = 0;
  const auto commit_without_put_down = [&](std::size_t training) {
    while ((*dataset)->snapshot()->episode_count(data::Split::kTrain) < training) {
      const Episode episode = MakeSyntheticEpisode(spec, next++, 10);
      if (episode.task == "put_down") continue;
      ASSERT_THAT(writer->Commit(episode), IsOk());
      ASSERT_THAT((*dataset)->Refresh(), IsOk());
    }
  };
  commit_without_put_down(14);
  EXPECT_THAT(AwaitData(**dataset, config, options), MessageHas("none of task put_down"));
  commit_without_put_down(24);  // twice as many as were asked for
  EXPECT_THAT(AwaitData(**dataset, config, options), IsOk());
}

TEST(Follower, BringsInWhatIsCommittedMeanwhile) {
  const TemporaryFolder folder;
  const auto dataset = TinyDataset(folder / "d", 2);
  ASSERT_THAT(dataset->Refresh(), IsOk());
  const auto before = dataset->snapshot();
  const Follower follower(dataset, 0.001);
  AddSyntheticEpisodes(folder / "d", SyntheticSpec(kTinyPicture, kTinyPicture), 2, 6);
  EXPECT_TRUE(WaitUntil([&] { return dataset->snapshot()->episodes().size() == 6; }));
  EXPECT_EQ(before->episodes().size(), 2u) << "who began with it goes on with it";
}

TEST(Follower, EndsAtOnceHoweverRarelyItLooks) {
  const TemporaryFolder folder;
  const auto dataset = TinyDataset(folder / "d", 2);
  const Stopwatch watch;
  { const Follower follower(dataset, 3600); }
  EXPECT_LT(watch.Seconds(), 60);
}

}  // namespace await_data_test
}  // namespace etude::learn
