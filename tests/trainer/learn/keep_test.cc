// SPDX-License-Identifier: Apache-2.0
// Tests trainer/learn/keep.cc, build.cc, build_data.cc and begin.cc
#include "trainer/learn/keep.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>

#include "services/language/held_out.h"
#include "services/spec/episode_world.h"
#include "tests/trainer/learn/tiny_run.h"
#include "trainer/checkpoint/readiness.h"
#include "trainer/learn/tensors.h"
#include "trainer/policy/layers.h"

namespace etude::learn {
namespace keep_test {

using ::testing::HasSubstr;

class KeepTest : public ::testing::Test {
 protected:
  void SetUp() override {
    at::set_num_threads(1);
    dataset_ = TinyDataset(folder_ / "d", 24);
  }
  std::unique_ptr<TrainingRun> Build(const std::vector<std::string>& overrides, bool resume = false) {
    auto run = BuildRun(TinyConfig(overrides), dataset_, {.out = folder_ / "run", .resume = resume});
    EXPECT_TRUE(run) << run.error().message;
    return run ? std::move(*run) : nullptr;
  }
  // one step with everything in training
  static void Step(TrainingRun& run, std::uint64_t number, double lr) {
    const auto snapshot = run.dataset->snapshot();
    data::Batch batch;
    data::FrameScratch scratch;
    ASSERT_TRUE(run.maker->Make(*snapshot, data::DrawBatch(*snapshot, data::Split::kTrain, 1, number, 16), number,
                                data::Augment::kYes, scratch, batch));
    run.optimizer->ZeroGradients();
    ASSERT_TRUE(run.replicas->Backward(batch, 5));
    run.optimizer->Step(lr);
  }
  // running statistics that the front replica's weights have over many batches
  static std::map<std::string, torch::Tensor> Measured(TrainingRun& run) {
    constexpr int kBatches = 24;
    const torch::NoGradGuard no_grad;
    auto& policy = run.replicas->front();
    std::map<std::string, torch::Tensor> sums;
    data::Batch batch;
    data::FrameScratch scratch;
    for (int i = 0; i < kBatches; ++i) {
      const auto snapshot = run.dataset->snapshot();
      const auto samples = data::DrawBatch(*snapshot, data::Split::kTrain, 77, static_cast<std::uint64_t>(i), 16);
      EXPECT_TRUE(run.maker->Make(*snapshot, samples, 0, data::Augment::kYes, scratch, batch));
      for (const auto& item : policy.named_buffers())
        if (item.key().find("running") != std::string::npos) item.value().zero_();
      (void)policy.Forward(PartOf(batch, 0, batch.size).inputs, 5);
      for (const auto& item : policy.named_buffers()) {
        if (item.key().find("running") == std::string::npos) continue;
        const auto scaled = item.value() / (policy::kNormMomentum * kBatches);
        sums[item.key()] = sums.contains(item.key()) ? sums[item.key()] + scaled : scaled;
      }
    }
    return sums;
  }

