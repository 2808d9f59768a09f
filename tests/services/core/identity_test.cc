// SPDX-License-Identifier: Apache-2.0
// Tests services/core/identity.cc
#include "services/core/identity.h"

#include <gtest/gtest.h>

#include <set>

#include "tests/support/temporary_folder.h"

namespace etude {
namespace identity_test {

class IdentityTest : public testing::Test {
 protected:
  TemporaryFolder temporary_;
  Path folder_ = temporary_.path();
};

TEST_F(IdentityTest, IsMintedOnceWithItsFolder) {
  EXPECT_EQ(ReadIdentity(folder_ / "new").error().code, Code::kNotFound);
  const auto minted = OpenIdentity(folder_ / "new");
  ASSERT_TRUE(minted) << minted.error().message;
  EXPECT_TRUE(IsId(minted->id)) << minted->id;
  EXPECT_GT(minted->since, 1'600'000'000u);
  EXPECT_EQ(OpenIdentity(folder_ / "new")->id, minted->id);
  EXPECT_EQ(OpenIdentity(folder_ / "new", Claim::kAdopt)->id, minted->id);
  EXPECT_EQ(ReadIdentity(folder_ / "new")->id, minted->id);
  EXPECT_EQ(ReadIdentity(folder_ / "new")->since, minted->since);
}

TEST_F(IdentityTest, ACopyGetsItsOwnWhenToldSo) {
  const auto original = OpenIdentity(folder_ / "a");
  std::filesystem::copy(folder_ / "a", folder_ / "b");
  EXPECT_EQ(OpenIdentity(folder_ / "b")->id, original->id);
  const auto renewed = OpenIdentity(folder_ / "b", Claim::kNewId);
  ASSERT_TRUE(renewed);
  EXPECT_NE(renewed->id, original->id);
  EXPECT_EQ(ReadIdentity(folder_ / "b")->id, renewed->id);
  EXPECT_EQ(ReadIdentity(folder_ / "a")->id, original->id);
}

TEST_F(IdentityTest, AFileThatIsNotUnderstoodIsNotReplacedSilently) {
  for (const char* text : {"", "[]", "{}", "{\"id\": 3}", "{\"id\": \"../../x\"}", "{\"id\": \"ABCDEF0123456789\"}"}) {
    ASSERT_TRUE(WriteFileAtomically(folder_ / "identity.json", std::string_view(text)));
    const auto opened = OpenIdentity(folder_);
    ASSERT_FALSE(opened) << text;
    EXPECT_EQ(opened.error().code, Code::kCorrupt);
  }
  EXPECT_TRUE(OpenIdentity(folder_, Claim::kNewId));
}

TEST(Identity, IdsAreRandom) {
  std::set<std::string> ids;
  for (int i = 0; i < 1000; ++i) ids.insert(NewId());
  EXPECT_EQ(ids.size(), 1000u);
}

TEST(Selector, IsANameOrANameAtAnId) {
  EXPECT_EQ(ParseSelector("demo", "--run")->name, "demo");
  EXPECT_EQ(ParseSelector("demo", "--run")->id, "");
  EXPECT_EQ(ParseSelector("demo@3f2a", "--run")->id, "3f2a");
  EXPECT_EQ(ParseSelector("demo@3f2a", "--run")->text(), "demo@3f2a");
  for (const char* text :
       {"", "@", "demo@", "@3f", "Demo", "demo@3F", "demo@xyz", "demo@3f@2a", "demo@01234567890123456", "../demo"}) {
    const auto parsed = ParseSelector(text, "--run");
    ASSERT_FALSE(parsed) << text;
    EXPECT_EQ(parsed.error().code, Code::kInvalidArgument);
    EXPECT_NE(parsed.error().message.find("--run"), std::string::npos);
  }
}

}  // namespace identity_test
}  // namespace etude
