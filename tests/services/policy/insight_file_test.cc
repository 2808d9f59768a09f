// SPDX-License-Identifier: Apache-2.0
// Tests services/policy/insight_file.cc
#include "services/policy/insight_file.h"

#include <gtest/gtest.h>

#include <limits>

#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::policy {
namespace insight_file_test {

// TAR2D with two heads over 1 x 3 tokens and the words; LANG reads no picture.
Insight Example(std::uint64_t checkpoint_step) {
  Insight insight;
  insight.checkpoint_step = checkpoint_step;
  insight.modules = OrderedJson::parse(
      R"({"LANG": {"entity": "target", "quantity": "class", "value": "coke"}, "TAR2D": {"value": [1.5, 2]}})");
  insight.attention["LANG"] = {0, 0, {"language", "self"}, {{}, {0.75, 0.25}}, {{{}, {0.75, 0.25}}}};
  insight.attention["TAR2D"] = {
      1, 3, {"language"}, {{0.3, 0.2, 0.25}, {0.25}}, {{{0.6, 0.4, 0}, {0}}, {{0, 0, 0.5}, {0.5}}}};
  insight.view = {10, 20, 30, 16};
  insight.waypoints.assign(kWaypoints, Waypoint{{{0.25, -0.5, 0.125}, Eigen::Quaterniond::Identity()}, 1});
  return insight;
}

class InsightFileTest : public testing::Test {
 protected:
  std::string Bytes() const {
    const auto bytes = ReadBinaryFile(file_).value();
    return {bytes.begin(), bytes.end()};
  }
  void Replace(const std::string& what, const std::string& with) {
    std::string bytes = Bytes();
    const auto at = bytes.find(what);
    ASSERT_NE(at, std::string::npos) << what;
    ASSERT_THAT(WriteFileAtomically(file_, bytes.replace(at, what.size(), with)), IsOk());
  }

