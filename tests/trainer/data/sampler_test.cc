// SPDX-License-Identifier: Apache-2.0
// Tests trainer/data/sampler.cc
#include "trainer/data/sampler.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "services/episode/codec.h"
#include "tests/support/synthetic_episode.h"

namespace etude::data {
namespace sampler_test {

// a snapshot without files; episodes of task `pick` are ten times as many as the others'. `moving`: steps of each of
// them before the hand rests
Snapshot Unbalanced(std::size_t moving = 30) {
  CampaignSpec spec = SyntheticSpec();
  spec.task_weights = {10, 1, 1};
  std::vector<std::shared_ptr<const EpisodeEntry>> episodes;
  for (std::uint64_t i = 0; i < 24; ++i) {
    auto entry = std::make_shared<EpisodeEntry>();
    entry->index = i;
    entry->split = i % 6 == 5 ? Split::kValid : Split::kTrain;
    entry->record.episode = MakeSyntheticEpisode(spec, i, 30);
    auto& phase = entry->record.episode.phase;
    entry->record.episode.stage_names = {"approach", "hold"};
    for (std::size_t t = 0; t < phase.size(); ++t) phase[t] = t >= moving;
    entry->record.frames.resize(1);
    entry->record.frames[0].count = RecordedFrames(entry->record.episode, 0);
    entry->usable = UsableFrames(*entry);
    episodes.push_back(std::move(entry));
  }
  return Snapshot(std::move(episodes));
}

bool Same(const std::vector<Sample>& a, const std::vector<Sample>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const Sample& x, const Sample& y) {
    return x.seed == y.seed && x.frame.episode == y.frame.episode && x.frame.frame == y.frame.frame;
  });
}

TEST(DrawBatch, DependsOnSeedAndStepOnly) {
  const Snapshot a = Unbalanced(), b = Unbalanced();

  EXPECT_TRUE(Same(DrawBatch(a, Split::kTrain, 1, 5, 32), DrawBatch(b, Split::kTrain, 1, 5, 32)));
  EXPECT_FALSE(Same(DrawBatch(a, Split::kTrain, 1, 5, 32), DrawBatch(a, Split::kTrain, 1, 6, 32)));
  EXPECT_FALSE(Same(DrawBatch(a, Split::kTrain, 1, 5, 32), DrawBatch(a, Split::kTrain, 2, 5, 32)));
  EXPECT_FALSE(Same(DrawBatch(a, Split::kTrain, 1, 5, 32), DrawBatch(a, Split::kTrain, 1, 5, 32, 1)));
}

TEST(DrawBatch, TakesTasksInTurnsHoweverRareTheyAre) {
  const Snapshot snapshot = Unbalanced();
  std::map<std::string, int> counts;
  for (std::uint64_t step = 0; step < 30; ++step)
    for (const auto& sample : DrawBatch(snapshot, Split::kTrain, 1, step, 10))
      ++counts[snapshot.episodes()[sample.frame.episode]->episode().task];

  ASSERT_EQ(counts.size(), 3u);
  for (const auto& [task, count] : counts) EXPECT_EQ(count, 100) << task;
}

TEST(DrawBatch, StaysInItsSplit) {
  const Snapshot snapshot = Unbalanced();
  for (std::uint64_t step = 0; step < 20; ++step)
    for (const auto& sample : DrawBatch(snapshot, Split::kTrain, 1, step, 16))
      EXPECT_EQ(snapshot.episodes()[sample.frame.episode]->split, Split::kTrain);
}

double ShareAtRest(const Snapshot& snapshot, double rest) {
  int at_rest = 0, all = 0;
  for (std::uint64_t step = 0; step < 100; ++step)
    for (const auto& sample : DrawBatch(snapshot, Split::kTrain, 1, step, 30, 0, rest)) {
      at_rest += snapshot.episodes()[sample.frame.episode]->AtRest(sample.frame.frame);
      ++all;
    }
  return static_cast<double>(at_rest) / all;
}

TEST(DrawBatch, TakesAShareOfTheFramesAtRest) {
  const Snapshot half = Unbalanced(15);

  EXPECT_NEAR(ShareAtRest(half, 1), 0.5, 0.03);
  EXPECT_NEAR(ShareAtRest(half, 0.25), 0.2, 0.03);  // of three frames at rest as much as 3/4 of one of three others
  EXPECT_TRUE(Same(DrawBatch(half, Split::kTrain, 1, 5, 32), DrawBatch(half, Split::kTrain, 1, 5, 32, 0, 1)));
}

