// SPDX-License-Identifier: Apache-2.0
// Tests trainer/learn/trainer.cc
#include "trainer/learn/trainer.h"

#include <gmock/gmock.h>

#include <filesystem>
#include <thread>

#include "services/language/held_out.h"
#include "tests/trainer/learn/trainer_fixture.h"
#include "trainer/learn/run_state.h"

namespace etude::learn {
namespace trainer_test {

using ::testing::HasSubstr;

// the sequence of losses of an interrupted run is that of an uninterrupted one, to the last bit
TEST_F(TrainerTest, ResumesBitForBit) {
  TrainConfig config = TinyConfig({"steps=40", "ema=0.9"});
  const auto losses = [&](const Path& out, std::uint64_t stop_at, bool resume) {
    std::map<std::string, double> sums;

    Hooks hooks;
    hooks.on_checkpoint = [&](const checkpoint::Checkpoint& kept) -> Status {
      for (const auto& [name, tensor] : kept.tensors)
        if (kept.metadata.step == 40) sums[name] = tensor.to(torch::kFloat64).sum().item<double>();
      // what was learned until then is kept where the checkpoint cannot be
      if (stop_at > 0 && kept.metadata.step == stop_at + 10) return Fail(Code::kInternal, "crash");
      return {};
    };
    const Status status = Train(config, out, resume, hooks);
    EXPECT_EQ(bool(status), stop_at == 0) << (status ? "" : status.error().message);
    return sums;
  };

  const auto whole = losses(folder_ / "whole", 0, false);
  losses(folder_ / "parts", 20, false);  // ends at step 30
  const auto rest = losses(folder_ / "parts", 0, true);

  ASSERT_FALSE(whole.empty());
  EXPECT_EQ(whole, rest);
  const auto a = Curve(folder_ / "whole", "valid", "loss"), b = Curve(folder_ / "parts", "valid", "loss");
  ASSERT_EQ(a.size(), 4u);
  EXPECT_EQ(a, b);
}

// whoever frees a disk of checkpoints has them again from the state that --resume needs
TEST_F(TrainerTest, ResumedAtItsEndMakesTheCheckpointThatIsNotThere) {
  const TrainConfig config = TinyConfig({"steps=20", "ema=0.9"});
  ASSERT_TRUE(Train(config, folder_ / "run"));
  bool there = true;
  std::vector<std::uint64_t> kept;
  Hooks hooks;
  hooks.on_checkpoint = [&](const checkpoint::Checkpoint& made) -> Status {
    kept.push_back(made.metadata.step);
    return {};
  };
  hooks.has_checkpoint = [&](std::uint64_t step) {
    EXPECT_EQ(step, 20u);
    return there;
  };
  ASSERT_TRUE(Train(config, folder_ / "run", true, hooks));
  EXPECT_TRUE(kept.empty());
  there = false;
  ASSERT_TRUE(Train(config, folder_ / "run", true, hooks));
  EXPECT_EQ(kept, std::vector<std::uint64_t>{20});
}

// before, its score stayed, which might never be had again
TEST_F(TrainerTest, ResumedWithoutItsBestCheckpointItHasANewOne) {
  const auto bests = [&](const char* steps, bool resume, bool there) {
    std::vector<std::uint64_t> made;
    Hooks hooks;
    hooks.on_checkpoint = [&](const checkpoint::Checkpoint& kept) -> Status {
      if (kept.metadata.best) made.push_back(kept.metadata.step);
      return {};
    };
    hooks.has_best = [&] { return there; };
    // with so high a rate nothing is better than what the first steps had
    const TrainConfig config =
        TinyConfig({steps, "curriculum.enabled=false", "optimizer.schedule=constant", "optimizer.warmup_steps=0",
                    resume ? "optimizer.lr=0.5" : "optimizer.lr=0.01"});
    EXPECT_TRUE(Train(config, folder_ / "run", resume, hooks));
    return made;
  };
  ASSERT_FALSE(bests("steps=20", false, true).empty());
  std::filesystem::copy(folder_ / "run", folder_ / "copy", std::filesystem::copy_options::recursive);
  ASSERT_TRUE(bests("steps=30", true, true).empty()) << "it is worse";
  std::filesystem::remove_all(folder_ / "run");
  std::filesystem::rename(folder_ / "copy", folder_ / "run");
  EXPECT_EQ(bests("steps=30", true, false), std::vector<std::uint64_t>{30});
}

TEST_F(TrainerTest, ItsFilesSayHowItEnded) {
  const TrainConfig config = TinyConfig({"steps=20", "checkpoint.every_steps=10", "eval.every_steps=40"});
  ASSERT_TRUE(Train(config, folder_ / "run"));
  const auto last = [](const Path& run) {
    const std::string text = ReadTextFile(run / "metrics.jsonl").value();
    return OrderedJson::parse(text.substr(text.rfind('\n', text.size() - 2) + 1));
  };
  EXPECT_EQ(last(folder_ / "run")["kind"], "end");
  EXPECT_EQ(last(folder_ / "run")["cause"], "finished");
  EXPECT_EQ(last(folder_ / "run")["step"], 20);
  EXPECT_EQ(Curve(folder_ / "run", "train", "episodes").begin()->second,
            static_cast<double>(dataset_->snapshot()->episode_count(data::Split::kTrain)));

  Hooks hooks;
  hooks.on_checkpoint = [](const checkpoint::Checkpoint&) -> Status { return Fail(Code::kInternal, "disk full"); };
  EXPECT_FALSE(Train(config, folder_ / "failed", false, hooks));
  EXPECT_EQ(last(folder_ / "failed")["cause"], "failed");
  EXPECT_NE(last(folder_ / "failed")["reason"].get<std::string>().find("disk full"), std::string::npos);
}

TEST_F(TrainerTest, LearnsTheSyntheticTask) {
  const TrainConfig config = TinyConfig({"steps=240", "eval.every_steps=20", "curriculum.latest_last=0.25",
                                         "checkpoint.every_steps=1000", "optimizer.lr=4e-3"});
  const Status trained = Train(config, folder_ / "run");
  ASSERT_TRUE(trained) << trained.error().message;

  const auto pixel = Curve(folder_ / "run", "valid", "EE2D.px");
  const auto position = Curve(folder_ / "run", "valid", "EE3D.cm");
  const auto control = Curve(folder_ / "run", "valid", "CTRL.cm");
  const auto language = Curve(folder_ / "run", "valid", "LANG.accuracy");
  const auto unseen = Curve(folder_ / "run", "valid", "LANG.unseen");
  const auto noisy = Curve(folder_ / "run", "valid", "LANG.noisy");
  ASSERT_FALSE(control.empty());
  EXPECT_LT(pixel.rbegin()->second, 0.5 * pixel.begin()->second);
  EXPECT_LT(position.rbegin()->second, 0.5 * position.begin()->second);
  EXPECT_LT(control.rbegin()->second, control.begin()->second);
  EXPECT_GT(language.rbegin()->second, 0.8);
  EXPECT_GT(noisy.rbegin()->second, 0.7);
  EXPECT_GT(unseen.rbegin()->second, 0.5);
}

TEST_F(TrainerTest, TellsWhereItErrsAfterEachValidationAndLearnsTheSame) {
  const TrainConfig config = TinyConfig({"steps=20", "curriculum.enabled=false"});
  std::vector<std::uint64_t> steps;
  Hooks hooks;
  hooks.on_errors = [&](const std::vector<ErrorCell>& cells, std::uint64_t step) {
    EXPECT_FALSE(cells.empty());
    steps.push_back(step);
  };
  ASSERT_TRUE(Train(config, folder_ / "told", false, hooks));
  ASSERT_TRUE(Train(config, folder_ / "quiet"));

  EXPECT_EQ(steps, (std::vector<std::uint64_t>{10, 20}));
  EXPECT_EQ(Curve(folder_ / "told", "valid", "loss"), Curve(folder_ / "quiet", "valid", "loss"));
}

TEST_F(TrainerTest, GoesThroughTheStagesAndSaysWhy) {
  const TrainConfig config = TinyConfig({"steps=20", "curriculum.latest_last=0.5"});
  std::vector<checkpoint::Metadata> kept_before;
  Hooks hooks;
  hooks.on_checkpoint = [&](const checkpoint::Checkpoint& kept) -> Status {
    kept_before.push_back(kept.metadata);
    return {};
  };
  std::vector<Progress> progress;
  hooks.on_progress = [&](const Progress& p) { progress.push_back(p); };
  ASSERT_TRUE(Train(config, folder_ / "run", false, hooks));

  const auto stages = ReadTextFile(folder_ / "run/curriculum.jsonl");
  ASSERT_TRUE(stages);
  EXPECT_EQ(std::count(stages->begin(), stages->end(), '\n'), 4);
  EXPECT_THAT(*stages, HasSubstr("\"cause\":\"budget\""));
  ASSERT_FALSE(kept_before.empty());
  EXPECT_EQ(kept_before.back().step, 20u);
  EXPECT_EQ(kept_before.back().stage, 5);
  EXPECT_TRUE(kept_before.back().best);
  const auto words = language::WordsIn(kept_before.back().words);
  EXPECT_TRUE(words.contains("the"));
  EXPECT_FALSE(words.contains("xylophonic"));
  ASSERT_FALSE(progress.empty());
  EXPECT_TRUE(progress.back().finished);
  EXPECT_EQ(progress.back().progress, 1.0);
}

// It says the hand anew for each sentence, asks demonstrated commands alone in its last stage, and is measured in all.
TEST_F(TrainerTest, ThePapersGraphGoesThroughItsStagesAndIsMeasured) {
  const TrainConfig config =
      TinyConfig({"policy=paper/faithful", "policy.image.crop=[2, 2, 44, 44]",
                  "policy.image.layers=[{kind: conv, channels: 16, kernel: 5, stride: 2, norm: instance}]",
                  "policy.width=32", "policy.precision=float32", "policy.tasks=[pick, push, put_down]", "steps=20",
                  "eval.every_steps=4", "curriculum.latest_last=0.5", "curriculum.relabelled=before_last"});
  ASSERT_EQ(config.policy.name, "paper/faithful");
  const Status trained = Train(config, folder_ / "run");
  ASSERT_TRUE(trained) << trained.error().message;
  for (const char* metric :
       {"LANG.accuracy", "EE2D.px", "EE3D.cm", "EE3D.deg", "TAR3D.cm", "TAR3D.deg", "DISP.cm", "CTRL.cm", "CTRL.deg"})
    EXPECT_TRUE(Curve(folder_ / "run", "valid", metric).contains(20)) << metric;
}

Hooks Counting(int* saved) {
  Hooks hooks;
  hooks.on_checkpoint = [saved](const checkpoint::Checkpoint&) -> Status {
    ++*saved;
    return {};
  };
  return hooks;
}

TEST_F(TrainerTest, StopsOnALossThatIsNotANumberAndSavesNothing) {
  const TrainConfig config =
      TinyConfig({"optimizer.lr=1e30", "optimizer.clip=0", "curriculum.enabled=false", "optimizer.warmup_steps=0",
                  "eval.every_steps=1000", "checkpoint.every_steps=1000"});
  int saved = 0;

  const Status status = Train(config, folder_ / "run", false, Counting(&saved));

  ASSERT_FALSE(status);
  EXPECT_THAT(status.error().message, HasSubstr("not finite"));
  EXPECT_EQ(saved, 0);
}

// the step itself was finite; what it made of the weights is not
TEST_F(TrainerTest, SavesNothingWhoseValidationIsNotANumber) {
  const TrainConfig config = TinyConfig({"optimizer.lr=1e30", "optimizer.clip=0", "curriculum.enabled=false",
                                         "optimizer.warmup_steps=0", "eval.every_steps=1", "checkpoint.every_steps=1"});
  int saved = 0;
  const Status status = Train(config, folder_ / "run", false, Counting(&saved));
  ASSERT_FALSE(status);
  EXPECT_THAT(status.error().message, HasSubstr("the validation loss is not finite at step 1; nothing was saved"));
  EXPECT_EQ(saved, 0);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "run" / "training_state.safetensors"));
}