  TemporaryFolder folder_;
  const Path file_ = folder_ / InsightFileName(31);
  const InsightsOf of_{31, 18'000'000'000'000'000'001ull, 2};
};

TEST_F(InsightFileTest, HoldsWhatWasSaidAtEachDecision) {
  const auto kept = WriteInsightFile(file_, of_, {{0, Example(7)}, {30, std::nullopt}, {60, Example(8)}});
  ASSERT_THAT(kept, IsOk());
  EXPECT_EQ(*kept, 2u);
  EXPECT_EQ(file_.filename(), "000031.insights");

  const auto read = InsightFile::Open(file_);

  ASSERT_THAT(read, IsOk());
  EXPECT_EQ(read->of(), of_) << "a seed has all its digits";
  ASSERT_EQ(read->decisions().size(), 3u);
  EXPECT_EQ(read->decisions()[1].step, 30);
  EXPECT_FALSE(read->decisions()[1].kept());
  EXPECT_THAT(read->At(1), HasCode(Code::kNotFound));
  EXPECT_THAT(read->At(3), HasCode(Code::kNotFound));
  EXPECT_EQ(read->At(0)->checkpoint_step, 7u);
  const auto last = read->At(2);
  ASSERT_THAT(last, IsOk());
  const Insight wanted = Example(8);
  EXPECT_EQ(last->checkpoint_step, 8u);
  EXPECT_EQ(last->modules, wanted.modules);
  EXPECT_EQ(last->view, wanted.view);
  ASSERT_EQ(last->waypoints.size(), static_cast<std::size_t>(kWaypoints));
  EXPECT_EQ(last->waypoints[11].X_WE.p, wanted.waypoints[11].X_WE.p);
  EXPECT_EQ(last->waypoints[11].gripper, 1);
  EXPECT_TRUE(last->what_if.is_null());
}

TEST_F(InsightFileTest, AWeightIsKeptToAByteOfItsHeadsLargest) {
  ASSERT_THAT(WriteInsightFile(file_, of_, {{0, Example(7)}}), IsOk());

  const auto read = InsightFile::Open(file_)->At(0);

  ASSERT_THAT(read, IsOk());
  for (const auto& [module, wanted] : Example(7).attention) {
    const ModuleAttention& attention = read->attention.at(module);
    EXPECT_EQ(attention.rows, wanted.rows);
    EXPECT_EQ(attention.columns, wanted.columns);
    EXPECT_EQ(attention.keys, wanted.keys);
    ASSERT_EQ(attention.heads.size(), wanted.heads.size());
    for (std::size_t h = 0; h < wanted.heads.size(); ++h) {
      const auto &head = attention.heads[h], &said = wanted.heads[h];
      ASSERT_EQ(head.picture.size(), said.picture.size());
      ASSERT_EQ(head.keys.size(), said.keys.size());
      for (std::size_t k = 0; k < said.picture.size(); ++k) EXPECT_NEAR(head.picture[k], said.picture[k], 0.75 / 510);
      for (std::size_t k = 0; k < said.keys.size(); ++k) EXPECT_NEAR(head.keys[k], said.keys[k], 0.75 / 510);
    }
  }
  EXPECT_EQ(read->attention.at("TAR2D").heads[0].picture[0], 0.6) << "the largest as it was";
  EXPECT_NEAR(read->attention.at("TAR2D").share(), 0.75, 0.01);
}

TEST_F(InsightFileTest, WhatIsNotFiniteIsNoAttention) {
  Insight insight = Example(7);
  insight.attention["TAR2D"].heads[0] = {{std::numeric_limits<double>::quiet_NaN(), -1, 0}, {0}};
  ASSERT_THAT(WriteInsightFile(file_, of_, {{0, insight}}), IsOk());
  const auto read = InsightFile::Open(file_)->At(0);
  ASSERT_THAT(read, IsOk());
  EXPECT_EQ(read->attention.at("TAR2D").heads[0].picture, (std::vector<double>{0, 0, 0}));
}

TEST_F(InsightFileTest, WaypointsThatAreNoneDoNotTakeTheDecisionAlong) {
  Insight insight = Example(7);
  insight.waypoints[1].X_WE.q.coeffs().setConstant(std::numeric_limits<double>::quiet_NaN());
  ASSERT_THAT(WriteInsightFile(file_, of_, {{0, insight}}), IsOk());
  const auto read = InsightFile::Open(file_)->At(0);
  ASSERT_THAT(read, IsOk());
  EXPECT_TRUE(read->waypoints.empty());
  EXPECT_EQ(read->modules, insight.modules);
}

TEST_F(InsightFileTest, ADecisionBeyondTheBoundsIsLeftOut) {
  Insight large = Example(7);
  large.modules["LANG"]["value"] = std::string(kMostInsight, 'x');
  const auto kept = WriteInsightFile(file_, of_, {{0, large}, {30, Example(7)}});
  ASSERT_THAT(kept, IsOk());
  EXPECT_EQ(*kept, 1u);
  const auto read = InsightFile::Open(file_);
  ASSERT_THAT(read, IsOk());
  EXPECT_THAT(read->At(0), HasCode(Code::kNotFound));
  EXPECT_THAT(read->At(1), IsOk());

  InsightsByStep many;
  for (int step = 0; step < static_cast<int>(kMostKeptDecisions) + 5; ++step) many[step] = std::nullopt;
  ASSERT_THAT(WriteInsightFile(file_, of_, many), IsOk());
  EXPECT_EQ(InsightFile::Open(file_)->decisions().size(), kMostKeptDecisions) << "and the file opens";
}

TEST_F(InsightFileTest, RefusesAFirstLineThatItDoesNotKnow) {
  EXPECT_THAT(InsightFile::Open(file_), HasCode(Code::kNotFound));
  for (const char* line :
       {"", "{}", "{}\n", "[]\n", "{\"format\": 7}\n", "{\"format\": \"etude-insights-1\", \"seed\": 7}\n",
        "{\"format\": \"etude-insights-1\", \"seed\": \"7\", \"decisions\": [7]}\n",
        "{\"format\": \"etude-insights-1\", \"seed\": \"7\", \"decisions\": [{\"step\": 0, \"bytes\": 0, \"size\": "
        "1}]}\n",
        "{\"format\": \"etude-insights-1\", \"seed\": \"7\", \"decisions\": [{\"bytes\": 9, \"size\": 99999999999}]}\n",
        "{\"format\": \"etude-insights-1\", \"seed\": \"7\", \"decisions\": [{\"bytes\": 99999999999, \"size\": "
        "9}]}\n"}) {
    ASSERT_THAT(WriteFileAtomically(file_, std::string_view(line)), IsOk());
    EXPECT_THAT(InsightFile::Open(file_), HasCode(Code::kCorrupt)) << line;
  }
}

TEST_F(InsightFileTest, RefusesADamagedBlock) {
  ASSERT_THAT(WriteInsightFile(file_, of_, {{0, Example(7)}}), IsOk());
  const std::string whole = Bytes();
  const auto opens = [&](const std::string& bytes) {
    EXPECT_THAT(WriteFileAtomically(file_, bytes), IsOk());
    return InsightFile::Open(file_)->At(0);
  };
  ASSERT_THAT(opens(whole), IsOk());
  EXPECT_THAT(opens(whole.substr(0, whole.size() - 3)), HasCode(Code::kCorrupt)) << "cut short";
  std::string other = whole;
  other[other.size() - 20] = static_cast<char>(other[other.size() - 20] ^ 0x55);
  EXPECT_THAT(opens(other), HasCode(Code::kCorrupt)) << "a zlib stream has a checksum";
  ASSERT_THAT(WriteFileAtomically(file_, whole), IsOk());
  Replace("\"size\":", "\"size\":1");
  EXPECT_THAT(InsightFile::Open(file_)->At(0), HasCode(Code::kCorrupt)) << "it inflates to another size";
}

}  // namespace insight_file_test
}  // namespace etude::policy
