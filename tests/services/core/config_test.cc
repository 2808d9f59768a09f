// SPDX-License-Identifier: Apache-2.0
// Tests services/core/config.cc
#include "services/core/config.h"

#include <gmock/gmock.h>

#include "services/core/rng.h"

namespace etude {
namespace {

using ::testing::HasSubstr;

struct Inner {
  int width = 224;
  double fovy = 60;
  template <class V>
  void Visit(V& v) {
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
  template <class V>
  void Visit(V& v) {
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

TEST(NearestMatch, FindsOnlyWhatIsNear) {
  EXPECT_EQ(NearestMatch("pik", {"push", "pick"}), "pick");
  EXPECT_EQ(NearestMatch("zzzzzz", {"push", "pick"}), "");
}

}  // namespace
}  // namespace etude
