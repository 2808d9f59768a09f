// SPDX-License-Identifier: Apache-2.0
// Tests services/core/config.cc
#include "services/core/config.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "services/core/rng.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude {
namespace config_test {

using ::testing::HasSubstr;

struct Inner {
  int width = 224;
  double fovy = 60;
  void Visit(auto& v) {
    v("width", width);
    v("fovy", fovy);
  }
};

struct Outer {
  std::string name = "demo";
  bool shadows = false;
  std::uint32_t count = 3;
  std::vector<std::string> tasks{"pick"};
  std::map<std::string, double> weights;
  Inner camera;
  std::vector<Inner> more;
  void Visit(auto& v) {
    v("name", name);
    v("shadows", shadows);
    v("count", count);
    v("tasks", tasks);
    v("weights", weights);
    v("camera", camera);
    v("more", more);
  }
};

Result<Outer> Parse(const std::string& yaml) {
  ETUDE_ASSIGN_OR_RETURN(const auto json, ParseYaml(yaml, "test.yaml"));
  return FromJson<Outer>(json, "test.yaml");
}

TEST(Config, ReadsEveryType) {
  const auto config = Parse(
      "name: lab\nshadows: true\ncount: 7\ntasks: [pick, push]\nweights: {a: 1, b: 0.5}\n"
      "camera:\n  width: 84\nmore:\n  - width: 1\n  - fovy: 2\n");
  ASSERT_TRUE(config.has_value()) << config.error().message;
  EXPECT_EQ(config->name, "lab");
  EXPECT_TRUE(config->shadows);
  EXPECT_EQ(config->count, 7u);
  EXPECT_EQ(config->tasks.size(), 2u);
  EXPECT_EQ(config->weights.at("b"), 0.5);
  EXPECT_EQ(config->camera.width, 84);
  EXPECT_EQ(config->camera.fovy, 60);
  EXPECT_EQ(config->more[1].fovy, 2);
}

TEST(Config, RefusesUnknownKeysWithTheNearestMatch) {
  const auto config = Parse("camera: {widht: 84}\ntask: [pick]\n");
  ASSERT_FALSE(config.has_value());
  EXPECT_EQ(config.error().code, Code::kInvalidArgument);
  EXPECT_THAT(config.error().message, HasSubstr("'camera.widht': did you mean 'width'?"));
  EXPECT_THAT(config.error().message, HasSubstr("'task': did you mean 'tasks'?"));
}

TEST(Config, NamesTheWrongType) {
  EXPECT_THAT(Parse("count: -1\n").error().message, HasSubstr("'count': expected an integer >= 0"));
  EXPECT_THAT(Parse("count: 99999999999\n").error().message, HasSubstr("smaller integer"));
  EXPECT_THAT(Parse("shadows: 3\n").error().message, HasSubstr("'shadows'"));
  EXPECT_THAT(Parse("camera: 3\n").error().message, HasSubstr("'camera': expected a map"));
  EXPECT_THAT(Parse("[1]\n").error().message, HasSubstr("the file: expected a map"));
}

TEST(Config, SaysOfEveryWrongTypeWhereItStandsAndWhatWasExpected) {
  for (const auto& [yaml, says] : std::initializer_list<std::pair<const char*, const char*>>{
           {"name: [1]", "'name': expected text, found [1]"},
           {"name: ~", "'name': expected text, found null"},
           {"shadows: 'true'", "'shadows': expected true or false, found \"true\""},
           {"count: 1.5", "'count': expected an integer, found 1.5"},
           {"count: 4294967296", "'count': expected a smaller integer, found 4294967296"},
           {"camera: {width: 2147483648}", "'camera.width': expected a smaller integer"},
           {"camera: {width: -2147483649}", "'camera.width': expected a smaller integer"},
           {"camera: {width: 18446744073709551615}", "'camera.width': expected a smaller integer"},
           {"camera: {fovy: wide}", "'camera.fovy': expected a number, found \"wide\""},
           {"tasks: pick", "'tasks': expected a list, found \"pick\""},
           {"tasks: [a, [b]]", "'tasks[1]': expected text, found [\"b\"]"},
           {"weights: [1]", "'weights': expected a map, found [1]"},
           {"weights: {a: 1, b: x}", "'weights.b': expected a number"},
           {"more: [{}, {width: x}]", "'more[1].width': expected an integer"},
           {"more: [{widht: 1}]", "unknown key 'more[0].widht': did you mean 'width'?"},
           {"zzzzzzzzz: 1", "unknown key 'zzzzzzzzz' (known: name, shadows, count, tasks, weights, camera, more)"}}) {
    EXPECT_THAT(Parse(yaml), HasCode(Code::kInvalidArgument)) << yaml;
    EXPECT_THAT(Parse(yaml), MessageHas(says)) << yaml;
  }
  EXPECT_THAT(Parse("count: x\nshadows: 1\n"), MessageHas("found 1; 'count': expected an integer")) << "all at once";
}

TEST(Config, NumbersAtTheEdgeOfTheirTypeAreTaken) {
  EXPECT_EQ(Parse("count: 4294967295")->count, UINT32_MAX);
  EXPECT_EQ(Parse("camera: {width: -2147483648}")->camera.width, INT32_MIN);
  EXPECT_EQ(Parse("camera: {fovy: 60}")->camera.fovy, 60) << "an integer is a number";
  EXPECT_EQ(Parse("name: 12")->name, "12") << "text may look like a number";
}

// YAML 1.2's core schema, as far as configurations need it.
TEST(Config, ScalarsBecomeWhatTheyLookLike) {
  const std::vector<std::pair<const char*, OrderedJson>> rows{{"true", true},
                                                              {"False", false},
                                                              {"~", nullptr},
                                                              {"null", nullptr},
                                                              {"", nullptr},
                                                              {"0", std::uint64_t{0}},
                                                              {"+7", std::uint64_t{7}},
                                                              {"-7", std::int64_t{-7}},
                                                              {"18446744073709551615", UINT64_MAX},
                                                              {"-9223372036854775808", INT64_MIN},
                                                              {"1e3", 1000.0},
                                                              {"-.5", -0.5},
                                                              {"'1'", "1"},
                                                              {"\"true\"", "true"},
                                                              {"''", ""},
                                                              {"1e999", "1e999"},
                                                              {"nan", "nan"},
                                                              {"inf", "inf"},
                                                              {"0x10", "0x10"},
                                                              {"1_000", "1_000"},
                                                              {"yes", "yes"},
                                                              {"3 cm", "3 cm"}};
  for (const auto& [yaml, expected] : rows) {
    const auto json = ParseYaml(yaml, "test.yaml");
    ASSERT_THAT(json, IsOk()) << yaml;
    EXPECT_EQ(*json, expected) << yaml;
    EXPECT_EQ(json->type(), expected.type()) << yaml;
  }
}

// A tree of maps, lists and scalars, also of text that could be taken for something else.
OrderedJson RandomTree(Rng& rng, int depth) {
  static const std::vector<std::string> texts{
      "",     " ",  "~",    "null", "true", "1",   "-2.5", "1e3",  "- a", "a: b", "# c", "'",   "\"",  "\\",
      "a\nb", "\t", "\r",   "é",    "[",    "{}",  "&x",   "*x",   "!t",  "%",    "@",   "|",   ">",   "---",
      "?",    "<<", "\x01", "\x7f", "x ",   ".5x", "no",   "0x1F", "=",   ",",    "😀",   "nan", "a  b"};
  const auto text = [&] { return texts[rng.Below(texts.size())]; };
  switch (rng.Below(depth > 0 ? 7 : 5)) {
    case 0:
      return OrderedJson(text());
    case 1:
      return OrderedJson(rng.Next());
    case 2:
      return OrderedJson(-static_cast<std::int64_t>(rng.Below(1u << 30)) - 1);
    case 3:
      return OrderedJson(rng.Normal() * std::pow(10, rng.Uniform(-300, 300)));
    case 4:
      return rng.Bernoulli(0.3) ? OrderedJson(nullptr) : OrderedJson(rng.Bernoulli(0.5));
    case 5: {
      auto list = OrderedJson::array();
      for (auto n = rng.Below(4); n > 0; --n) list.push_back(RandomTree(rng, depth - 1));
      return list;
    }
    default: {
      auto map = OrderedJson::object();
      for (auto n = rng.Below(4); n > 0; --n) map[text() + std::to_string(n)] = RandomTree(rng, depth - 1);
      return map;
    }
  }
}

TEST(Config, WhateverIsWrittenIsReadBackTheSame) {
  Rng rng(23);
  for (int round = 0; round < 2000; ++round) {
    const OrderedJson tree{{"tree", RandomTree(rng, 4)}};
    const auto again = ParseYaml(ToYaml(tree), "again.yaml");
    ASSERT_THAT(again, IsOk()) << tree.dump() << "\n" << ToYaml(tree);
    ASSERT_EQ(*again, tree) << ToYaml(tree);
  }
}

TEST(Config, NestingIsBounded) {
  const auto nested = [](int depth) { return std::string(depth, '[') + std::string(depth, ']'); };
  EXPECT_THAT(ParseYaml(nested(64), "deep.yaml"), IsOk());
  EXPECT_THAT(ParseYaml(nested(66), "deep.yaml"), MessageHas("deep.yaml:1:66: nested too deeply"));
}

// Ten lists, each of ten aliases of the one before: 10^10 values out of 400 bytes.
TEST(Config, AliasesAreCopiesWithinBounds) {
  EXPECT_EQ(ParseYaml("a: &a [1, 2]\nb: *a\n", "alias.yaml").value()["b"], OrderedJson::parse("[1, 2]"));
  std::string text = "l0: &l0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n";
  for (int level = 1; level < 10; ++level) {
    text += fmt::format("l{0}: &l{0} [*l{1}", level, level - 1);
    for (int item = 1; item < 10; ++item) text += fmt::format(", *l{}", level - 1);
    text += "]\n";
  }
  EXPECT_THAT(ParseYaml(text, "laughs.yaml"), MessageHas("aliases"));
  EXPECT_THAT(ParseYaml("&a [*a, *a]", "self.yaml"), HasCode(Code::kInvalidArgument));
}

TEST(Config, RefusesWhatIsNoTextOrHasNoTextForAKey) {
  EXPECT_THAT(ParseYaml("name: \xff\xfe", "latin.yaml"), MessageHas("latin.yaml: not UTF-8 text"));
  EXPECT_THAT(ParseYaml("a: 1\n[1, 2]: 3\n", "key.yaml"), MessageHas("a key must be text"));
  EXPECT_THAT(ParseYaml("a: 1\n---\nb: 2\n", "two.yaml"), MessageHas("two.yaml: several YAML documents"));
  for (const char* text : {"---\na: 1\n", "# first\n---\na: 1\n", "a: |\n  ---\n  b\n", "a: '---'\n", "a: 1\n...\n"})
    EXPECT_THAT(ParseYaml(text, "one.yaml"), IsOk()) << text;
  EXPECT_THAT(ParseYaml("a: {b: 1, b: 2}\n", "twice.yaml"), MessageHas("twice.yaml:1:4: key 'b' stands twice"));
}

TEST(LoadConfig, TakesTheFileThenOverridesInTheirOrder) {
  TemporaryFolder folder;
  const Path file = folder / "rig.yaml";
  ASSERT_THAT(WriteFileAtomically(file, std::string_view("name: lab\ncamera: {width: 84}\n")), IsOk());
  const auto config = LoadConfig<Outer>(file, {"camera.fovy=40", "name=first", "name=second", "weights.a=2"});
  ASSERT_THAT(config, IsOk());
  EXPECT_EQ(config->name, "second");
  EXPECT_EQ(config->camera.width, 84);
  EXPECT_EQ(config->camera.fovy, 40);
  EXPECT_EQ(config->weights.at("a"), 2);
  EXPECT_THAT(LoadConfig<Outer>(file, {"camera.widht=1"}), MessageHas("rig.yaml: unknown key 'camera.widht'"));
  EXPECT_THAT(LoadConfig<Outer>(file, {"count"}), MessageHas("--set 'count': expected KEY=VALUE"));
  EXPECT_THAT(LoadConfig<Outer>(file, {"=1"}), MessageHas("expected KEY=VALUE"));
  EXPECT_THAT(LoadConfig<Outer>(file, {"name.first=1"}), MessageHas("'first' lies below a value that is not a map"));
  EXPECT_THAT(LoadConfig<Outer>(file, {"tasks=[a"}), MessageHas("--set tasks=[a:"));
}

TEST(LoadConfig, AnEmptyFileIsAllDefaultsAndALargeOneNoConfig) {
  TemporaryFolder folder;
  ASSERT_THAT(WriteFileAtomically(folder / "empty.yaml", std::string_view("# nothing\n")), IsOk());
  const auto config = LoadConfig<Outer>(folder / "empty.yaml");
  ASSERT_THAT(config, IsOk());
  EXPECT_EQ(ToJson(*config), ToJson(Outer{}));
  ASSERT_THAT(WriteFileAtomically(folder / "large.yaml", std::string((1 << 20) + 1, '#')), IsOk());
  EXPECT_THAT(LoadConfig<Outer>(folder / "large.yaml"), HasCode(Code::kExhausted));
  EXPECT_THAT(LoadConfig<Outer>(folder / "none.yaml"), HasCode(Code::kNotFound));
}

TEST(Config, BadYamlSaysWhere) {
  const auto json = ParseYaml("a: 1\nb: [1, 2\n", "bad.yaml");
  ASSERT_FALSE(json.has_value());
  EXPECT_THAT(json.error().message, HasSubstr("bad.yaml:"));
  EXPECT_THAT(ParseYaml("a: 1\na: 2\n", "twice.yaml").error().message, HasSubstr("stands twice"));
}

TEST(Config, OverridesReplaceAndNest) {
  OrderedJson json = OrderedJson::object();
  ASSERT_TRUE(ApplyOverride(json, "camera.width=84"));
  ASSERT_TRUE(ApplyOverride(json, "tasks=[push, pick]"));
  ASSERT_TRUE(ApplyOverride(json, "name=a=b"));
  const auto config = FromJson<Outer>(json, "x");
  ASSERT_TRUE(config.has_value());
  EXPECT_EQ(config->camera.width, 84);
  EXPECT_EQ(config->tasks[0], "push");
  EXPECT_EQ(config->name, "a=b");
  EXPECT_FALSE(ApplyOverride(json, "name").has_value());
  EXPECT_FALSE(ApplyOverride(json, "name.deeper=1").has_value());
}

TEST(Config, ResolvedConfigReadsBackTheSame) {
  Outer outer;
  outer.name = "123";  // text that looks like a number
  outer.weights = {{"x", 0.1}};
  outer.more = {Inner{1, 2}};
  const auto json = ToJson(outer);
  const auto again = Parse(ToYaml(json));
  ASSERT_TRUE(again.has_value()) << again.error().message << ToYaml(json);
  EXPECT_EQ(ToJson(*again), json);
}

TEST(Config, MutatedYamlNeverCrashes) {
  const std::string seed_text =
      "name: lab\ncamera:\n  width: 84\n  fovy: 1e3\ntasks: [pick, 'push']\nmore: [{width: 1}]\n";
  Rng rng(17);
  for (int round = 0; round < 3000; ++round) {
    std::string text = seed_text;
    for (auto edits = 1 + rng.Below(4); edits > 0; --edits) {
      const auto at = rng.Below(text.size());
      switch (rng.Below(3)) {
        case 0:
          text[at] = static_cast<char>(rng.Below(256));
          break;
        case 1:
          text.erase(at, 1 + rng.Below(4));
          break;
        default:
          text.insert(at, 1, "[]{}:&*!|>-'\"\n "[rng.Below(15)]);
          break;
      }
      if (text.empty()) text = "x";
    }
    const auto config = Parse(text);
    if (!config) {
      EXPECT_FALSE(config.error().message.empty());
    }
  }
}

// nlohmann's own dump throws on these bytes: a file's name, a worker's last words, a label of a stranger
TEST(JsonText, BytesThatAreNotUtf8BecomeTheReplacementCharacter) {
  const std::string replaced = "\xef\xbf\xbd";
  struct Case {
    std::string bytes, text;
  };
  for (const auto& [bytes, text] :
       {Case{"a\xff"
             "b",
             "a" + replaced + "b"},
        Case{"\xc3", replaced}, Case{"\xc3\xa4", "\xc3\xa4"}, Case{"\xed\xa0\x80", replaced}, Case{"", ""}}) {
    const OrderedJson json{{"value", bytes}, {"list", OrderedJson::array({bytes})}};
    const auto back = OrderedJson::parse(JsonText(json), nullptr, false);
    ASSERT_FALSE(back.is_discarded()) << JsonText(json);
    const std::string value = back["value"];
    EXPECT_EQ(value.substr(0, text.size()), text);
    // how many of them a broken sequence becomes is the library's choice; nothing else may come out
    std::string rest = value.substr(text.size());
    while (rest.starts_with(replaced)) rest.erase(0, replaced.size());
    EXPECT_EQ(rest, "");
    EXPECT_EQ(back["list"][0], back["value"]);
  }
  OrderedJson key;
  key["\xff"] = 1;
  EXPECT_EQ(JsonText(key), "{\"" + replaced + "\":1}");
}

TEST(JsonText, IsOneLineInTheOrderOfItsKeysUnlessIndented) {
  const OrderedJson json{{"z", 1}, {"a", {1, 2.5}}, {"line", "two\nlines"}};
  EXPECT_EQ(JsonText(json), R"({"z":1,"a":[1,2.5],"line":"two\nlines"})");
  EXPECT_EQ(JsonText(json, 1), "{\n \"z\": 1,\n \"a\": [\n  1,\n  2.5\n ],\n \"line\": \"two\\nlines\"\n}");
  EXPECT_EQ(JsonText(OrderedJson()), "null");
  EXPECT_EQ(JsonText(std::numeric_limits<double>::quiet_NaN()), "null") << "JSON has no NaN";
}

// such bytes reach a message of ours through a file that is not one of ours
TEST(Config, WhatIsNotUtf8IsNamedWithoutThrowing) {
  OrderedJson json;
  json["count"] = "\xff\xfe";
  EXPECT_THAT(FromJson<Outer>(json, "a file"), MessageHas("'count': expected an integer"));
}

TEST(NearestMatch, FindsOnlyWhatIsNear) {
  EXPECT_EQ(NearestMatch("pik", {"push", "pick"}), "pick");
  EXPECT_EQ(NearestMatch("zzzzzz", {"push", "pick"}), "");
  EXPECT_EQ(NearestMatch("pick", {}), "");
}

// The definition of Levenshtein's distance, letter by letter.
int Distance(const std::string& a, const std::string& b) {
  if (a.empty() || b.empty()) return static_cast<int>(a.size() + b.size());
  const std::string rest_a = a.substr(1), rest_b = b.substr(1);
  if (a[0] == b[0]) return Distance(rest_a, rest_b);
  return 1 + std::min({Distance(rest_a, b), Distance(a, rest_b), Distance(rest_a, rest_b)});
}

TEST(NearestMatch, IsTheFirstOfTheNearestByEditDistance) {
  Rng rng(5);
  const auto word = [&] {
    std::string letters;
    for (auto n = 1 + rng.Below(5); n > 0; --n) letters += static_cast<char>('a' + rng.Below(3));
    return letters;
  };
  for (int round = 0; round < 300; ++round) {
    const std::string wanted = word();
    const std::vector<std::string> known{word(), word(), word()};
    std::string expected;
    int least = std::max(2, static_cast<int>(wanted.size()) / 2);  // what is farther is no guess
    for (auto it = known.rbegin(); it != known.rend(); ++it)
      if (const int distance = Distance(wanted, *it); distance <= least) {
        least = distance;
        expected = *it;
      }
    EXPECT_EQ(NearestMatch(wanted, known), expected) << wanted << " of " << testing::PrintToString(known);
  }
}

TEST(NotKnown, SaysTheNearestAndAll) {
  EXPECT_EQ(NotKnown("pik", {"push", "pick"}), "'pik' is not known, did you mean 'pick'?; known: push, pick");
  EXPECT_EQ(NotKnown("zzzzzzz", {"push", "pick"}), "'zzzzzzz' is not known; known: push, pick");
}

}  // namespace config_test
}  // namespace etude
