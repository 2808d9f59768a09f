// SPDX-License-Identifier: Apache-2.0
// Tests services/campaign/fingerprint.cc
#include "services/campaign/fingerprint.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "services/campaign/history.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::campaign {
namespace fingerprint_test {

using ::testing::Optional;
using ::testing::StartsWith;

const Fingerprint kFirst{{"content", "6"}, {"gl", "llvmpipe"}, {"picture", "aa"}, {"physics", "bb"}, {"libm", "cc"}};

Fingerprint With(const std::string& name, const std::string& value) {
  Fingerprint other = kFirst;
  for (auto& line : other)
    if (line.first == name) line.second = value;
  return other;
}

TEST(Fingerprint, SurvivesItsTextAndHasAShortHash) {
  const auto again = ParseFingerprint(FingerprintText(kFirst));
  ASSERT_THAT(again, IsOk());
  EXPECT_EQ(*again, kFirst);
  EXPECT_EQ(ShortHash(kFirst).size(), 12u);
  EXPECT_NE(ShortHash(kFirst), ShortHash(With("libm", "cd")));
}

TEST(Fingerprint, OfAStrangerIsBounded) {
  for (const std::string& text :
       {std::string("[]"), std::string("{\"a\": 1}"), std::string("{"), "{\"a\": \"" + std::string(5000, 'x') + "\"}"})
    EXPECT_THAT(ParseFingerprint(text), HasCode(Code::kCorrupt)) << text.substr(0, 20);
  Fingerprint many;
  for (int k = 0; k < 33; ++k) many.emplace_back(std::to_string(k), "");
  EXPECT_THAT(ParseFingerprint(FingerprintText(many)), HasCode(Code::kCorrupt));
}

TEST(FirstDifference, NamesTheLineThatTheCampaignAsksFor) {
  EXPECT_EQ(FirstDifference(kFirst, kFirst, "bytes"), std::nullopt);
  EXPECT_THAT(FirstDifference(kFirst, With("libm", "cd"), "bytes"), Optional(std::string("libm: here cc, there cd")));
  EXPECT_THAT(FirstDifference(kFirst, With("libm", "cd"), "physics"), Optional(StartsWith("libm")));
  EXPECT_THAT(FirstDifference(kFirst, With("picture", "ab"), "bytes"), Optional(StartsWith("picture")));
  EXPECT_EQ(FirstDifference(kFirst, With("picture", "ab"), "physics"), std::nullopt);
  EXPECT_EQ(FirstDifference(kFirst, With("physics", "ab"), "none"), std::nullopt);
}

TEST(FirstDifference, SeesLinesThatOnlyOneHas) {
  Fingerprint longer = kFirst;
  longer.emplace_back("device", "2");
  EXPECT_THAT(FirstDifference(kFirst, longer, "bytes"), Optional(std::string("device: here not said, there 2")));
  EXPECT_THAT(FirstDifference(longer, kFirst, "bytes"), Optional(std::string("device: here 2, there not said")));
}

TEST(FirstDifference, OfDeflatedStreamsIsOneOfBytes) {
  const auto with = [](const char* value) {
    Fingerprint said = kFirst;
    said.emplace_back("deflated", value);
    return said;
  };
  EXPECT_THAT(FirstDifference(with("1"), with("2"), "bytes"), Optional(std::string("deflated: here 1, there 2")));
  EXPECT_EQ(FirstDifference(with("1"), with("2"), "physics"), std::nullopt);
  EXPECT_EQ(FirstDifference(kFirst, with("1"), "bytes"), std::nullopt) << "a campaign of an older program goes on";
  EXPECT_EQ(FirstDifference(with("1"), kFirst, "bytes"), std::nullopt);
}

TEST(KnownFingerprint, StaysOverStarts) {
  TemporaryFolder folder;
  EXPECT_FALSE(KnownFingerprint(folder.path()));
  ASSERT_THAT(RememberEpoch(folder.path(), 1), IsOk());
  ASSERT_THAT(RememberFingerprint(folder.path(), kFirst), IsOk());
  ASSERT_THAT(RememberFiles(folder.path(), "abc"), IsOk());
  ASSERT_THAT(RememberEpoch(folder.path(), 2), IsOk());
  EXPECT_EQ(KnownFingerprint(folder.path()), kFirst);
  EXPECT_EQ(KnownFiles(folder.path()), "abc");
}

TEST(KnownFingerprint, OfTheLargestSizeIsReadAgain) {
  TemporaryFolder folder;
  Fingerprint largest;
  for (int k = 0; k < 32; ++k) largest.emplace_back(std::string(4000, 'a') + std::to_string(k), std::string(4096, 'b'));
  ASSERT_THAT(RememberEpoch(folder.path(), 1), IsOk());
  ASSERT_THAT(RememberFingerprint(folder.path(), largest), IsOk());
  EXPECT_EQ(LastEpoch(folder.path()).value_or(0), 1u) << "a worker cannot lock the folder";
  EXPECT_EQ(KnownFingerprint(folder.path()), largest);
}

}  // namespace fingerprint_test
}  // namespace etude::campaign
