// SPDX-License-Identifier: Apache-2.0
// Tests services/policy/insight.cc
#include "services/policy/insight.h"

#include <gtest/gtest.h>

#include <limits>

#include "tests/support/matchers.h"

namespace etude::policy {
namespace insight_test {

// TAR2D with two heads over 1 x 3 tokens and one key more, behind two bytes of somebody else's; LANG reads no picture.
bus::Insight MakeMessage() {
  bus::Insight message;
  message.checkpoint_step = 12;
  message.modules_json = R"({"LANG": {"entity": "target", "quantity": "class", "value": "coke"}})";
  message.attention_json = R"({
      "LANG": {"offset": 0, "heads": 1, "keys": ["language", "self"], "scale": [0.5]},
      "TAR2D": {"offset": 2, "heads": 2, "image": [1, 3], "keys": ["language"], "scale": [1.0, 0.51]}})";
  message.attention = {255, 255, 0, 255, 0, 0, 100, 0, 255, 150};
  message.view = {10, 20, 30, 16};
  const auto waypoint = ToVector(Waypoint{{{0.25, 0.5, 0.125}, Eigen::Quaterniond::Identity()}, 1});
  for (int k = 0; k < kWaypoints; ++k)
    message.waypoints.insert(message.waypoints.end(), waypoint.begin(), waypoint.end());
  return message;
}

TEST(ReadInsight, HasWhatTheMessageSays) {
  const auto insight = ReadInsight(MakeMessage());
  ASSERT_THAT(insight, IsOk());
  EXPECT_EQ(insight->checkpoint_step, 12u);
  EXPECT_EQ(insight->modules["LANG"]["value"], "coke");
  EXPECT_EQ(insight->view, (View{10, 20, 30, 16}));
  ASSERT_EQ(insight->waypoints.size(), static_cast<std::size_t>(kWaypoints));
  EXPECT_EQ(insight->waypoints[11].X_WE.p, Eigen::Vector3d(0.25, 0.5, 0.125));
  EXPECT_EQ(insight->waypoints[11].gripper, 1);
  EXPECT_TRUE(insight->what_if_waypoints.empty());
  bus::Insight message = MakeMessage();
  message.what_if_waypoints = message.waypoints;
  EXPECT_EQ(ReadInsight(message)->what_if_waypoints.size(), static_cast<std::size_t>(kWaypoints));
}

TEST(ReadInsight, AttentionIsOfEveryHeadAndTheirMean) {
  const auto insight = ReadInsight(MakeMessage());
  ASSERT_THAT(insight, IsOk());
  const ModuleAttention& attention = insight->attention.at("TAR2D");
  EXPECT_EQ(attention.rows, 1);
  EXPECT_EQ(attention.columns, 3);
  EXPECT_EQ(attention.keys, std::vector<std::string>{"language"});
  // head 1: 0, 1, 0 and nothing for the language; head 2: 0.51 * (100, 0, 255) / 255 and 0.3 for the language
  ASSERT_EQ(attention.heads.size(), 2u);
  EXPECT_EQ(attention.heads[0].picture, (std::vector<double>{0, 1, 0}));
  EXPECT_EQ(attention.heads[0].keys, std::vector<double>{0});
  ASSERT_EQ(attention.heads[1].picture.size(), 3u);
  EXPECT_NEAR(attention.heads[1].picture[0], 0.2, 1e-12);
  EXPECT_NEAR(attention.heads[1].picture[2], 0.51, 1e-12);
  EXPECT_NEAR(attention.heads[1].keys.at(0), 0.3, 1e-12);
  ASSERT_EQ(attention.mean.picture.size(), 3u);
  EXPECT_NEAR(attention.mean.picture[0], 0.1, 1e-12);
  EXPECT_NEAR(attention.mean.picture[1], 0.5, 1e-12);
  EXPECT_NEAR(attention.mean.picture[2], 0.255, 1e-12);
  EXPECT_NEAR(attention.mean.keys.at(0), 0.15, 1e-12);
  EXPECT_NEAR(attention.share(), 0.855, 1e-12);
}

TEST(ReadInsight, AModuleThatReadsNoPictureAttendsToItsOtherKeys) {
  const auto insight = ReadInsight(MakeMessage());
  ASSERT_THAT(insight, IsOk());
  const ModuleAttention& attention = insight->attention.at("LANG");
  EXPECT_FALSE(attention.reads_picture());
  EXPECT_EQ(attention.share(), 0);
  EXPECT_EQ(attention.keys, (std::vector<std::string>{"language", "self"}));
  EXPECT_EQ(attention.mean.keys, (std::vector<double>{0.5, 0.5}));
}

TEST(ReadInsight, WhatIsNotSaidIsNotThere) {
  bus::Insight message = MakeMessage();
  message.view.clear();
  message.waypoints.clear();
  message.attention.clear();
  message.attention_json = "{}";
  message.modules_json = "{}";
  const auto insight = ReadInsight(message);
  ASSERT_THAT(insight, IsOk());
  EXPECT_EQ(insight->view, View{});
  EXPECT_TRUE(insight->waypoints.empty());
  EXPECT_TRUE(insight->attention.empty());
  EXPECT_TRUE(insight->modules.empty());
}

