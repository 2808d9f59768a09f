// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/api/episode_filter.cc
#include "dashboard/server/api/episode_filter.h"

#include <gtest/gtest.h>

#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::api {
namespace episode_filter_test {

class EpisodeFilterTest : public testing::Test {
 protected:
  EpisodeFilterTest() {
    row_.index = 3;
    row_.known = true;
    row_.task = "pick", row_.target = "coke", row_.split = "train";
    row_.instruction = "Pick up the coke-can";
    row_.steps = 300;
    row_.t = 1795368176.0;
  }
  bool Holds(const std::string& query) {
    const auto filter = EpisodeFilter::From(http::Query(query), dataset_);
    EXPECT_THAT(filter, IsOk()) << query;
    return filter && filter->Holds(row_);
  }
  TemporaryFolder folder_;
  sources::DatasetSource dataset_{{sources::Kind::kDataset, "d", "d", folder_.path(), "d", ""}};
  sources::EpisodeRow row_;
};

TEST_F(EpisodeFilterTest, ValuesAreAlternativesAndKeysMustAllHold) {
  EXPECT_TRUE(Holds(""));
  EXPECT_TRUE(Holds("task=push&task=pick"));
  EXPECT_FALSE(Holds("task=push"));
  EXPECT_FALSE(Holds("task=pick&target=cube"));
  EXPECT_TRUE(Holds("key=train"));
  EXPECT_FALSE(Holds("key=valid"));
}

TEST_F(EpisodeFilterTest, WordsAreWholeAndInAnyOrder) {
  EXPECT_TRUE(Holds("words=can+PICK"));
  EXPECT_FALSE(Holds("words=ca"));
}

TEST_F(EpisodeFilterTest, SpansMayBeOpenAndTheUnknownIsInNone) {
  EXPECT_TRUE(Holds("steps=300..300"));
  EXPECT_TRUE(Holds("steps=..300"));
  EXPECT_FALSE(Holds("steps=301.."));
  EXPECT_FALSE(Holds("odd=0.."));
  EXPECT_TRUE(Holds("t=2026-11-22T00:00:00Z.."));
  row_.known = false;
  EXPECT_FALSE(Holds("steps=0.."));
  for (const char* query : {"steps=5", "steps=a..b", "t=x.."})
    EXPECT_THAT(EpisodeFilter::From(http::Query(query), dataset_), HasCode(Code::kInvalidArgument)) << query;
  EXPECT_THAT(EpisodeFilter::From(http::Query("key=none"), dataset_), HasCode(Code::kNotFound));
}

}  // namespace episode_filter_test
}  // namespace etude::api
