// SPDX-License-Identifier: Apache-2.0
// Tests trainer/policy/compose.cc
#include "trainer/policy/compose.h"

#include <gtest/gtest.h>

namespace etude::policy {
namespace compose_test {

OrderedJson Yaml(const char* text) { return ParseYaml(text, "test").value(); }

TEST(Compose, AddsModulesAndWhatAnExistingOneReads) {
  const auto base = Yaml(R"(
name: base
width: 64
modules:
  - {name: A, level: 1, reads: [image]}
  - {name: B, level: 2, reads: [A], attend: [A], decoder: {quantity: position, hidden: [8], inputs: [register]}}
)");
  const auto more = Yaml(R"(
name: base/more
modules:
  - {name: C, level: 1, reads: [image]}
  - {name: B, reads: [C, A], attend: [C], decoder: {inputs: ["register:C"]}}
)");
  const auto wanted = Yaml(R"(
name: base/more
width: 64
modules:
  - {name: A, level: 1, reads: [image]}
  - {name: B, level: 2, reads: [A, C], attend: [A, C],
     decoder: {quantity: position, hidden: [8], inputs: [register, "register:C"]}}
  - {name: C, level: 1, reads: [image]}
)");
  EXPECT_EQ(Compose(base, more), wanted) << Compose(base, more).dump();
}

// a checkpoint's graph says nothing of what is the default: before, an addition took its place
TEST(Compose, AddsToWhatIsLeftUnsaid) {
  const auto base = Yaml("{modules: [{name: A, level: 1, decoder: {quantity: position}}, {name: B, level: 1}]}");
  const auto more = Yaml(R"(
modules:
  - {name: A, reads: [B], decoder: {inputs: ["register:B"]}}
  - {name: B, decoder: {quantity: position, inputs: ["register:A"]}}
)");
  const auto result = Compose(base, more);
  EXPECT_EQ(result["modules"][0]["reads"], Yaml("[all, B]"));
  EXPECT_EQ(result["modules"][0]["decoder"]["inputs"], Yaml("[register, 'register:B']"));
  EXPECT_EQ(result["modules"][1]["decoder"]["inputs"], Yaml("['register:A']")) << "a decoder of the addition's own";
}

TEST(Compose, ReplacesWhatIsNoListOfInputs) {
  const auto base = Yaml("{width: 64, joint_hidden: [8, 8], image: {position: fourier, crop: [1, 2, 3, 4]}}");
  const auto result = Compose(base, Yaml("{joint_hidden: [16], image: {crop: []}}"));
  EXPECT_EQ(result, Yaml("{width: 64, joint_hidden: [16], image: {position: fourier, crop: []}}"));
}

// What is added once is there once: a file may say again what the one below it says.
TEST(Compose, SaidAgainChangesNothing) {
  const auto base = Yaml("{width: 8, modules: [{name: A, reads: [image], decoder: {inputs: [register]}}]}");
  const auto more = Yaml("{heads: 2, modules: [{name: A, reads: [language]}, {name: B, reads: [A]}]}");
  const auto once = Compose(base, more);
  EXPECT_EQ(Compose(once, more), once);
  EXPECT_EQ(Compose(base, OrderedJson::object()), base);
  EXPECT_EQ(Compose(OrderedJson::object(), base), base);
  EXPECT_EQ(Compose(once, base), once) << "nothing is taken away";
}

TEST(Compose, LeavesNonsenseToTheChecks) {
  EXPECT_EQ(Compose(Yaml("{modules: 3}"), Yaml("{modules: [{name: A}]}")), Yaml("{modules: [{name: A}]}"));
  EXPECT_EQ(Compose(Yaml("{modules: [3, {name: A}]}"), Yaml("{modules: [4]}")), Yaml("{modules: [3, {name: A}, 4]}"));
}

// A trained module that reads all would read what is added, and be another one.
TEST(KeepReads, WritesOutAllOfModulesThatTheAdditionDoesNotName) {
  const auto before = Yaml(R"(
modules:
  - {name: A, level: 1}
  - {name: B, level: 2, reads: [all]}
  - {name: C, level: 2, reads: [image, A]}
  - {name: D, level: 3, attend: [B]}
)");
  auto graph = Compose(before, Yaml("{modules: [{name: N, level: 1}, {name: D, attend: [N]}]}"));
  KeepReads(before, graph);
  const auto wanted = Yaml(R"(
modules:
  - {name: A, level: 1, reads: [image, language, joints]}
  - {name: B, level: 2, reads: [image, language, joints, A]}
  - {name: C, level: 2, reads: [image, A]}
  - {name: D, level: 3, attend: [B, N]}
  - {name: N, level: 1}
)");
  EXPECT_EQ(graph, wanted) << graph.dump();
}

TEST(KeepReads, LeavesNonsenseToTheChecks) {
  for (const char* text : {"{}", "{modules: 3}", "{modules: [{name: A, levle: 2}]}"}) {
    OrderedJson graph = Yaml(text);
    KeepReads(Yaml(text), graph);
    EXPECT_EQ(graph, Yaml(text));
  }
  OrderedJson nothing;
  KeepReads(OrderedJson(), nothing);
  EXPECT_TRUE(nothing.is_null());
}

}  // namespace compose_test
}  // namespace etude::policy
