// SPDX-License-Identifier: Apache-2.0
// Tests services/spec/predicate_spec.cc
#include "services/spec/predicate_spec.h"

#include <gmock/gmock.h>

#include <cmath>
#include <numbers>
#include <tuple>

#include "services/core/rng.h"
#include "tests/support/matchers.h"

namespace etude {
namespace predicate_spec_test {

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

TEST(PredicateValue, EveryUnitIsItsFactorInSi) {
  constexpr double degree = std::numbers::pi / 180;
  for (const auto& [text, number, unit] :
       std::initializer_list<std::tuple<const char*, double, const char*>>{{"2 m", 2, "m"},
                                                                           {"3 cm", 0.03, "m"},
                                                                           {"3cm", 0.03, "m"},
                                                                           {"-4.5 mm", -0.0045, "m"},
                                                                           {"+1e2 mm", 0.1, "m"},
                                                                           {".5 rad", 0.5, "rad"},
                                                                           {"180 deg", 180 * degree, "rad"},
                                                                           {"-90 deg", -90 * degree, "rad"},
                                                                           {"0.2 m/s", 0.2, "m/s"},
                                                                           {"7 cm/s", 0.07, "m/s"},
                                                                           {"1.5 s", 1.5, "s"},
                                                                           {"250 ms", 0.25, "s"},
                                                                           {"8", 8, ""},
                                                                           {"-8.5", -8.5, ""}}) {
    const auto value = ParsePredicateValue(text, "by");
    ASSERT_THAT(value, IsOk()) << text;
    EXPECT_NEAR(value->number, number, 1e-12) << text;
    EXPECT_EQ(value->unit, unit) << text;
    EXPECT_FALSE(value->is_word()) << text;
  }
}

TEST(PredicateValue, IsAWordWhenItDoesNotBeginWithANumber) {
  for (const std::string& word :
       {std::string("target"), std::string("+y"), std::string("-x"), std::string("on_top"), std::string(64, 'a')})
    EXPECT_EQ(ParsePredicateValue(word, "of")->word, word);
  for (const std::string& text :
       {std::string(), std::string("Target"), std::string("a b"), std::string("a/b"), std::string(65, 'a'),
        std::string("3 km"), std::string("3 cm cm"), std::string("3 CM"), std::string("3. 4"), std::string("1e999 m"),
        std::string(70, '1')})
    EXPECT_THAT(ParsePredicateValue(text, "risen.of"), HasCode(Code::kInvalidArgument)) << text;
  for (const OrderedJson& json : {OrderedJson(true), OrderedJson(), OrderedJson::array(), OrderedJson(INFINITY)})
    EXPECT_THAT(ParsePredicateValue(json, "risen.of"), MessageHas("risen.of: ")) << json.dump();
}

PredicateSpec RandomPredicate(Rng& rng, int depth) {
  const std::vector<std::string> words{"risen", "all", "on_top", "+y", "a-1"}, units{"", "m", "rad", "m/s", "s"};
  PredicateSpec spec{.kind = words[rng.Below(3)]};
  if (depth > 1 && rng.Bernoulli(0.5)) {
    for (auto n = 1 + rng.Below(3); n > 0; --n) spec.children.push_back(RandomPredicate(rng, depth - 1));
    return spec;
  }
  for (auto n = rng.Below(4); n > 0; --n) {
    PredicateValue value{.word = rng.Bernoulli(0.4) ? words[rng.Below(words.size())] : ""};
    if (!value.is_word()) value = {.number = std::ldexp(rng.Normal(), 10), .unit = units[rng.Below(units.size())]};
    spec.parameters["p" + std::to_string(n)] = value;
  }
  return spec;
}

TEST(PredicateSpec, AnyTreeIsWrittenAsYamlAndReadBackTheSame) {
  Rng rng(11);
  for (int round = 0; round < 500; ++round) {
    const PredicateSpec spec = RandomPredicate(rng, 4);
    const auto yaml = ParseYaml(ToYaml(OrderedJson{{"success", ToJson(spec)}}), "success.yaml");
    ASSERT_THAT(yaml, IsOk());
    const auto again = PredicateFromJson((*yaml)["success"], "success");
    ASSERT_THAT(again, IsOk()) << ToJson(spec).dump();
    ASSERT_EQ(*again, spec) << ToJson(spec).dump();
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

}  // namespace predicate_spec_test
}  // namespace etude
