// SPDX-License-Identifier: Apache-2.0
// Tests trainer/learn/error_cells.cc
#include "trainer/learn/error_cells.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "services/core/rng.h"
#include "tests/support/matchers.h"
#include "tests/trainer/learn/tiny_run.h"
#include "trainer/data/statistics.h"
#include "trainer/learn/tensors.h"

namespace etude::learn {
namespace error_cells_test {

// by hand: the mean of TAR2D is 4 px, of TAR3D 0.5 m
TEST(ToErrorCells, AveragesErrorsRelativeToTheirModules) {
  const auto cells = ToErrorCells({{"TAR2D", 7, "pick", "cube", 3, 2},
                                   {"TAR2D", 7, "pick", "cube", 3, 4},
                                   {"TAR2D", 8, "pick", "cube", 3, 6},
                                   {"TAR3D", 8, "pick", "cube", 3, 0.25},
                                   {"TAR3D", 9, "", "coke", 5, 0.75},
                                   {"IDLE", 9, "", "milk", 5, 0}});
  // 0.5, 1, 1.5 and 0.5 of two episodes
  EXPECT_THAT(cells, testing::ElementsAre(ErrorCell{"", "coke", 5, 1, 1.5}, ErrorCell{"pick", "cube", 3, 2, 0.875}));
}

TEST(ToErrorCells, BoundsWhatOnePictureCanSay) {
  std::vector<SentenceError> errors(99, SentenceError{"TAR2D", 1, "pick", "cube", 0, 1});
  errors.push_back({"TAR2D", 2, "push", "coke", 1, 1e6});
  const auto cells = ToErrorCells(errors);
  ASSERT_EQ(cells.size(), 2u);
  EXPECT_EQ(cells[1].task, "push");
  EXPECT_EQ(cells[1].error, kLargestRelativeError);
}

TEST(ToErrorCells, HasNothingToSayOfNothing) { EXPECT_TRUE(ToErrorCells({}).empty()); }

// a mean of relative errors over all sentences is one, cell by cell too when weighted by how many they are of
TEST(ToErrorCells, OfOneModuleAreOneOnAverage) {
  std::vector<SentenceError> errors;
  Rng rng(3);
  for (std::uint64_t i = 0; i < 60; ++i)
    errors.push_back({"TAR3D", i, "pick", i % 2 ? "cube" : "coke", static_cast<int>(i % 3), rng.Uniform(0.01, 0.02)});
  double sum = 0, episodes = 0;
  for (const ErrorCell& cell : ToErrorCells(errors)) {
    sum += cell.error * static_cast<double>(cell.episodes);
    episodes += static_cast<double>(cell.episodes);
  }
  EXPECT_EQ(episodes, 60);
  EXPECT_NEAR(sum / episodes, 1, 1e-12);
}

class MeasureErrorsTest : public testing::Test {
 protected:
  void SetUp() override {
    dataset_ = TinyDataset(folder_ / "d", 24);
    ASSERT_TRUE(dataset_->Refresh());
    snapshot_ = dataset_->snapshot();
    const auto statistics = data::ComputeStatistics(*snapshot_);
    ASSERT_TRUE(statistics);
    auto policy = policy::Policy::Create(config_.policy, ToNormalization(*statistics), 1);
    ASSERT_TRUE(policy) << policy.error().message;
    policy_ = *policy;
    policy_->train();
    auto grammar = language::Grammar::Load();
    ASSERT_TRUE(grammar);
    maker_ = std::make_unique<data::BatchMaker>(config_.data, TinyContent(config_.policy, dataset_->spec()),
                                                std::make_shared<const language::Grammar>(std::move(*grammar)));
    samples_ = data::SpreadFrames(*snapshot_, data::Split::kValid, 1, 20);
  }
  Result<std::vector<ErrorCell>> Measure(int level, int batch = 8) {
    return MeasureErrors(*policy_, {*maker_, *snapshot_, samples_, level, batch});
  }

  TemporaryFolder folder_;
  TrainConfig config_ = TinyConfig();
  std::shared_ptr<data::Dataset> dataset_;
  std::shared_ptr<const data::Snapshot> snapshot_;
  std::shared_ptr<policy::Policy> policy_;
  std::unique_ptr<data::BatchMaker> maker_;
  std::vector<data::Sample> samples_;
};

TEST_F(MeasureErrorsTest, TellsOfTheDemonstratedTasksAndOfEveryObjectWhereItStands) {
  const auto cells = Measure(5);

  ASSERT_THAT(cells, IsOk());
  ASSERT_FALSE(cells->empty());
  std::set<std::string> tasks, objects;
  for (const ErrorCell& cell : *cells) {
    tasks.insert(cell.task);
    objects.insert(cell.object);
    bool stands_there = false;
    for (const auto& entry : snapshot_->episodes()) {
      if (entry->split != data::Split::kValid) continue;
      if (!cell.task.empty() && (entry->episode().task != cell.task || entry->episode().target != cell.object))
        continue;
      const auto pose = entry->episode().FindObject(cell.object)->pose.row(0);
      stands_there = stands_there || PlaceOf(pose[0], pose[1]) == cell.place;
    }
    EXPECT_TRUE(stands_there) << cell.task << " " << cell.object << " " << cell.place;
    EXPECT_GE(cell.error, 0);
    EXPECT_LE(cell.error, kLargestRelativeError);
  }
  EXPECT_TRUE(tasks.contains("")) << "relabelled sentences";
  EXPECT_GT(tasks.size(), 1u) << "and demonstrated ones";
  EXPECT_EQ(objects.size(), dataset_->spec().objects.size()) << "with six sentences each object is asked about";

  CampaignSpec spec = dataset_->spec();
  spec.adaptive_sampling.share = 0.5;
  EXPECT_THAT(ParseErrorCells(ErrorCellsText(*cells), spec), IsOk()) << "a collector takes them";
}

TEST_F(MeasureErrorsTest, IsTheSameAgainAndLeavesThePolicyTraining) {
  const auto once = Measure(5), again = Measure(5);
  ASSERT_THAT(once, IsOk());
  ASSERT_THAT(again, IsOk());
  EXPECT_EQ(*once, *again);
  EXPECT_TRUE(policy_->is_training());
}

TEST_F(MeasureErrorsTest, SaysNothingBeforeAModuleSaysWhereThingsAre) {
  const auto cells = Measure(1);
  ASSERT_THAT(cells, IsOk());
  EXPECT_TRUE(cells->empty()) << "the first level names objects only";
  samples_.clear();
  EXPECT_THAT(Measure(5), HasCode(Code::kNotFound));
}

}  // namespace error_cells_test
}  // namespace etude::learn
