// SPDX-License-Identifier: Apache-2.0
// Tests trainer/learn/trainer.cc
#include "trainer/learn/trainer.h"

#include <fmt/ranges.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <set>
#include <sstream>
#include <thread>

#include "services/language/held_out.h"
#include "tests/trainer/learn/tiny_run.h"
#include "tests/trainer/policy/clip/tiny_clip.h"
#include "trainer/checkpoint/readiness.h"
#include "trainer/learn/run_state.h"
#include "trainer/policy/clip/text_encoder.h"
#include "trainer/policy/parts.h"

namespace etude::learn {
namespace trainer_test {

using ::testing::HasSubstr;

// values of `key` in lines of `kind`, by step
std::map<std::uint64_t, double> Curve(const Path& run, const std::string& kind, const std::string& key) {
  std::map<std::uint64_t, double> curve;
  const auto text = ReadTextFile(run / "metrics.jsonl");
  EXPECT_TRUE(text);
  std::istringstream lines(text.value_or(""));
  for (std::string line; std::getline(lines, line);) {
    const auto json = OrderedJson::parse(line);
    if (json["kind"] == kind && json.contains(key)) curve[json["step"]] = json[key];
  }
  return curve;
}

class TrainerTest : public ::testing::Test {
 protected:
  void SetUp() override {
    at::set_num_threads(1);
    dataset_ = TinyDataset(folder_ / "d", 24);
  }
  Status Train(const TrainConfig& config, const Path& out, bool resume = false, const Hooks& hooks = {}) {
    auto trainer = Trainer::Create(config, dataset_, {.out = out, .resume = resume}, hooks);
    if (!trainer) return Fail(trainer.error());
    return (*trainer)->Run();
  }