TEST(ReadInsight, WordsAndJointsAreWorthWhatIsSaid) {
  bus::Insight message = MakeMessage();
  EXPECT_TRUE(ReadInsight(message)->words.empty()) << "not asked";
  message.worth_json =
      R"({"words": [{"word": "push", "moves": 0.25}, {"word": "it", "moves": 0}], "joints": [0.5, 0]})";
  const auto insight = ReadInsight(message);
  ASSERT_THAT(insight, IsOk());
  ASSERT_EQ(insight->words.size(), 2u);
  EXPECT_EQ(insight->words[0].word, "push");
  EXPECT_EQ(insight->words[0].moves, 0.25);
  EXPECT_EQ(insight->joints, (std::vector<double>{0.5, 0}));
  for (const char* text : {"[]", "{", R"({"words": []})", R"({"words": [{"word": 1, "moves": 1}], "joints": []})",
                           R"({"words": ["push"], "joints": []})", R"({"words": [], "joints": [null]})"}) {
    message.worth_json = text;
    EXPECT_THAT(ReadInsight(message), HasCode(Code::kCorrupt)) << text;
  }
}

TEST(ReadInsight, TheServersErrorIsItsOwn) {
  bus::Insight message;
  message.error = "7 joints: this policy reads 8";
  const auto insight = ReadInsight(message);
  EXPECT_THAT(insight, HasCode(Code::kInvalidArgument));
  EXPECT_EQ(insight.error().message, message.error);
}

TEST(ReadInsight, RefusesAttentionThatItsBytesDoNotHold) {
  for (const char* place :
       {R"({"offset": 3, "heads": 2, "image": [1, 3], "keys": ["language"], "scale": [1.0, 0.51]})",
        R"({"offset": -1, "heads": 2, "image": [1, 3], "keys": [], "scale": [1.0, 0.51]})",
        R"({"offset": 0, "heads": 0, "image": [1, 3], "keys": [], "scale": []})",
        R"({"offset": 0, "heads": 2, "image": [1, 3], "keys": [], "scale": [1.0]})",
        R"({"offset": 0, "heads": 1, "image": [1, 3], "keys": [], "scale": [null]})",
        R"({"offset": 0, "heads": 1, "image": [0, 3], "keys": [], "scale": [1.0]})",
        R"({"offset": 0, "heads": 1, "image": [3], "keys": [], "scale": [1.0]})",
        R"({"offset": 0, "heads": 1, "image": [1.5, 3], "keys": [], "scale": [1.0]})",
        R"({"offset": 0, "heads": 1, "image": [4194304, 4194304], "keys": [], "scale": [1.0]})",
        R"({"offset": 18446744073709551615, "heads": 1, "image": [1, 1], "keys": [], "scale": [1.0]})",
        R"({"offset": 0, "heads": 1, "image": [1, 1], "keys": [7], "scale": [1.0]})",
        R"({"offset": 0, "heads": 1, "keys": [], "scale": [1.0]})", "[]",
        R"({"heads": 1, "image": [1, 1], "keys": [], "scale": [1.0]})"}) {
    bus::Insight message = MakeMessage();
    message.attention_json = std::string(R"({"TAR2D": )") + place + "}";
    const auto insight = ReadInsight(message);
    EXPECT_THAT(insight, HasCode(Code::kCorrupt)) << place;
  }
}

TEST(ReadInsight, RefusesModulesThatShareTheirBytes) {
  bus::Insight message = MakeMessage();
  const std::string place = R"({"offset": 0, "heads": 2, "image": [1, 3], "keys": ["self"], "scale": [1, 1]})";
  message.attention_json = R"({"A": )" + place + "}";
  EXPECT_THAT(ReadInsight(message), IsOk());
  message.attention_json = R"({"A": )" + place + R"(, "B": )" + place + "}";
  EXPECT_THAT(ReadInsight(message), HasCode(Code::kCorrupt));
}

TEST(ReadInsight, RefusesWhatDoesNotFitTogether) {
  bus::Insight modules = MakeMessage();
  modules.modules_json = "[]";
  EXPECT_THAT(ReadInsight(modules), HasCode(Code::kCorrupt));
  bus::Insight layout = MakeMessage();
  layout.attention_json = "{";
  EXPECT_THAT(ReadInsight(layout), HasCode(Code::kCorrupt));
  bus::Insight few = MakeMessage();
  few.waypoints.pop_back();
  EXPECT_THAT(ReadInsight(few), HasCode(Code::kCorrupt));
  bus::Insight nan = MakeMessage();
  nan.waypoints[3] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THAT(ReadInsight(nan), HasCode(Code::kCorrupt));
  bus::Insight otherwise = MakeMessage();
  otherwise.what_if_waypoints = {1, 2, 3};
  EXPECT_THAT(ReadInsight(otherwise), HasCode(Code::kCorrupt));
  bus::Insight view = MakeMessage();
  view.view = {0, 0, 4'000'000'000u, 1};
  EXPECT_THAT(ReadInsight(view), HasCode(Code::kCorrupt));
  view.view = {1, 2};
  EXPECT_THAT(ReadInsight(view), HasCode(Code::kCorrupt));
}

}  // namespace insight_test
}  // namespace etude::policy