// a task may hold still before it goes on
TEST(EpisodeEntry, IsAtRestOnlyAtItsEnd) {
  EpisodeEntry entry;
  Episode& episode = entry.record.episode;
  episode.image_stride = 1;
  episode.stage_names = {"hold", "approach", "hold"};
  episode.phase = {0, 1, 2};
  EXPECT_FALSE(entry.AtRest(0));
  EXPECT_FALSE(entry.AtRest(1));
  EXPECT_TRUE(entry.AtRest(2));
  EXPECT_FALSE(entry.AtRest(3)) << "behind its end";
  episode.stage_names.back() = "lift";
  EXPECT_FALSE(entry.AtRest(2));
}

TEST(DrawBatch, TakesWhatThereIsWhereEverythingRests) {
  const Snapshot resting = Unbalanced(0);

  EXPECT_EQ(DrawBatch(resting, Split::kTrain, 1, 5, 32, 0, 1e-9).size(), 32u);
  EXPECT_EQ(ShareAtRest(resting, 1e-9), 1);
}

TEST(SpreadFrames, VisitsEveryEpisodeOnceThereIsRoom) {
  const Snapshot snapshot = Unbalanced();
  std::set<std::uint32_t> seen;
  std::set<std::pair<std::uint32_t, std::uint32_t>> frames;
  for (const auto& sample : SpreadFrames(snapshot, Split::kValid, 1, 1000)) {
    seen.insert(sample.frame.episode);
    frames.insert({sample.frame.episode, sample.frame.frame});
  }
  EXPECT_EQ(seen.size(), snapshot.episode_count(Split::kValid));
  EXPECT_EQ(frames.size(), snapshot.frame_count(Split::kValid));
  EXPECT_LE(SpreadFrames(snapshot, Split::kValid, 1, 9).size(), 9u);
}

TEST(Snapshot, LeavesOutFramesThatShowNoTarget) {
  auto entry = std::make_shared<EpisodeEntry>();
  entry->record.episode = MakeSyntheticEpisode(SyntheticSpec(), 0, 50);
  entry->record.frames.resize(1);
  entry->record.frames[0].count = 10;
  Episode& episode = entry->record.episode;
  for (auto& object : episode.objects)
    if (object.name == episode.target) object.pixel.values[2 * 5] = -3;  // frame 1 is control step 5
  entry->usable = UsableFrames(*entry);

  const Snapshot snapshot({entry});

  const auto& refs = snapshot.frames(Split::kTrain).at(episode.task);
  EXPECT_EQ(refs.size(), 9u);
  for (const auto& ref : refs) EXPECT_NE(ref.frame, 1u);
}

TEST(DrawCommands, StartsWithTheDemonstratedOneAndRelabelsTheOthers) {
  const Episode episode = MakeSyntheticEpisode(SyntheticSpec(), 2);
  const std::vector<std::string> tasks{"pick", "push", "put_down"};

  const auto commands = DrawCommands(episode, tasks, 6, 99);

  ASSERT_EQ(commands.size(), 6u);
  EXPECT_EQ(commands[0].task, episode.task);
  EXPECT_EQ(commands[0].target, episode.target);
  std::set<std::string> targets;
  for (const auto& command : commands) targets.insert(command.target);
  EXPECT_EQ(targets.size(), 6u);  // every object of the scene once
}

TEST(DrawCommands, RelationsReferToAnyObjectButTheirTarget) {
  Episode episode = MakeSyntheticEpisode(SyntheticSpec(), 2);
  episode.task = "place_left";
  for (const auto& object : episode.objects)
    if (object.name != episode.target) episode.reference = object.name;

  std::set<std::string> references;  // of the demonstrated target
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    const auto commands = DrawCommands(episode, {"pick", "place_left", "place_behind"}, 8, seed);

    EXPECT_EQ(commands[0].reference, episode.reference) << "what was demonstrated stays";
    for (std::size_t s = 1; s < commands.size(); ++s) {
      const auto& command = commands[s];
      EXPECT_EQ(command.reference.empty(), !ParseTask(command.task)->relation()) << command.task;
      EXPECT_NE(command.reference, command.target);
      if (command.target == episode.target && !command.reference.empty()) references.insert(command.reference);
    }
  }
  EXPECT_EQ(references.size(), episode.objects.size() - 1);
}

TEST(DrawCommands, DrawsAReferenceWhereThereIsNone) {
  const Episode episode = MakeSyntheticEpisode(SyntheticSpec(), 2);
  std::set<std::string> references;
  for (std::uint64_t seed = 0; seed < 40; ++seed)
    for (const auto& command : DrawCommands(episode, {"place_front"}, 6, seed)) {
      EXPECT_NE(command.reference, command.target);
      EXPECT_EQ(command.reference.empty(), command.task == episode.task);
      references.insert(command.reference);
    }
  EXPECT_EQ(references.size(), episode.objects.size() + 1);  // and none
}