  TemporaryFolder folder_;
  std::shared_ptr<data::Dataset> dataset_;
};

// the sequence of losses of an interrupted run is that of an uninterrupted one, to the last bit
TEST_F(TrainerTest, ResumesBitForBit) {
  TrainConfig config = TinyConfig({"steps=40", "ema=0.9"});
  const auto losses = [&](const Path& out, std::uint64_t stop_at, bool resume) {
    std::map<std::string, double> sums;

    Hooks hooks;
    hooks.on_checkpoint = [&](const checkpoint::Checkpoint& kept) -> Status {
      for (const auto& [name, tensor] : kept.tensors)
        if (kept.metadata.step == 40) sums[name] = tensor.to(torch::kFloat64).sum().item<double>();
      // a hook that fails for good is a crash right after a saved state
      if (stop_at > 0 && kept.metadata.step == stop_at + 10) return Fail(Code::kInternal, "crash");
      return {};
    };
    const Status status = Train(config, out, resume, hooks);
    EXPECT_EQ(bool(status), stop_at == 0) << (status ? "" : status.error().message);
    return sums;
  };

  const auto whole = losses(folder_ / "whole", 0, false);
  losses(folder_ / "parts", 20, false);  // state of step 20 is saved, then it dies at 30
  const auto rest = losses(folder_ / "parts", 0, true);

  ASSERT_FALSE(whole.empty());
  EXPECT_EQ(whole, rest);
  const auto a = Curve(folder_ / "whole", "valid", "loss"), b = Curve(folder_ / "parts", "valid", "loss");
  ASSERT_EQ(a.size(), 4u);
  EXPECT_EQ(a, b);
}

// Folders "d" (24 episodes) and "e" (16, of another seed), read as one.
class SeveralDatasets : public TrainerTest {
 protected:
  void SetUp() override {
    TrainerTest::SetUp();
    CampaignSpec other = SyntheticSpec(kTinyPicture, kTinyPicture);
    other.seed += 1;
    other.split = {3, 1, 0};  // one of four, exactly
    AddSyntheticEpisodes(folder_ / "e", other, 0, 16);
    Read({"d", "e"});
  }
  void Read(const std::vector<std::string>& names) {
    std::vector<Path> folders;
    for (const auto& name : names) folders.push_back(folder_ / name);
    auto dataset = data::Dataset::Open(folders);
    ASSERT_TRUE(dataset) << dataset.error().message;
    dataset_ = *dataset;
  }
  static std::string Words(const Status& status) { return status ? "" : status.error().message; }
};

TEST_F(SeveralDatasets, TrainAndValidateOnAllOfThemAndTheRunSaysWhich) {
  ASSERT_EQ(Words(Train(TinyConfig({"steps=10"}), folder_ / "run")), "");

  const auto snapshot = dataset_->snapshot();
  EXPECT_EQ(snapshot->episodes().size(), 40u);
  const auto state = LoadRunState(folder_ / "run/training_state.safetensors");
  ASSERT_TRUE(state) << state.error().message;
  EXPECT_EQ(state->validation.size(), snapshot->episode_count(data::Split::kValid));
  EXPECT_GE(state->validation.back(), data::EpisodeEntry::NumberOf(1, 0)) << "of the second, too";
  EXPECT_EQ(state->datasets, (std::vector<std::string>{dataset_->spec_sha256(0), dataset_->spec_sha256(1)}));
  const std::string config = ReadTextFile(folder_ / "run/config.yaml").value();
  for (const char* name : {"d", "e"}) EXPECT_THAT(config, HasSubstr((folder_ / name).string()));

  Read({"d"});
  ASSERT_EQ(Words(Train(TinyConfig({"steps=10"}), folder_ / "alone")), "");
  EXPECT_THAT(ReadTextFile(folder_ / "alone/config.yaml").value(), ::testing::Not(HasSubstr("datasets")));
  EXPECT_EQ(LoadRunState(folder_ / "alone/training_state.safetensors")->datasets.size(), 1u);
  Read({"e"});
  EXPECT_THAT(Words(Train(TinyConfig({"steps=20"}), folder_ / "alone", true)),
              HasSubstr("a dataset of another campaign file"))
      << "before, it was validated on another dataset's episodes of the same numbers";
}

TEST_F(SeveralDatasets, ARunGoesOnWithThemInTheirOrderAndMayGetMore) {
  ASSERT_EQ(Words(Train(TinyConfig({"steps=10"}), folder_ / "run")), "");
  Read({"e", "d"});
  EXPECT_THAT(Words(Train(TinyConfig({"steps=20"}), folder_ / "run", true)), HasSubstr("same order"));
  Read({"d"});
  EXPECT_THAT(Words(Train(TinyConfig({"steps=20"}), folder_ / "run", true)), HasSubstr("same order"));
  CampaignSpec third = SyntheticSpec(kTinyPicture, kTinyPicture);
  third.seed += 2;
  AddSyntheticEpisodes(folder_ / "f", third, 0, 8);
  Read({"d", "e", "f"});
  EXPECT_EQ(Words(Train(TinyConfig({"steps=20"}), folder_ / "run", true)), "");
  EXPECT_EQ(LoadRunState(folder_ / "run/training_state.safetensors")->datasets.size(), 3u);
}

TEST_F(SeveralDatasets, ThatDoNotGoTogetherAreRefusedByName) {
  AddSyntheticEpisodes(folder_ / "large", SyntheticSpec(64, 64), 0, 24);
  Read({"d", "large"});
  const std::string camera = Words(Train(TinyConfig({"steps=10"}), folder_ / "run"));
  for (const std::string& text : {std::string("camera width"), (folder_ / "large").string(), (folder_ / "d").string()})
    EXPECT_THAT(camera, HasSubstr(text));
  CampaignSpec panda = SyntheticSpec(kTinyPicture, kTinyPicture);
  panda.robots = {"panda"};
  AddSyntheticEpisodes(folder_ / "panda", panda, 0, 24);
  Read({"d", "panda"});
  const std::string robot = Words(Train(TinyConfig({"steps=10"}), folder_ / "run"));
  for (const std::string& text : {std::string("the panda's"), (folder_ / "panda").string()})
    EXPECT_THAT(robot, HasSubstr(text));
  // before, two cameras that stand still at different places were taken for one that moves
  CampaignSpec elsewhere = SyntheticSpec(kTinyPicture, kTinyPicture);
  elsewhere.camera.position[0] += 0.1;
  AddSyntheticEpisodes(folder_ / "elsewhere", elsewhere, 0, 24);
  Read({"d", "elsewhere"});
  EXPECT_THAT(Words(Train(TinyConfig({"steps=10"}), folder_ / "run")), HasSubstr("camera pose"));
}

TEST_F(TrainerTest, ItsFilesSayHowItEnded) {
  const TrainConfig config = TinyConfig({"steps=60", "checkpoint.every_steps=30"});
  ASSERT_TRUE(Train(config, folder_ / "run"));
  const auto last = [](const Path& run) {
    const std::string text = ReadTextFile(run / "metrics.jsonl").value();
    return OrderedJson::parse(text.substr(text.rfind('\n', text.size() - 2) + 1));
  };
  EXPECT_EQ(last(folder_ / "run")["kind"], "end");
  EXPECT_EQ(last(folder_ / "run")["cause"], "finished");
  EXPECT_EQ(last(folder_ / "run")["step"], 60);
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

TEST_F(TrainerTest, StopsOnALossThatIsNotANumberAndSavesNothing) {
  const TrainConfig config =
      TinyConfig({"optimizer.lr=1e30", "optimizer.clip=0", "curriculum.enabled=false", "optimizer.warmup_steps=0",
                  "eval.every_steps=1000", "checkpoint.every_steps=1000"});
  int saved = 0;
  Hooks hooks;
  hooks.on_checkpoint = [&](const checkpoint::Checkpoint&) -> Status {
    ++saved;
    return {};
  };

  const Status status = Train(config, folder_ / "run", false, hooks);

  ASSERT_FALSE(status);
  EXPECT_THAT(status.error().message, HasSubstr("not finite"));
  EXPECT_EQ(saved, 0);
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
  ASSERT_TRUE(Train(TinyConfig({"steps=20", "curriculum.latest_last=0.5", "init.freeze=[TAR3D]"}), folder_ / "run",
                    false, hooks));

  const auto& modules = kept_all.back().modules;
  EXPECT_EQ(modules.at("LANG").trained_steps, 20u);
  EXPECT_LT(modules.at("CTRL").trained_steps, 15u);
  EXPECT_GT(modules.at("CTRL").trained_steps, 0u);
  EXPECT_TRUE(modules.at("CTRL").error);
  EXPECT_EQ(modules.contains("TAR3D") ? modules.at("TAR3D").trained_steps : 0, 0u);  // frozen
  // a run of minutes that ends before it can be measured was as many steps as it did
  ASSERT_TRUE(Train(TinyConfig({"steps=0", "minutes=0.002"}), folder_ / "short"));
  const auto written = LoadTrainConfig((folder_ / "short/config.yaml").string(), "trainer/experiments", {});
  ASSERT_TRUE(written) << written.error().message;
  EXPECT_EQ(written->minutes, 0);
  EXPECT_GE(written->steps, 1u);
}

/// Runs whose language is CLIP's, of a folder that a test may change.
class ClipTest : public TrainerTest {
 protected:
  void SetUp() override {
    TrainerTest::SetUp();
    clip::WriteTinyClip(clip_, Model(1));
  }
  // a tower that reads sentences letter by letter
  static store::Safetensors Model(std::uint32_t seed) {
    return clip::TinyModel({.width = 64, .layers = 1, .hidden = 64, .positions = 256}, seed);
  }
  TrainConfig Config(std::vector<std::string> overrides = {}) const {
    overrides.insert(overrides.begin(), {"policy.language=clip:" + clip_.string(), "ema=0.9", "steps=10"});
    return TinyConfig(std::move(overrides));
  }

  Path clip_ = folder_ / "clip";
};

TEST_F(ClipTest, NothingThatARunLeavesHoldsTheTower) {
  const auto files = ReadBinaryFile(clip_ / "model.safetensors").value();
  std::vector<std::string> kept_names;
  Hooks hooks;
  hooks.on_checkpoint = [&](const checkpoint::Checkpoint& kept) -> Status {
    for (const auto& [name, tensor] : kept.tensors)
      if (policy::PartOfTensor(name) == "language") kept_names.push_back(name);
    EXPECT_EQ(kept.metadata.policy.language.clip_folder(), clip_.lexically_normal().string());
    EXPECT_EQ(kept.metadata.policy.language.sha256, clip::TextEncoder::Open(clip_).value()->sha256());
    return {};
  };
  const Status trained = Train(Config(), folder_ / "run", false, hooks);
  ASSERT_TRUE(trained) << trained.error().message;

  const std::vector<std::string> own{"language.norm.bias", "language.norm.weight", "language.projection.bias",
                                     "language.projection.weight"};
  EXPECT_THAT(std::set<std::string>(kept_names.begin(), kept_names.end()), testing::ElementsAreArray(own));
  const auto state = LoadRunState(folder_ / "run/training_state.safetensors");
  ASSERT_TRUE(state) << state.error().message;
  for (const auto* tensors : {&state->policy, &state->optimizer})
    for (const auto& [name, tensor] : *tensors) {
      const auto language = name.find("language.");
      if (language != std::string::npos) {
        EXPECT_THAT(own, testing::Contains(name.substr(language))) << name;
      }
    }
  // and what is its own is all there
  EXPECT_TRUE(state->optimizer.contains("first/language.projection.weight"));
  EXPECT_TRUE(state->optimizer.contains("average/language.projection.weight"));
  EXPECT_EQ(ReadBinaryFile(clip_ / "model.safetensors").value(), files);
}

TEST_F(ClipTest, GoesOnOnlyWithTheFolderThatItBeganWith) {
  ASSERT_TRUE(Train(Config(), folder_ / "run"));
  const auto resume = [&](std::vector<std::string> overrides) {
    auto config = LoadTrainConfig((folder_ / "run/config.yaml").string(), "trainer/experiments", overrides);
    EXPECT_TRUE(config) << config.error().message;
    return Train(*config, folder_ / "run", true);
  };
  std::filesystem::rename(clip_, folder_ / "moved");
  const Status gone = resume({"steps=12"});
  ASSERT_FALSE(gone);
  EXPECT_EQ(gone.error().code, Code::kNotFound);
  EXPECT_THAT(gone.error().message, HasSubstr(clip_.string()));

  // the same content elsewhere is the same language
  const std::string moved = "policy.language.encoder=clip:" + (folder_ / "moved").string();
  const Status found = resume({"steps=12", moved});
  EXPECT_TRUE(found) << found.error().message;

  clip::WriteTinyClip(clip_, Model(2));
  const Status other = resume({"steps=14", "policy.language.encoder=clip:" + clip_.string()});
  ASSERT_FALSE(other);
  EXPECT_THAT(other.error().message, HasSubstr("policy.language.encoder=clip:DIR"));
  // nor when the hash is forgotten
  const Status forgotten = Train(Config({"steps=14"}), folder_ / "run", true);
  ASSERT_FALSE(forgotten);
  EXPECT_THAT(forgotten.error().message, HasSubstr("architecture"));
}

TEST_F(ClipTest, SaysAtOnceThatTheFolderIsMissing) {
  std::filesystem::remove_all(clip_);
  const Status refused = Train(Config(), folder_ / "run");
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, Code::kNotFound);
  EXPECT_THAT(refused.error().message, HasSubstr("model.safetensors, vocab.json and merges.txt"));
}

// A base policy on disk, then a run that begins with it.
class InitTest : public TrainerTest {
 protected:
  void SetUp() override {
    TrainerTest::SetUp();
    ASSERT_TRUE(Train(TinyConfig({"steps=20", "ema=0.9"}), folder_ / "base", false, Keeping(source_)));
    const auto bytes = checkpoint::Encode(source_);
    ASSERT_TRUE(bytes);
    ASSERT_TRUE(WriteFileAtomically(file_, *bytes));
  }
  static Hooks Keeping(checkpoint::Checkpoint& last) {
    Hooks hooks;
    hooks.on_checkpoint = [&last](const checkpoint::Checkpoint& kept) -> Status {
      last.metadata = kept.metadata;
      for (const auto& [name, tensor] : kept.tensors) last.tensors[name] = tensor.detach().clone();
      return {};
    };
    return hooks;
  }
  TrainConfig Begun(std::vector<std::string> overrides) const {
    overrides.insert(overrides.begin(), {"init.from=" + file_.string(), "ema=0.9"});
    return TinyConfig(std::move(overrides));
  }