// a file system that has gone, say: what was learned until then is good
TEST_F(TrainerTest, KeepsWhatItLearnedWhereTheDataCannotBeReadAnyMore) {
  const TrainConfig config =
      TinyConfig({"steps=100000", "data.cache_mb=0", "eval.every_steps=100000", "checkpoint.every_steps=2"});
  std::uint64_t saved = 0;  // of which step
  Hooks hooks;
  hooks.on_checkpoint = [&](const checkpoint::Checkpoint& checkpoint) -> Status {
    saved = checkpoint.metadata.step;
    for (const auto& file : std::filesystem::recursive_directory_iterator(folder_ / "d"))
      if (file.path().extension() == ".hdf5") std::filesystem::resize_file(file.path(), 100);
    return {};
  };
  const Status status = Train(config, folder_ / "run", false, hooks);
  ASSERT_FALSE(status);
  EXPECT_THAT(status.error().message, HasSubstr("and can be resumed"));
  EXPECT_TRUE(std::filesystem::exists(folder_ / "run" / "training_state.safetensors"));
  EXPECT_THAT(status.error().message, HasSubstr(fmt::format("at step {} ", saved))) << "the last step is kept";
}

// the same where it is a validation that cannot read; before, up to 500 steps were lost
TEST_F(TrainerTest, KeepsWhatItLearnedWhereTheValidationCannotBeReadAnyMore) {
  const TrainConfig config =
      TinyConfig({"steps=100000", "data.cache_mb=0", "eval.every_steps=3", "checkpoint.every_steps=2"});
  Hooks hooks;
  hooks.on_checkpoint = [&](const checkpoint::Checkpoint&) -> Status {
    const auto spec = SyntheticSpec(kTinyPicture, kTinyPicture);
    for (std::uint64_t i = 0; i < spec.episodes; ++i)
      if (const Path file = store::EpisodePath(folder_ / "d", i);
          std::filesystem::exists(file) && SplitOf(spec, i) == "valid")
        std::filesystem::resize_file(file, 100);
    return {};
  };
  const Status status = Train(config, folder_ / "run", false, hooks);
  ASSERT_FALSE(status);
  EXPECT_THAT(status.error().message, HasSubstr("training stopped at step 3 and can be resumed"));
  EXPECT_THAT(status.error().message, HasSubstr("validation pictures"));
  EXPECT_TRUE(std::filesystem::exists(folder_ / "run" / "training_state.safetensors"));
}

