// SPDX-License-Identifier: Apache-2.0
// Tests trainer/policy/architecture.cc
#include "trainer/policy/architecture.h"

#include <gtest/gtest.h>

#include "tests/trainer/policy/fixtures.h"

namespace etude::policy {
namespace {

TEST(SaidOf, LeavesOutDefaultsAndReadsBack) {
  const auto config = TinyConfig();
  const auto said = SaidOf(config);

  EXPECT_FALSE(said.contains("attention"));
  EXPECT_FALSE(said["modules"][0].contains("query"));
  EXPECT_FALSE(said["image"]["layers"][0].contains("padding"));
  EXPECT_EQ(said["modules"][0]["name"], "LANG");
  const auto again = FromJson<PolicyConfig>(said, "test");
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(ToJson(*again), ToJson(config));
}

// a program with one more key says nothing of it in a policy that leaves it at its default
TEST(ArchitectureHash, IsOfWhatThePolicySays) {
  auto said = SaidOf(TinyConfig());
  const std::string hash = ArchitectureHash(said);
  EXPECT_EQ(ArchitectureHash(TinyConfig()), hash);

  OrderedJson turned = OrderedJson::object();
  for (auto it = said.rbegin(); it != said.rend(); ++it) turned[it.key()] = it.value();
  EXPECT_EQ(ArchitectureHash(turned), hash);

  said["a_new_key"] = "not its default";
  EXPECT_NE(ArchitectureHash(said), hash);
}

}  // namespace
}  // namespace etude::policy
