// SPDX-License-Identifier: Apache-2.0
// Tests trainer/data/batch.cc and trainer/data/frame_cache.cc
#include "trainer/data/batch.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <set>

#include "services/episode/viewpoint.h"
#include "tests/support/temporary_folder.h"
#include "tests/trainer/data/synthetic_dataset.h"

namespace etude::data {
namespace batch_test {

// position, the least that a quantity can be
class PositionRule : public LabelRule {
 public:
  std::vector<std::int64_t> label_shape() const override { return {3}; }
  void FillLabel(const LabelContext&, const EntityState& state, std::span<float> values,
                 std::span<std::uint8_t> valid) const override {
    std::copy_n(state.p.begin(), 3, values.begin());
    valid[0] = 1;
  }
};

// two numbers with a mask each: the pixel's column and row, those that lie in the view
class PixelRule : public LabelRule {
 public:
  std::vector<std::int64_t> label_shape() const override { return {2}; }
  int label_parts() const override { return 2; }
  void FillLabel(const LabelContext& context, const EntityState& state, std::span<float> values,
                 std::span<std::uint8_t> valid) const override {
    const Region& view = context.view;
    const float low[] = {static_cast<float>(view.u), static_cast<float>(view.v)};
    const float high[] = {low[0] + static_cast<float>(view.width), low[1] + static_cast<float>(view.height)};
    for (std::size_t i = 0; i < 2; ++i) {
      values[i] = state.pixel[i];
      valid[i] = values[i] >= low[i] && values[i] < high[i];
    }
  }
};

std::vector<LabelColumn> Columns() {
  static const PositionRule position;
  static const PixelRule pixel;
  std::vector<LabelColumn> columns;
  for (const char* entity : {"target", "ee", "others", "object:coke"})
    columns.push_back({std::string(entity) + ".position", *ParseEntity(entity), &position});
  columns.push_back({"target.pixel", *ParseEntity("target"), &pixel});
  return columns;
}

class BatchTest : public ::testing::Test {
 protected:
  void SetUp() override {
    spec_ = SyntheticSpec(64, 48);
    AddSyntheticEpisodes(folder_ / "d", spec_, 0, 12);
    auto dataset = Dataset::Open(folder_ / "d");
    ASSERT_TRUE(dataset) << dataset.error().message;
    dataset_ = *dataset;
    ASSERT_TRUE(dataset_->Refresh());
    auto grammar = language::Grammar::Load();
    ASSERT_TRUE(grammar);
    grammar_ = std::make_shared<const language::Grammar>(std::move(*grammar));
  }

  BatchMaker Maker(const DataConfig& config = {}) const {
    return BatchMaker(config, {crop_, 64, 48, spec_.tasks, spec_.objects, Columns()}, grammar_);
  }
  Batch Make(const BatchMaker& maker, Augment augment, std::uint64_t step = 0) const {
    const auto snapshot = dataset_->snapshot();
    Batch batch;
    FrameScratch scratch;
    const Status made =
        maker.Make(*snapshot, DrawBatch(*snapshot, Split::kTrain, 7, step, 16), step, augment, scratch, batch);
    EXPECT_TRUE(made) << made.error().message;
    return batch;
  }