TEST(DrawCommands, StartsAgainWhenTheSceneIsSmall) {
  CampaignSpec spec = SyntheticSpec();
  spec.objects = {"cube", "coke"};
  const Episode episode = MakeSyntheticEpisode(spec, 2);

  const auto commands = DrawCommands(episode, {"pick"}, 5, 1);

  ASSERT_EQ(commands.size(), 5u);
  for (const auto& command : commands) EXPECT_NE(episode.FindObject(command.target), nullptr);
}

TEST(DrawCommands, DistractorsAreNeverSpokenOf) {
  Episode episode = MakeSyntheticEpisode(SyntheticSpec(), 2);
  for (auto& object : episode.objects)
    if (object.name != episode.target && object.name != "milk" && object.name != "bread")
      object.name = "distractor_" + std::string("apple_00");
  std::set<std::string> named;
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    auto commands = DrawCommands(episode, {"pick", "place_front"}, 6, seed);
    AddClauses(episode, {"pick", "place_left"}, 0.5, seed, commands);
    for (const auto& command : commands) named.insert({command.target, command.reference, command.obstacle});
  }
  for (const auto& name : named) EXPECT_THAT(name, testing::Not(testing::HasSubstr("distractor")));
  EXPECT_TRUE(named.contains(episode.target));
}

TEST(AddClauses, SpeaksOfWhatTheTasksLackAndLeavesTheTarget) {
  const Episode episode = MakeSyntheticEpisode(SyntheticSpec(), 2);
  const std::vector<std::string> tasks{"pick", "push", "put_down", "place_left", "place_behind"};
  const auto grammar = language::Grammar::LoadFor(SyntheticSpec().objects, {});
  ASSERT_TRUE(grammar) << grammar.error().message;
  int with_obstacle = 0, with_reference = 0, all = 0;
  std::set<std::string> obstacles;
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    const auto plain = DrawCommands(episode, {"pick", "push"}, 6, seed);
    auto commands = plain;
    AddClauses(episode, tasks, 0.5, seed, commands);

    EXPECT_EQ(commands[0].task, plain[0].task) << "a trajectory belongs to it";
    for (std::size_t s = 0; s < commands.size(); ++s) {
      EXPECT_EQ(commands[s].target, plain[s].target);
      EXPECT_NE(commands[s].reference, commands[s].target);
      EXPECT_NE(commands[s].obstacle, commands[s].target);
      obstacles.insert(commands[s].obstacle);
      const Status said = grammar->Check(commands[s]);
      EXPECT_TRUE(said) << said.error().message;
      with_obstacle += !commands[s].obstacle.empty();
      with_reference += !commands[s].reference.empty();
      all += s > 0;
    }
  }
  EXPECT_NEAR(static_cast<double>(with_obstacle + with_reference) / all, 0.5, 0.08);
  EXPECT_GT(with_obstacle, all / 8);
  EXPECT_GT(with_reference, all / 8);
  EXPECT_THAT(obstacles, testing::IsSupersetOf({std::string(language::kEverythingElse), std::string(kObstacleObject)}));
  EXPECT_GT(obstacles.size(), 4) << "other things of the scene, too";
}

// What is called as the target is nothing to keep off, and the grammar would refuse it.
TEST(AddClauses, KeepsOffNothingThatIsCalledAsTheTarget) {
  CampaignSpec spec = SyntheticSpec();
  spec.objects.push_back(kObstacleObject);
  Episode episode = MakeSyntheticEpisode(SyntheticSpec(), 2);
  const auto grammar = language::Grammar::LoadFor(spec.objects, {});
  ASSERT_TRUE(grammar) << grammar.error().message;
  const auto target = std::ranges::find(episode.objects, episode.target, &ObjectTrack::name);
  ASSERT_NE(target, episode.objects.end());
  episode.target = target->name = kObstacleObject;
  int named = 0;
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    auto commands = DrawCommands(episode, {"pick", "push"}, 9, seed);
    AddClauses(episode, {"pick"}, 1, seed, commands);
    for (const auto& command : commands) {
      const Status said = grammar->Check(command);
      EXPECT_TRUE(said) << said.error().message;
      named += command.target == kObstacleObject && !command.obstacle.empty();
    }
  }
  EXPECT_GT(named, 0);
}

TEST(AddClauses, AddsNothingWithoutAShare) {
  const Episode episode = MakeSyntheticEpisode(SyntheticSpec(), 2);
  auto commands = DrawCommands(episode, {"pick"}, 6, 1);
  AddClauses(episode, {"pick", "place_left"}, 0, 1, commands);
  for (const auto& command : commands) EXPECT_TRUE(command.obstacle.empty() && command.reference.empty());
}

}  // namespace sampler_test
}  // namespace etude::data
