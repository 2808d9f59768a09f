// SPDX-License-Identifier: Apache-2.0
// Tests services/export/feature_statistics.cc and json_table.cc
#include "services/export/feature_statistics.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "services/export/json_table.h"
#include "tests/support/matchers.h"

namespace etude::exports {
namespace feature_statistics_test {

using testing::DoubleNear;
using testing::ElementsAre;

TEST(FeatureStatistics, AreOfEachColumn) {
  std::vector<double> values;
  for (int i = 0; i <= 100; ++i) values.insert(values.end(), {1.0 * i, 5.0});

  const FeatureStatistics statistics = StatisticsOf(values, 2);

  EXPECT_EQ(statistics.count, 101);
  EXPECT_THAT(statistics.min, ElementsAre(0, 5));
  EXPECT_THAT(statistics.max, ElementsAre(100, 5));
  EXPECT_THAT(statistics.mean, ElementsAre(50, 5));
  EXPECT_THAT(statistics.std, ElementsAre(DoubleNear(std::sqrt(850.0), 1e-9), 0));
  EXPECT_THAT(statistics.quantiles[0], ElementsAre(DoubleNear(1, 1e-9), 5));
  EXPECT_THAT(statistics.quantiles[4], ElementsAre(DoubleNear(99, 1e-9), 5));
}

TEST(FeatureStatistics, LeaveOutWhatIsNotFinite) {
  const FeatureStatistics some = StatisticsOf(std::vector<double>{NAN, 2, 4}, 1);
  EXPECT_THAT(some.mean, ElementsAre(3));
  EXPECT_EQ(some.count, 3);
  EXPECT_THAT(StatisticsOf(std::vector<double>{NAN}, 1).max, ElementsAre(0));
}

TEST(FeatureStatistics, OfTwoEpisodesAreThoseOfAllRows) {
  const std::vector<double> first{1, 2, 3}, second{10, 20, 30, 40, 50};
  std::vector<double> all = first;
  all.insert(all.end(), second.begin(), second.end());

  const FeatureStatistics merged = Merge(StatisticsOf(first, 1), StatisticsOf(second, 1));
  const FeatureStatistics direct = StatisticsOf(all, 1);

  EXPECT_EQ(merged.count, 8);
  EXPECT_NEAR(merged.mean[0], direct.mean[0], 1e-12);
  EXPECT_NEAR(merged.std[0], direct.std[0], 1e-12);
  EXPECT_EQ(merged.min, direct.min);
  EXPECT_EQ(merged.max, direct.max);
  EXPECT_LE(merged.quantiles[1][0], direct.quantiles[1][0]);  // bounds
  EXPECT_GE(merged.quantiles[3][0], direct.quantiles[3][0]);
  EXPECT_EQ(Merge({}, direct).mean, direct.mean);
}

TEST(PictureStatistics, AreOfChannelsInShares) {
  PictureStatistics pictures;
  pictures.Add(std::vector<std::uint8_t>{0, 255, 51, 255, 255, 51});
  pictures.Add(std::vector<std::uint8_t>{0, 255, 51, 0, 255, 51});

  const FeatureStatistics statistics = pictures.Finish();

  EXPECT_EQ(statistics.count, 2);
  EXPECT_THAT(statistics.min, ElementsAre(0, 1, 0.2));
  EXPECT_THAT(statistics.max, ElementsAre(1, 1, 0.2));
  EXPECT_THAT(statistics.mean, ElementsAre(0.25, DoubleNear(1, 1e-12), DoubleNear(0.2, 1e-12)));
  EXPECT_EQ(ToJson(statistics, true, WithQuantiles::kNo)["max"], OrderedJson::parse("[[[1.0]],[[1.0]],[[0.2]]]"));
  EXPECT_TRUE(ToJson(statistics, true, WithQuantiles::kYes).contains("q01"));
}

TEST(JsonTable, FindsTypesAndDepths) {
  const auto row = OrderedJson::parse(R"({"n": 1, "x": 1.5, "t": "a", "b": true, "l": [1.0], "d": [["q"]]})");
  const auto columns = internal::ColumnsOf(row);

  ASSERT_EQ(columns.size(), 6u);
  EXPECT_EQ(columns[0], (ParquetColumn{"n", ParquetType::kInt64, 0}));
  EXPECT_EQ(columns[1], (ParquetColumn{"x", ParquetType::kDouble, 0}));
  EXPECT_EQ(columns[2], (ParquetColumn{"t", ParquetType::kText, 0}));
  EXPECT_EQ(columns[3], (ParquetColumn{"b", ParquetType::kBool, 0}));
  EXPECT_EQ(columns[4], (ParquetColumn{"l", ParquetType::kDouble, 1}));
  EXPECT_EQ(columns[5], (ParquetColumn{"d", ParquetType::kText, 2}));
  EXPECT_THAT(internal::CellsOf({row, row}, columns), IsOk());
  EXPECT_THAT(internal::CellsOf({row, OrderedJson::parse(R"({"n": "1"})")}, columns), MessageHas("column 'n'"));
}

}  // namespace feature_statistics_test
}  // namespace etude::exports
