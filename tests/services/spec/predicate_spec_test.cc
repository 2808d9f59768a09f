// SPDX-License-Identifier: Apache-2.0
// Tests services/spec/predicate_spec.cc
#include "services/spec/predicate_spec.h"

#include <gmock/gmock.h>

#include <numbers>

namespace etude {
namespace {

Result<PredicateSpec> FromYaml(const std::string& text) {
  const auto json = ParseYaml(text, "test");
  EXPECT_TRUE(json.has_value()) << text;
  return PredicateFromJson(*json, "success");
}

TEST(PredicateSpec, ReadsATreeWithQuantitiesInSi) {
  const auto spec = FromYaml(R"(
all:
  - risen: {by: 3 cm}
  - grasped
  - then:
      - turned: {by: 90 deg, about: x}
      - at_rest: {slower_than: 3 cm/s}
)");
  ASSERT_TRUE(spec.has_value()) << spec.error().message;
  EXPECT_EQ(spec->kind, "all");
  ASSERT_EQ(spec->children.size(), 3u);
  EXPECT_NEAR(spec->children[0].parameters.at("by").number, 0.03, 1e-12);
  EXPECT_EQ(spec->children[0].parameters.at("by").unit, "m");
  EXPECT_EQ(spec->children[1].kind, "grasped");
  const PredicateSpec& turned = spec->children[2].children[0];
  EXPECT_NEAR(turned.parameters.at("by").number, std::numbers::pi / 2, 1e-12);
  EXPECT_EQ(turned.parameters.at("about").word, "x");
  EXPECT_EQ(spec->children[2].children[1].parameters.at("slower_than").unit, "m/s");
}

TEST(PredicateSpec, IsWrittenAndReadBackTheSame) {
  for (const char* text : {"grasped", "{risen: {by: 3 cm, of: target}}", "{moved: {by: 0.03, along: +y}}",
                           "{any: [{all: [lying, released]}, {then: [{risen: {by: 10 cm}}, lying]}]}"}) {
    const auto spec = FromYaml(text);
    ASSERT_TRUE(spec.has_value()) << spec.error().message;
    const auto again = PredicateFromJson(ToJson(*spec), "again");
    ASSERT_TRUE(again.has_value()) << again.error().message;
    EXPECT_EQ(*spec, *again) << ToJson(*spec).dump();
  }
}

TEST(PredicateSpec, RefusesWhatHasNoFormAndSaysWhere) {
  for (const auto& [text, says] : std::initializer_list<std::pair<const char*, const char*>>{
           {"3", "success: a predicate is"},
           {"{risen: {}, grasped: {}}", "success: a predicate is"},
           {"{all: [risen, 5]}", "success.all[1]"},
           {"{risen: 5}", "success.risen"},
           {"{risen: {by: 3 furlong}}", "success.risen.by: '3 furlong' has no known unit"},
           {"{risen: {by: 1e999 m}}", "not finite"},
           {"{risen: {by: [1]}}", "success.risen.by"},
           {"{'../x': {}}", "plain word"},
           {"{risen: {object: 'a b'}}", "plain word"}}) {
    const auto spec = FromYaml(text);
    ASSERT_FALSE(spec.has_value()) << text;
    EXPECT_THAT(spec.error().message, testing::HasSubstr(says)) << text;
  }
}

TEST(PredicateSpec, IsBoundedInDepthAndNumber) {
  OrderedJson deep = "lying";
  for (int i = 0; i < kPredicateDepth; ++i) deep = OrderedJson{{"all", OrderedJson::array({deep})}};
  EXPECT_FALSE(PredicateFromJson(deep, "deep").has_value());
  EXPECT_TRUE(PredicateFromJson(deep["all"][0], "less deep").has_value());
  OrderedJson many = OrderedJson::array();
  for (int i = 0; i < kPredicateNodes; ++i) many.push_back("lying");
  EXPECT_FALSE(PredicateFromJson({{"all", many}}, "many").has_value());
}

}  // namespace
}  // namespace etude