  TemporaryFolder folder_;
  CampaignSpec spec_;
  Region crop_{10, 6, 40, 32};
  std::shared_ptr<Dataset> dataset_;
  std::shared_ptr<const language::Grammar> grammar_;
};

TEST_F(BatchTest, CopiesTheCropOfTheRecordedPicture) {
  const Batch batch = Make(Maker(), Augment::kNo);
  const auto snapshot = dataset_->snapshot();

  for (int b = 0; b < batch.size; ++b) {
    const auto& entry = *snapshot->episodes()[batch.frames[b].episode];
    store::FrameReader frames(entry.record.path, entry.record.frames[0]);
    const auto whole = frames.Read(batch.frames[b].frame);
    ASSERT_TRUE(whole);
    for (int y = 0; y < crop_.height; ++y)
      for (int x = 0; x < crop_.width; ++x)
        for (int c = 0; c < 3; ++c)
          ASSERT_EQ(batch.images[static_cast<std::size_t>(((b * crop_.height + y) * crop_.width + x) * 3 + c)],
                    (*whole)[static_cast<std::size_t>(((crop_.v + y) * 64 + crop_.u + x) * 3 + c)]);
    EXPECT_EQ(batch.crop_origin[2 * b], 10);
    EXPECT_EQ(batch.crop_origin[2 * b + 1], 6);
  }
}

TEST_F(BatchTest, SaysOfEachPictureWhereItsCameraIs) {
  const Batch batch = Make(Maker(), Augment::kNo);
  const auto snapshot = dataset_->snapshot();
  ASSERT_EQ(batch.viewpoint.size(), static_cast<std::size_t>(batch.size * kViewpointSize));
  for (std::size_t b = 0; b < batch.frames.size(); ++b) {
    const Viewpoint own = ViewpointOf(snapshot->episodes()[batch.frames[b].episode]->episode().cameras.at(0).camera);
    EXPECT_TRUE(
        std::equal(own.begin(), own.end(), batch.viewpoint.begin() + static_cast<std::ptrdiff_t>(b * kViewpointSize)));
  }
}

TEST_F(BatchTest, MovesTheCropWithItsOriginAndKeepsLabelsAbsolute) {
  DataConfig config;
  config.brightness = config.contrast = config.colour = 0;
  const Batch still = Make(Maker(config), Augment::kNo), moved = Make(Maker(config), Augment::kYes);

  int places = 0;
  for (int b = 0; b < moved.size; ++b) {
    const int du = static_cast<int>(moved.crop_origin[2 * b]) - crop_.u;
    const int dv = static_cast<int>(moved.crop_origin[2 * b + 1]) - crop_.v;
    ASSERT_LE(std::abs(du), 4);
    ASSERT_LE(std::abs(dv), 4);
    places += du != 0 || dv != 0;
    // pixel (20, 15) of the moved crop is pixel (20 + du, 15 + dv) of the still one
    const auto at = [&](const Batch& batch, int x, int y) {
      return batch.images[static_cast<std::size_t>(((b * crop_.height + y) * crop_.width + x) * 3)];
    };
    EXPECT_EQ(at(moved, 20, 15), at(still, 20 + du, 15 + dv));
  }
  EXPECT_GT(places, 10);
  EXPECT_EQ(moved.labels.at("target.position").values, still.labels.at("target.position").values);
}

TEST_F(BatchTest, HidesPartsOfTrainingPicturesAndNothingElse) {
  DataConfig config;
  config.cutout = 0.5;
  const Batch whole = Make(Maker(), Augment::kYes), hidden = Make(Maker(config), Augment::kYes);
  int same = 0;
  for (std::size_t i = 0; i < whole.images.size(); ++i) same += whole.images[i] == hidden.images[i];
  EXPECT_NEAR(same, 0.75 * whole.images.size(), 0.15 * whole.images.size());
  EXPECT_EQ(hidden.crop_origin, whole.crop_origin) << "nothing else is drawn otherwise";
  EXPECT_EQ(hidden.sentences, whole.sentences);
  EXPECT_EQ(Make(Maker(config), Augment::kYes).images, hidden.images);
  EXPECT_EQ(Make(Maker(config), Augment::kNo).images, Make(Maker(), Augment::kNo).images);
}

TEST_F(BatchTest, IsTheSameWhateverTheCacheAndTheBufferHold) {
  const BatchMaker cold = Maker(), warm = Maker();
  DataConfig no_cache;
  no_cache.cache_mb = 0;
  Make(warm, Augment::kYes, 3);

  const Batch a = Make(cold, Augment::kYes, 5), b = Make(warm, Augment::kYes, 5),
              c = Make(Maker(no_cache), Augment::kYes, 5);
  const Batch again = Make(warm, Augment::kYes, 5);

  EXPECT_GT(warm.cache().hits(), 0u);
  for (const Batch* other : {&b, &c, &again}) {
    EXPECT_EQ(a.images, other->images);
    EXPECT_EQ(a.sentences, other->sentences);
    EXPECT_EQ(a.sentence_index, other->sentence_index);
    EXPECT_EQ(a.joints, other->joints);
    for (const auto& [name, label] : a.labels) {
      EXPECT_EQ(label.values, other->labels.at(name).values) << name;
      EXPECT_EQ(label.valid, other->labels.at(name).valid) << name;
    }
  }
}

TEST_F(BatchTest, StopsKeepingCropsAtItsBound) {
  DataConfig config;
  config.cache_mb = 0;
  const BatchMaker maker = Maker(config);
  Make(maker, Augment::kYes);
  Make(maker, Augment::kYes);

  EXPECT_EQ(maker.cache().bytes(), 0u);
  EXPECT_EQ(maker.cache().hits(), 0u);
}

TEST_F(BatchTest, KeepsTheDemonstratedCommandOfEachPictureAlone) {
  const BatchMaker maker = Maker();
  const Batch all = Make(maker, Augment::kYes);
  Batch own = Make(maker, Augment::kYes);
  ASSERT_EQ(all.sentences_each, 6);
  KeepDemonstrated(own);

  EXPECT_EQ(own.sentences_each, 1);
  EXPECT_LT(own.sentences.size(), all.sentences.size()) << "sentences that nobody asks are not encoded";
  ASSERT_EQ(own.sentence_index.size(), 16u);
  for (std::size_t b = 0; b < 16; ++b)
    EXPECT_EQ(own.sentences[static_cast<std::size_t>(own.sentence_index[b])],
              all.sentences[static_cast<std::size_t>(all.sentence_index[6 * b])]);
  EXPECT_EQ(own.images, all.images);

  const auto rows = [](const LabelArray& label, std::size_t b, std::size_t of) {
    const std::size_t size = label.values.size() / of;
    return std::vector<float>(label.values.begin() + static_cast<std::ptrdiff_t>(b * size),
                              label.values.begin() + static_cast<std::ptrdiff_t>((b + 1) * size));
  };
  EXPECT_EQ(own.labels.at("ee.position").values, all.labels.at("ee.position").values);
  for (const char* name : {"target.position", "others.position"}) {
    const LabelArray &few = own.labels.at(name), &many = all.labels.at(name);
    EXPECT_EQ(few.shape[1], 1) << name;
    EXPECT_EQ(few.valid_shape[1], 1) << name;
    EXPECT_EQ(6 * few.values.size(), many.values.size()) << name;
    EXPECT_EQ(6 * few.valid.size(), many.valid.size()) << name;
    for (std::size_t b = 0; b < 16; ++b) EXPECT_EQ(rows(few, b, 16), rows(many, 6 * b, 96)) << name << b;
  }
  const Batch once = own;
  KeepDemonstrated(own);
  EXPECT_EQ(own.sentence_index, once.sentence_index) << "one command a picture stays as it is";
}

TEST_F(BatchTest, LabelsTheObjectThatEachSentenceNames) {
  const Batch batch = Make(Maker(), Augment::kYes);
  const auto snapshot = dataset_->snapshot();
  const LabelArray& target = batch.labels.at("target.position");
  const LabelArray& hand = batch.labels.at("ee.position");
  const LabelArray& coke = batch.labels.at("object:coke.position");
  const LabelArray& others = batch.labels.at("others.position");
  EXPECT_EQ(target.shape, (std::vector<std::int64_t>{16, 6, 3}));
  EXPECT_EQ(hand.shape, (std::vector<std::int64_t>{16, 1, 3}));
  EXPECT_EQ(coke.shape, (std::vector<std::int64_t>{16, 1, 3}));
  EXPECT_EQ(others.shape, (std::vector<std::int64_t>{16, 6, kMaxOthers, 3}));
  EXPECT_EQ(others.valid_shape, (std::vector<std::int64_t>{16, 6, kMaxOthers}));

  for (int b = 0; b < batch.size; ++b) {
    const auto& entry = *snapshot->episodes()[batch.frames[b].episode];
    const Episode& episode = entry.episode();
    const int t = entry.StepOf(batch.frames[b].frame);
    const auto is = [&](const LabelArray& label, std::size_t row, const std::string& name) {
      const auto p = name.empty() ? episode.eef_pos.row(t) : episode.FindObject(name)->pose.row(t).first(3);
      return label.valid[row] && std::equal(p.begin(), p.end(), label.values.begin() + static_cast<long>(3 * row));
    };
    EXPECT_TRUE(is(hand, b, ""));
    EXPECT_TRUE(is(coke, b, "coke"));
    EXPECT_TRUE(is(target, 6 * b, episode.target)) << "the first sentence is what was demonstrated";
    for (int s = 0; s < 6; ++s) {
      std::set<std::string> named;
      for (const auto& object : spec_.objects)
        if (is(target, 6 * b + s, object)) named.insert(object);
      ASSERT_EQ(named.size(), 1u);
      // the others are all but that one, and the remaining places are empty
      for (int k = 0; k < kMaxOthers; ++k) {
        const std::size_t row = static_cast<std::size_t>((6 * b + s) * kMaxOthers + k);
        EXPECT_EQ(others.valid[row], k < 5);
        EXPECT_FALSE(is(others, row, *named.begin()));
      }
    }
  }
}

TEST(Entity, WhatASceneDoesNotHaveHasNoState) {
  Episode episode = MakeSyntheticEpisode(SyntheticSpec(), 3);
  const language::Command command{"pick", "coke", "", "others"};
  const std::vector<std::string> classes;
  const LabelContext context{episode, 0, command, classes, {}};
  EXPECT_EQ(StatesOf(*ParseEntity("target"), context).at(0).name, "coke");
  EXPECT_TRUE(StatesOf(*ParseEntity("reference"), context).empty());
  EXPECT_TRUE(StatesOf(*ParseEntity("obstacle"), context).empty());
  EXPECT_TRUE(StatesOf(*ParseEntity("object:duck"), context).empty());
  EXPECT_EQ(StatesOf(*ParseEntity("others"), context).size(), 5u);

  const language::Command relation{"place_left", "coke", "milk", "bread"};
  const LabelContext other{episode, 0, relation, classes, {}};
  EXPECT_EQ(StatesOf(*ParseEntity("reference"), other).at(0).name, "milk");
  EXPECT_EQ(StatesOf(*ParseEntity("obstacle"), other).at(0).name, "bread");
  for (const char* text : {"", "targets", "object:", "Target"}) EXPECT_FALSE(ParseEntity(text)) << text;
}

TEST_F(BatchTest, NamesEachSentenceOnce) {
  const Batch batch = Make(Maker(), Augment::kYes);
  const std::set<std::string> distinct(batch.sentences.begin(), batch.sentences.end());

  EXPECT_EQ(distinct.size(), batch.sentences.size());
  EXPECT_LE(batch.sentences.size(), 3u * 6u * 4u);
  for (auto index : batch.sentence_index) ASSERT_LT(index, static_cast<std::int64_t>(batch.sentences.size()));
}

TEST_F(BatchTest, PutsAStrangeWordAmongThoseOfTrainingWhereThatIsAskedFor) {
  const auto words = [](const std::string& sentence) { return std::ranges::count(sentence, ' ') + 1; };
  DataConfig plain;
  plain.varied = plain.noisy = 0;
  DataConfig strange = plain;
  strange.strange = 1;
  std::map<std::int64_t, int> lengths, longer;
  for (const auto& sentence : Make(Maker(plain), Augment::kYes).sentences) ++lengths[words(sentence)];
  for (const auto& sentence : Make(Maker(strange), Augment::kYes).sentences) ++longer[words(sentence)];
  EXPECT_EQ(longer.begin()->first, lengths.begin()->first + 1);
  EXPECT_EQ(longer.rbegin()->first, lengths.rbegin()->first + 1);
  EXPECT_EQ(Make(Maker(strange), Augment::kNo).sentences, Make(Maker(plain), Augment::kNo).sentences);
}

TEST_F(BatchTest, MasksPixelsOutsideTheCrop) {
  crop_ = {0, 0, 16, 16};
  DataConfig config;
  config.jitter = 0;
  const Batch batch = Make(Maker(config), Augment::kNo);
  const auto& label = batch.labels.at("target.pixel");
  EXPECT_EQ(label.valid_shape, (std::vector<std::int64_t>{16, 6, 2}));

  int outside = 0;
  for (std::size_t i = 0; i < label.valid.size(); ++i) {
    EXPECT_EQ(label.valid[i] != 0, label.values[i] >= 0 && label.values[i] < 16);
    outside += !label.valid[i];
  }
  EXPECT_GT(outside, 0);
}

TEST_F(BatchTest, RefusesACropThatDoesNotFitThePicture) {
  crop_ = {40, 0, 64, 48};
  const BatchMaker maker = Maker();
  const auto snapshot = dataset_->snapshot();
  Batch batch;
  FrameScratch scratch;

  const Status made =
      maker.Make(*snapshot, DrawBatch(*snapshot, Split::kTrain, 7, 0, 2), 0, Augment::kNo, scratch, batch);

  ASSERT_FALSE(made);
  EXPECT_EQ(made.error().code, Code::kInvalidArgument);
}

TEST_F(BatchTest, IsOfThePicturesThatCanBeRead) {
  DataConfig config;
  config.cache_mb = 0;
  const BatchMaker maker = Maker(config);
  const auto snapshot = dataset_->snapshot();
  auto samples = DrawBatch(*snapshot, Split::kTrain, 7, 0, 16);
  const auto gone = samples.front().frame.episode;
  const auto is_gone = [gone](const Sample& sample) { return sample.frame.episode == gone; };
  const auto lost = std::ranges::count_if(samples, is_gone);
  ASSERT_LT(lost, 16);
  std::ptrdiff_t told = 0;
  const auto count = [&told](const Error&) { ++told; };
  Batch batch;
  FrameScratch scratch;

  std::filesystem::remove(snapshot->episodes()[gone]->record.path);
  const Status some = MakeReadable(maker, *snapshot, 0, Augment::kNo, samples, scratch, batch, count);
  ASSERT_TRUE(some) << some.error().message;
  EXPECT_EQ(told, lost);
  EXPECT_TRUE(std::ranges::none_of(samples, is_gone));
  EXPECT_EQ(batch.frames.size(), samples.size());

  for (const auto& entry : snapshot->episodes()) std::filesystem::remove(entry->record.path);
  EXPECT_FALSE(MakeReadable(maker, *snapshot, 0, Augment::kNo, samples, scratch, batch));
  EXPECT_TRUE(samples.empty());
}

TEST(DataConfig, NamesEveryProblem) {
  DataConfig config;
  config.batch = 0;
  config.varied = 0.9;
  config.noisy = 0.9;
  std::vector<std::string> errors;
  config.Check(errors);
  EXPECT_EQ(errors.size(), 2u);
}

}  // namespace batch_test
}  // namespace etude::data
