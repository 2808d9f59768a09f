// SPDX-License-Identifier: Apache-2.0
// Tests trainer/policy/architecture.cc
#include "trainer/policy/architecture.h"

#include <gtest/gtest.h>

#include "tests/trainer/policy/fixtures.h"

namespace etude::policy {
namespace architecture_test {

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

// weights fit what the folder holds, wherever it lies and whatever the other encoder's sizes are
TEST(ArchitectureHash, IsOfTheContentOfClipsFolderAndNotOfItsPlace) {
  PolicyConfig here = TinyConfig();
  here.language.encoder = "clip:/here";
  here.language.sha256 = std::string(64, 'a');
  PolicyConfig there = here;
  there.language.encoder = "clip:/far/away";
  there.language.hidden = 17;
  EXPECT_EQ(ArchitectureHash(here), ArchitectureHash(there));
  EXPECT_NE(ArchitectureHash(here), ArchitectureHash(TinyConfig()));
  there.language.sha256[0] = 'b';
  EXPECT_NE(ArchitectureHash(here), ArchitectureHash(there));

  EXPECT_EQ(LanguageThatWeightsFit(ToJson(here.language)),
            OrderedJson({{"encoder", "clip"}, {"sha256", std::string(64, 'a')}}));
  // of the default encoder sizes are what weights fit
  EXPECT_EQ(LanguageThatWeightsFit(ToJson(LanguageConfig{})), ToJson(LanguageConfig{}));
  EXPECT_EQ(LanguageThatWeightsFit("odd"), OrderedJson("odd"));
}

}  // namespace architecture_test
}  // namespace etude::policy
