// SPDX-License-Identifier: Apache-2.0
// Tests trainer/data/loader.cc
#include "trainer/data/loader.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>

#include "tests/support/temporary_folder.h"
#include "tests/trainer/data/synthetic_dataset.h"

namespace etude::data {
namespace loader_test {

class LoaderTest : public ::testing::Test {
 protected:
  void SetUp() override {
    spec_ = SyntheticSpec();
    AddSyntheticEpisodes(folder_ / "d", spec_, 0, 12);
    auto dataset = Dataset::Open(folder_ / "d");
    ASSERT_TRUE(dataset) << dataset.error().message;
    dataset_ = *dataset;
    ASSERT_TRUE(dataset_->Refresh());
    config_.batch = 8;
  }

  std::shared_ptr<const BatchMaker> Maker() const {
    auto grammar = language::Grammar::Load();
    EXPECT_TRUE(grammar);
    return std::make_shared<const BatchMaker>(config_,
                                              BatchContent{{4, 4, 24, 24}, 32, 32, spec_.tasks, spec_.objects, {}},
                                              std::make_shared<const language::Grammar>(std::move(*grammar)));
  }
  // images of batches first .. last - 1
  std::vector<std::vector<std::uint8_t>> Images(std::uint64_t first, std::uint64_t last) {
    Loader loader(dataset_, Maker(), config_, 3, first);
    std::vector<std::vector<std::uint8_t>> images;
    for (std::uint64_t step = first; step < last; ++step) {
      auto batch = loader.Next();
      EXPECT_TRUE(batch);
      EXPECT_EQ((*batch)->step, step);
      images.push_back((*batch)->images);
      loader.Recycle(std::move(*batch));
    }
    return images;
  }

  TemporaryFolder folder_;
  CampaignSpec spec_;
  std::shared_ptr<Dataset> dataset_;
  DataConfig config_;
};

TEST_F(LoaderTest, GivesTheSameOrderWithAnyNumberOfThreads) {
  const auto one = Images(0, 20);
  config_.threads = 3;
  config_.prefetch = 7;
  EXPECT_EQ(Images(0, 20), one);
}

TEST_F(LoaderTest, ContinuesInTheMiddle) {
  const auto all = Images(0, 12);
  const auto rest = Images(7, 12);
  EXPECT_EQ(rest, std::vector(all.begin() + 7, all.end()));
}

TEST_F(LoaderTest, ReplacesPicturesThatCannotBeRead) {
  // an episode that goes bad after its tracks were read: cut to its header
  const auto snapshot = dataset_->snapshot();
  std::filesystem::resize_file(snapshot->episodes()[0]->record.path, 100);
  std::filesystem::resize_file(snapshot->episodes()[1]->record.path, 100);
  Loader loader(dataset_, Maker(), config_, 3, 0);
  for (int i = 0; i < 10; ++i) {
    auto batch = loader.Next();
    ASSERT_TRUE(batch) << batch.error().message;
    for (const auto& ref : (*batch)->frames) EXPECT_GT(ref.episode, 1u);
    loader.Recycle(std::move(*batch));
  }
  EXPECT_GT(loader.replaced_frames(), 0u);
}

// a hundred of them ended a training on large batches that small ones went on with
TEST_F(LoaderTest, ReplacesAsManyAsABatchHas) {
  const auto snapshot = dataset_->snapshot();
  for (std::size_t i = 0; i < snapshot->episodes().size(); i += 4)
    std::filesystem::resize_file(snapshot->episodes()[i]->record.path, 100);
  config_.batch = 512;
  config_.prefetch = 1;
  Loader loader(dataset_, Maker(), config_, 3, 0);
  const auto batch = loader.Next();
  ASSERT_TRUE(batch) << batch.error().message;
  EXPECT_GT(loader.replaced_frames(), 100u);
}

TEST_F(LoaderTest, EndsWithAnErrorWhenNoPictureCanBeRead) {
  const auto snapshot = dataset_->snapshot();
  for (const auto& entry : snapshot->episodes()) std::filesystem::resize_file(entry->record.path, 100);
  config_.prefetch = 1;
  Loader loader(dataset_, Maker(), config_, 3, 0);
  const auto batch = loader.Next();
  ASSERT_FALSE(batch) << "it tries others, and not for ever";
  EXPECT_NE(batch.error().message.find("make batch 0"), std::string::npos) << batch.error().message;
  EXPECT_GT(loader.replaced_frames(), 0u);
}

TEST_F(LoaderTest, DrawsFromWhatCameInMeanwhile) {
  Loader loader(dataset_, Maker(), config_, 3, 0);
  auto batch = loader.Next();
  ASSERT_TRUE(batch) << batch.error().message;
  for (const auto& ref : (*batch)->frames) EXPECT_LT(ref.episode, 12u);
  AddSyntheticEpisodes(folder_ / "d", spec_, 12, 40);
  ASSERT_EQ(dataset_->Refresh().value(), 28);
  std::uint32_t newest = 0;
  for (int i = 0; i < 40; ++i) {
    loader.Recycle(std::move(*batch));
    batch = loader.Next();
    ASSERT_TRUE(batch) << batch.error().message;
    for (const auto& ref : (*batch)->frames) newest = std::max(newest, ref.episode);
  }
  EXPECT_GE(newest, 12u);
}

TEST_F(LoaderTest, EndsWhileItsThreadsAreAhead) {
  config_.threads = 3;
  config_.prefetch = 9;
  for (int i = 0; i < 5; ++i) {
    Loader loader(dataset_, Maker(), config_, 3, 0);
    if (i % 2 == 0) {
      EXPECT_TRUE(loader.Next());
    }
  }
}

TEST_F(LoaderTest, EndsWithAnErrorWhenThereIsNothing) {
  const TemporaryFolder other;
  AddSyntheticEpisodes(other / "d", spec_, 0, 0);
  auto empty = Dataset::Open(other / "d");
  ASSERT_TRUE(empty);
  Loader loader(*empty, Maker(), config_, 3, 0);

  EXPECT_EQ(loader.Next().error().code, Code::kNotFound);
}

}  // namespace loader_test
}  // namespace etude::data