TEST_F(TrainerTest, KeepsWhatItLearnedWhereAValidationThrows) {
  const TrainConfig config = TinyConfig({"steps=100", "eval.every_steps=3", "checkpoint.every_steps=100"});
  Hooks hooks;
  hooks.on_errors = [](const std::vector<ErrorCell>&, std::uint64_t) { TORCH_CHECK(false, "the device is full"); };
  const Status status = Train(config, folder_ / "run", false, hooks);
  ASSERT_FALSE(status);
  EXPECT_THAT(status.error().message, HasSubstr("and can be resumed: validate: the device is full"));
  EXPECT_TRUE(std::filesystem::exists(folder_ / "run" / "training_state.safetensors"));
  EXPECT_TRUE(Train(TinyConfig({"steps=20"}), folder_ / "run", true));
}

TEST_F(TrainerTest, RefusesToResumeAnotherArchitecture) {
  ASSERT_TRUE(Train(TinyConfig({"steps=2"}), folder_ / "run"));

  const Status status = Train(TinyConfig({"steps=4", "policy.width=64"}), folder_ / "run", true);

  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().code, Code::kInvalidArgument);
  EXPECT_THAT(status.error().message, HasSubstr("architecture"));
}

TEST_F(TrainerTest, SaysWhatIsMissing) {
  EXPECT_EQ(Train(TinyConfig({"steps=0"}), folder_ / "a").error().code, Code::kInvalidArgument);
  EXPECT_EQ(Train(TinyConfig(), folder_ / "b", true).error().code, Code::kNotFound);
  const Status crop = Train(TinyConfig({"policy.image.crop=[20, 0, 44, 44]"}), folder_ / "c");
  ASSERT_FALSE(crop);
  EXPECT_THAT(crop.error().message, HasSubstr("crop"));
  dataset_ = TinyDataset(folder_ / "small", 1);
  EXPECT_THAT(Train(TinyConfig(), folder_ / "e").error().message, HasSubstr("--follow"));
}