  TemporaryFolder folder_;
  std::shared_ptr<data::Dataset> dataset_;
};

// before, they were evaluated and saved with the statistics of the raw weights
TEST_F(KeepTest, AveragedWeightsHaveStatisticsThatBelongToThem) {
  auto run = Build({"ema=0.98", "curriculum.enabled=false"});
  ASSERT_NE(run, nullptr);
  for (std::uint64_t i = 0; i < 12; ++i) {
    Step(*run, i, 2e-2);
    run->optimizer->UpdateAverage(0.98);
  }
  const auto raw = run->replicas->front().StateTensors();
  std::map<std::string, torch::Tensor> before;
  for (const auto& [name, tensor] : raw) before[name] = tensor.detach().clone();

  std::map<std::string, torch::Tensor> kept, belonging;
  {
    const AveragedWeights averaged(*run);
    for (const auto& [name, tensor] : run->replicas->front().StateTensors()) kept[name] = tensor.detach().clone();
    belonging = Measured(*run);
  }

  ASSERT_FALSE(belonging.empty());
  double own_error = 0, raw_error = 0;
  for (const auto& [name, tensor] : belonging) {
    own_error += (kept.at(name) - tensor).abs().sum().item<double>();
    raw_error += (before.at(name) - tensor).abs().sum().item<double>();
  }
  EXPECT_LT(own_error, 0.25 * raw_error);
  // and everything is as it was afterwards
  for (const auto& [name, tensor] : run->replicas->front().StateTensors())
    EXPECT_TRUE(torch::equal(tensor, before.at(name))) << name;
}

TEST_F(KeepTest, ACheckpointSaysWhatEachModuleHasBehindIt) {
  auto run = Build({"steps=30"});
  ASSERT_NE(run, nullptr);
  run->modules["LANG"] = {7, 0.25};
  std::optional<checkpoint::Checkpoint> kept;
  Hooks hooks;
  hooks.on_checkpoint = [&](const checkpoint::Checkpoint& checkpoint) -> Status {
    kept = checkpoint;
    return {};
  };
  ASSERT_TRUE(KeepNow(*run, hooks, true));

  ASSERT_TRUE(kept);
  EXPECT_EQ(kept->metadata.modules.at("LANG").error, 0.25);
  EXPECT_TRUE(kept->metadata.best);
  EXPECT_EQ(kept->metadata.embodiment.width, kTinyPicture);
  EXPECT_FALSE(kept->metadata.embodiment.robot.empty());
  EXPECT_THAT(checkpoint::WhyUntrained(kept->metadata), HasSubstr("CTRL has 0 trained steps"));

  // and a run that goes on knows it, and validates on the same episodes
  const auto again = Build({"steps=30"}, true);
  ASSERT_NE(again, nullptr);
  EXPECT_EQ(again->modules.at("LANG").trained_steps, 7u);
  ASSERT_EQ(again->validation->episodes().size(), run->validation->episodes().size());
}

// averaged weights take memory that may not be there; what was learned is saved all the same
TEST_F(KeepTest, TheStateIsKeptWhereTheCheckpointCannotBeComputed) {
  auto run = Build({"steps=30"});
  ASSERT_NE(run, nullptr);
  run->step = 17;
  Hooks hooks;
  hooks.on_checkpoint = [](const checkpoint::Checkpoint&) -> Status {
    (void)torch::empty({std::int64_t{1} << 50});
    return {};
  };
  const Status kept = KeepNow(*run, hooks, false);
  ASSERT_FALSE(kept);
  EXPECT_EQ(kept.error().code, Code::kUnavailable);
  EXPECT_THAT(kept.error().message, HasSubstr("checkpoint of step 17: out of memory"));
  const auto again = Build({"steps=30"}, true);
  ASSERT_NE(again, nullptr);
  EXPECT_EQ(again->step, 17u);
  EXPECT_EQ(again->checkpoint_step, 0u);
}

// before, up to checkpoint.every_steps of them were lost with a folder of checkpoints that had gone
TEST_F(KeepTest, TheStateIsKeptWhereTheCheckpointCannotBeWritten) {
  auto run = Build({"steps=30"});
  ASSERT_NE(run, nullptr);
  run->step = 17;
  Hooks hooks;
  hooks.on_checkpoint = [](const checkpoint::Checkpoint&) -> Status { return Fail(Code::kInternal, "no such folder"); };
  const Status kept = KeepNow(*run, hooks, false);
  ASSERT_FALSE(kept);
  EXPECT_THAT(kept.error().message, HasSubstr("checkpoint of step 17: no such folder"));
  const auto again = Build({"steps=30"}, true);
  ASSERT_NE(again, nullptr);
  EXPECT_EQ(again->step, 17u);
  EXPECT_EQ(again->checkpoint_step, 0u);
}

// As of an earlier import, whose spec has what its first recording tracked: before, the first sentence about what a
// later one shows besides ended the process.
TEST_F(KeepTest, SentencesAreAboutAllThatStandsInAScene) {
  const CampaignSpec spec = SyntheticSpec(kTinyPicture, kTinyPicture);
  {
    auto writer = store::DatasetWriter::Open(folder_ / "import", spec);
    ASSERT_TRUE(writer) << writer.error().message;
    for (std::uint64_t i = 0; i < 24; ++i) {
      Episode episode = MakeSyntheticEpisode(spec, i);
      const auto other = std::ranges::find_if(episode.objects,
                                              [&](const ObjectTrack& object) { return object.name != episode.target; });
      ASSERT_NE(other, episode.objects.end());
      if (i > 0) other->name = "wrench";
      ASSERT_TRUE(writer->Commit(episode));
    }
  }
  dataset_ = *data::Dataset::Open(folder_ / "import");
  const auto run = Build({"data.sentences=6"});
  ASSERT_NE(run, nullptr);
  const auto snapshot = run->dataset->snapshot();
  data::Batch batch;
  data::FrameScratch scratch;
  bool said = false;
  for (std::uint64_t number = 0; number < 10; ++number) {
    ASSERT_TRUE(run->maker->Make(*snapshot, data::DrawBatch(*snapshot, data::Split::kTrain, 1, number, 16), number,
                                 data::Augment::kNo, scratch, batch));
    for (const auto& sentence : batch.sentences) said |= sentence.find("wrench") != std::string::npos;
  }
  EXPECT_TRUE(said);
  EXPECT_TRUE(language::WordsIn(run->words).contains("wrench"));
}

// Clauses are put into relabelled sentences.
TEST_F(KeepTest, WordsOfClausesAreThoseOfTrainingOnlyWhereItRelabels) {
  const auto relabels = Build({"data.clauses=0.25"});
  ASSERT_NE(relabels, nullptr);
  EXPECT_TRUE(language::WordsIn(relabels->words).contains("without"));
  const auto never = Build({"data.clauses=0.25", "curriculum.relabelled=never"});
  ASSERT_NE(never, nullptr);
  EXPECT_FALSE(language::WordsIn(never->words).contains("without"));
}

TEST_F(KeepTest, ARunDoesNotGoOnWithAnotherRobotOrCamera) {
  auto run = Build({"steps=30"});
  ASSERT_NE(run, nullptr);
  run->embodiment.robot = "panda";
  run->embodiment.fovy += 0.2;
  ASSERT_TRUE(KeepNow(*run, {}, false));

  const auto again = BuildRun(TinyConfig({"steps=30"}), dataset_, {.out = folder_ / "run", .resume = true});

  ASSERT_FALSE(again);
  EXPECT_EQ(again.error().code, Code::kInvalidArgument);
  for (const char* part : {"robot", "panda", "fovy"}) EXPECT_THAT(again.error().message, HasSubstr(part));
}

// a crop that depended on the episodes that are there would be another network when the run is resumed
TEST_F(KeepTest, ACameraThatMovesIsPartOfWhatIsLearned) {
  CampaignSpec spec = SyntheticSpec(kTinyPicture, kTinyPicture);
  spec.randomization.world.camera_position = 0.1;
  spec.randomization.world.fovy_deg = 8;
  AddSyntheticEpisodes(folder_ / "moving", spec, 0, 24);
  auto few = data::Dataset::Open(folder_ / "moving");
  ASSERT_TRUE(few) << few.error().message;
  const auto config = TinyConfig({"policy.image.crop=[]"});

  const auto run = BuildRun(config, *few, {.out = folder_ / "run"});

  ASSERT_TRUE(run) << run.error().message;
  EXPECT_EQ((*run)->embodiment.fovy, 0) << "it varies";
  EXPECT_TRUE((*run)->embodiment.camera_pose.empty());
  EXPECT_EQ((*run)->embodiment.width, kTinyPicture);
  const auto crop = policy::CropOf((*run)->config.policy.image);
  for (const Camera& camera : CamerasOf(spec, 200)) {
    const auto alone = policy::ResolveCrop(config.policy.image, camera);
    ASSERT_TRUE(alone) << alone.error().message;
    EXPECT_LE(crop.width, kTinyPicture);
    EXPECT_GE(crop.width, alone->width);
  }
  AddSyntheticEpisodes(folder_ / "moving", spec, 24, 40);
  const auto more = BuildRun(config, *data::Dataset::Open(folder_ / "moving"), {.out = folder_ / "other"});
  ASSERT_TRUE(more) << more.error().message;
  EXPECT_EQ((*more)->config.policy.image.crop, (*run)->config.policy.image.crop);
}

// before: "optimizer state 'parameters' is missing or has another size"
TEST_F(KeepTest, FreezingOnResumeChangesOnlyWhatItNames) {
  auto run = Build({"ema=0.9"});
  ASSERT_NE(run, nullptr);
  for (std::uint64_t i = 0; i < 3; ++i) {
    Step(*run, i, 1e-2);
    run->optimizer->UpdateAverage(0.9);
  }
  std::map<std::string, torch::Tensor> before;
  for (const auto& [name, tensor] : run->optimizer->StateTensors()) before[name] = tensor.clone();
  ASSERT_TRUE(KeepNow(*run, {}, false));

  const auto frozen = Build({"ema=0.9", "init.freeze=[TAR3D]"}, true);
  ASSERT_NE(frozen, nullptr);
  const auto after = frozen->optimizer->StateTensors();
  for (const auto& [name, tensor] : after) EXPECT_TRUE(torch::equal(tensor, before.at(name))) << name;
  int left_out = 0;
  for (const auto& [name, tensor] : before) {
    if (after.contains(name)) continue;
    EXPECT_THAT(name, HasSubstr("modules.TAR3D."));
    ++left_out;
  }
  EXPECT_GT(left_out, 0);

  // and back again: it begins anew, the others go on
  ASSERT_TRUE(KeepNow(*frozen, {}, false));
  const auto thawed = Build({"ema=0.9"}, true);
  ASSERT_NE(thawed, nullptr);
  const auto all = thawed->optimizer->StateTensors();
  for (const auto& [name, tensor] : after) EXPECT_TRUE(torch::equal(all.at(name), tensor)) << name;
  EXPECT_EQ(all.size(), before.size());
}

// The clock of a run in minutes stands still while a disk is full.
TEST_F(KeepTest, WaitingForTheDiskIsNoTimeOfTraining) {
  const auto run = Build({});
  ASSERT_NE(run, nullptr);
  int tries = 0;
  const Stopwatch watch;
  const double before = run->Elapsed();
  ASSERT_TRUE(WriteOrWait(*run, "a file", [&]() -> Status {
    if (++tries < 3) return Fail(Code::kUnavailable, "no space left on device");
    return {};
  }));
  EXPECT_EQ(tries, 3);
  EXPECT_GT(run->waited, 0.9 * watch.Seconds());
  EXPECT_LT(run->Elapsed() - before, 0.5 * watch.Seconds());
}

// Statistics of one picture are none: however many cores there are, each replica has some.
TEST_F(KeepTest, ReplicasHaveEnoughPicturesToNormaliseBy) {
  const auto few = Build({"threads.replicas=0", "data.batch=15"});
  ASSERT_NE(few, nullptr);
  EXPECT_EQ(few->replicas->size(), 1);
  const auto asked = Build({"threads.replicas=3", "data.batch=15"});
  ASSERT_NE(asked, nullptr);
  EXPECT_EQ(asked->replicas->size(), 3) << "who asks for more gets them";
}

// On a machine with more cores it took more replicas, and came to other weights than where it began.
TEST_F(KeepTest, GoesOnWithAsManyReplicasAsItHad) {
  const auto replicas = [&](const std::vector<std::string>& overrides, int cores, bool resume) {
    std::vector<std::string> all{"data.batch=32"};
    all.insert(all.end(), overrides.begin(), overrides.end());
    const auto run = BuildRun(TinyConfig(all), dataset_, {.out = folder_ / "run", .resume = resume, .replicas = cores});
    EXPECT_TRUE(run) << run.error().message;
    if (!run) return 0;
    EXPECT_TRUE(resume || KeepNow(**run, {}, false));
    return (*run)->replicas->size();
  };
  EXPECT_EQ(replicas({"threads.replicas=0"}, 2, false), 2);
  EXPECT_EQ(replicas({"threads.replicas=0"}, 4, true), 2) << "more cores";
  EXPECT_EQ(replicas({"threads.replicas=0"}, 1, true), 2) << "fewer";
  EXPECT_EQ(replicas({"threads.replicas=3"}, 4, true), 3) << "who asks for others gets them";
}

// A lost episode ends no run; scores on the others are new ones.
TEST_F(KeepTest, ResumesWithTheValidationEpisodesThatAreLeft) {
  CampaignSpec spec = SyntheticSpec(kTinyPicture, kTinyPicture);
  spec.split = {3, 1, 0};
  AddSyntheticEpisodes(folder_ / "quarter", spec, 0, 24);
  dataset_ = data::Dataset::Open(folder_ / "quarter").value();
  auto run = Build({});
  ASSERT_NE(run, nullptr);
  ASSERT_GE(run->validation->episodes().size(), 2u);
  const std::size_t before = run->validation->episodes().size();
  run->best_stage = 5;
  run->best_score = 0.25;
  ASSERT_TRUE(KeepNow(*run, {}, false));
  EXPECT_EQ(Build({}, true)->best_score, 0.25);
  std::filesystem::remove(run->validation->episodes().front()->record.path);
  dataset_ = data::Dataset::Open(folder_ / "quarter").value();
  const auto resumed = Build({}, true);
  ASSERT_NE(resumed, nullptr);
  EXPECT_EQ(resumed->validation->episodes().size(), before - 1);
  EXPECT_EQ(resumed->best_stage, 0);
}

// before, what was kept stayed the average of the run before for ever
TEST_F(KeepTest, AnAverageThatWasSwitchedOffIsGone) {
  auto run = Build({"ema=0.9"});
  ASSERT_NE(run, nullptr);
  for (std::uint64_t i = 0; i < 3; ++i) {
    Step(*run, i, 1e-2);
    run->optimizer->UpdateAverage(0.9);
  }
  ASSERT_TRUE(run->optimizer->averages());
  ASSERT_TRUE(KeepNow(*run, {}, false));

  const auto off = Build({"ema=0"}, true);

  ASSERT_NE(off, nullptr);
  EXPECT_FALSE(off->optimizer->averages());
  Step(*off, 3, 1e-2);
  off->optimizer->UpdateAverage(0);
  std::map<std::string, torch::Tensor> kept;
  Hooks hooks;
  hooks.on_checkpoint = [&](const checkpoint::Checkpoint& checkpoint) -> Status {
    for (const auto& [name, tensor] : checkpoint.tensors) kept[name] = tensor.detach().clone();
    return {};
  };
  ASSERT_TRUE(KeepNow(*off, hooks, false));
  for (const auto& [name, tensor] : off->replicas->front().StateTensors())
    EXPECT_TRUE(torch::equal(tensor, kept.at(name))) << name;
  for (const auto& [name, tensor] : off->optimizer->StateTensors()) EXPECT_FALSE(name.starts_with("average")) << name;
}

}  // namespace keep_test
}  // namespace etude::learn