  Path file_ = folder_ / "base.safetensors";
  checkpoint::Checkpoint source_;
};

// encoders with their running statistics and averaged weights included; what is new starts to learn at its level
TEST_F(InitTest, FrozenPartsStayBitForBitWhileModulesAreAdded) {
  const std::set<std::string> frozen{"image", "language", "joints", "LANG",  "TASK",
                                     "EE2D",  "TAR2D",    "EE3D",   "TAR3D", "DISP"};
  checkpoint::Checkpoint grown;
  ASSERT_TRUE(Train(Begun({"add=[obstacle]", fmt::format("init.freeze=[{}]", fmt::join(frozen, ", "))}),
                    folder_ / "run", false, Keeping(grown)));

  int same = 0, moved = 0;
  for (const auto& [name, tensor] : grown.tensors) {
    const std::string part = policy::PartOfTensor(name);
    if (!part.empty() && !frozen.contains(part)) {
      moved += part == "CTRL" && source_.tensors.contains(name) && !torch::equal(tensor, source_.tensors.at(name));
      continue;
    }
    ++same;
    EXPECT_TRUE(torch::equal(tensor, source_.tensors.at(name))) << name;
  }
  EXPECT_GT(same, 60);
  EXPECT_GT(moved, 5);
  const std::string stages = ReadTextFile(folder_ / "run/curriculum.jsonl").value_or("");
  EXPECT_THAT(stages, HasSubstr("\"from\":2")) << stages;
  EXPECT_THAT(stages, testing::Not(HasSubstr("\"from\":1,"))) << stages;
  EXPECT_EQ(grown.metadata.modules.at("TAR2D").trained_steps, source_.metadata.modules.at("TAR2D").trained_steps);
}

// No episode here has an obstacle, and no sentence speaks of one: what is new has no label, and its weights are those
// that it was drawn with. Nothing of that may drive.
TEST_F(InitTest, AModuleWithoutALossWasNotTrained) {
  checkpoint::Checkpoint grown;
  ASSERT_TRUE(Train(Begun({"add=[obstacle]", "data.clauses=0", "curriculum.enabled=false"}), folder_ / "run", false,
                    Keeping(grown)));
  const auto& modules = grown.metadata.modules;
  EXPECT_EQ(modules.contains("OBST2D") ? modules.at("OBST2D").trained_steps : 0, 0u);
  EXPECT_GT(modules.at("CTRL").trained_steps, source_.metadata.modules.at("CTRL").trained_steps);
  const std::string why = checkpoint::WhyUntrained(grown.metadata);
  EXPECT_THAT(why, HasSubstr("OBST2D has 0 trained steps"));
  EXPECT_THAT(why, HasSubstr("OBST3D has no validation error"));
  EXPECT_THAT(why, testing::Not(HasSubstr("TAR3D")));
}

TEST_F(InitTest, ResumesWithoutTheCheckpointThatItBeganWith) {
  const auto config = Begun({"steps=20"});
  ASSERT_TRUE(Train(config, folder_ / "run"));
  std::filesystem::remove(file_);
  auto longer = config;
  longer.steps = 30;
  EXPECT_TRUE(Train(longer, folder_ / "run", true));
  const Status gone = Train(config, folder_ / "other");
  ASSERT_FALSE(gone);
  EXPECT_THAT(gone.error().message, HasSubstr("base.safetensors"));
}

TEST_F(InitTest, RefusesPartsThatDoNotFitByName) {
  const Status wide = Train(Begun({"policy.joint_hidden=[16]"}), folder_ / "wide");
  ASSERT_FALSE(wide);
  EXPECT_THAT(wide.error().message, HasSubstr("joints: joint_hidden is [32] there, [16] here"));
  EXPECT_TRUE(Train(Begun({"policy.joint_hidden=[16]", "init.fresh=[joints]"}), folder_ / "wider"));
}

}  // namespace trainer_test
}  // namespace etude::learn