TEST_F(TrainerTest, TakesInEpisodesThatArriveWhileItTrains) {
  const TrainConfig config = TinyConfig({"steps=100000", "minutes=0.5", "eval.every_steps=100000"});
  dataset_ = TinyDataset(folder_ / "growing", 4);
  std::thread collector(
      [&] { AddSyntheticEpisodes(folder_ / "growing", SyntheticSpec(kTinyPicture, kTinyPicture), 4, 30); });
  // the hook stops the run once it has seen all of them
  Hooks hooks;
  std::size_t seen = 0;
  const std::size_t all = [&] {
    std::size_t count = 0;
    for (std::uint64_t i = 0; i < 30; ++i) count += SplitOf(SyntheticSpec(kTinyPicture, kTinyPicture), i) == "train";
    return count;
  }();
  TrainConfig short_run = config;
  short_run.checkpoint.every_steps = 1;
  hooks.on_checkpoint = [&](const checkpoint::Checkpoint& kept) -> Status {
    seen = kept.metadata.train_episodes;
    return seen == all ? Status(Fail(Code::kExhausted, "enough")) : Status();
  };
  auto trainer = Trainer::Create(short_run, dataset_, {.out = folder_ / "run", .follow = true}, hooks);
  ASSERT_TRUE(trainer) << trainer.error().message;
  const Status status = (*trainer)->Run();
  collector.join();

  EXPECT_EQ(seen, all);
  EXPECT_EQ(status.error().code, Code::kExhausted);
}

// before, the growing split changed what errors were of from one evaluation to the next
TEST_F(TrainerTest, ValidatesOnTheSameEpisodesWhileTheDatasetGrows) {
  const auto spec = SyntheticSpec(kTinyPicture, kTinyPicture);
  dataset_ = TinyDataset(folder_ / "growing", 24);
  TrainConfig config = TinyConfig({"steps=30", "data.min_valid=1", "optimizer.lr=1e-12", "optimizer.weight_decay=0"});
  Hooks hooks;
  bool grown = false;
  hooks.on_checkpoint = [&](const checkpoint::Checkpoint&) -> Status {
    if (!grown) AddSyntheticEpisodes(folder_ / "growing", spec, 24, 30);
    grown = true;
    EXPECT_TRUE(dataset_->Refresh());
    return {};
  };
  auto trainer = Trainer::Create(config, dataset_, {.out = folder_ / "run", .follow = true}, hooks);
  ASSERT_TRUE(trainer) << trainer.error().message;
  ASSERT_TRUE((*trainer)->Run());

  const auto accuracy = Curve(folder_ / "run", "valid", "LANG.accuracy");
  ASSERT_EQ(accuracy.size(), 3u);
  // weights hardly move: what is measured is the same
  EXPECT_NEAR(accuracy.begin()->second, accuracy.rbegin()->second, 1e-6);
  const auto state = LoadRunState(folder_ / "run/training_state.safetensors");
  ASSERT_TRUE(state) << state.error().message;
  for (const std::uint64_t index : state->validation) EXPECT_LT(index, 24u);
}

TEST_F(TrainerTest, EndsWithTheWordsOfItsSourceAndSaves) {
  int asked = 0;
  const auto source = [&asked]() -> Status {
    // alive while data are awaited
    return ++asked > 1 ? Status(Fail(Code::kUnavailable, "the collector stopped: disk gone")) : Status();
  };
  auto trainer = Trainer::Create(TinyConfig({"steps=1000000", "eval.every_steps=1000000"}), dataset_,
                                 {.out = folder_ / "run", .follow = true, .source = source}, {});
  ASSERT_TRUE(trainer) << trainer.error().message;
  const Status status = (*trainer)->Run();

  ASSERT_FALSE(status);
  EXPECT_THAT(status.error().message, HasSubstr("disk gone"));
  EXPECT_TRUE(LoadRunState(folder_ / "run/training_state.safetensors"));
}

TEST_F(TrainerTest, CountsWhatEachModuleWasTrainedAndWritesTheLimitThatItKept) {
  std::vector<checkpoint::Metadata> kept_all;
  Hooks hooks;
  hooks.on_checkpoint = [&](const checkpoint::Checkpoint& kept) -> Status {
    kept_all.push_back(kept.metadata);
    return {};
  };
  ASSERT_TRUE(Train(TinyConfig({"steps=20", "curriculum.latest_last=0.5"}), folder_ / "run", false, hooks));

  const auto& modules = kept_all.back().modules;
  EXPECT_EQ(modules.at("LANG").trained_steps, 20u);
  EXPECT_LT(modules.at("CTRL").trained_steps, 15u);
  EXPECT_GT(modules.at("CTRL").trained_steps, 0u);
  EXPECT_TRUE(modules.at("CTRL").error);
  // a run of minutes that ends before it can be measured was as many steps as it did
  ASSERT_TRUE(Train(TinyConfig({"steps=0", "minutes=0.002"}), folder_ / "short"));
  const auto written = LoadTrainConfig((folder_ / "short/config.yaml").string(), "trainer/experiments", {});
  ASSERT_TRUE(written) << written.error().message;
  EXPECT_EQ(written->minutes, 0);
  EXPECT_GE(written->steps, 1u);
}

// it was kept before the validation of the same step, and said what an earlier one had measured
TEST_F(TrainerTest, TheLastCheckpointSaysWhatItsOwnValidationMeasured) {
  const auto config = [](const char* steps, const char* lr) {
    return TinyConfig({steps, lr, "eval.every_steps=20", "checkpoint.every_steps=30", "curriculum.enabled=false",
                       "optimizer.schedule=constant", "optimizer.warmup_steps=0"});
  };
  ASSERT_TRUE(Train(config("steps=20", "optimizer.lr=0.01"), folder_ / "run"));
  std::map<std::uint64_t, double> said;
  Hooks hooks;
  hooks.on_checkpoint = [&](const checkpoint::Checkpoint& kept) -> Status {
    said[kept.metadata.step] = kept.metadata.metrics.at("loss");
    return {};
  };
  ASSERT_TRUE(Train(config("steps=30", "optimizer.lr=0.5"), folder_ / "run", true, hooks));  // worse: no new best
  EXPECT_EQ(said.at(30), Curve(folder_ / "run", "valid", "loss").at(30));
}

}  // namespace trainer_test
}  // namespace etude::learn
