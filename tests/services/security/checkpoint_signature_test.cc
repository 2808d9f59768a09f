// SPDX-License-Identifier: Apache-2.0
#include "services/security/checkpoint_signature.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "services/core/hash.h"
#include "tests/support/temporary_folder.h"

namespace etude::security {
namespace checkpoint_signature_test {

using ::testing::HasSubstr;

class CheckpointSignatureTest : public ::testing::Test {
 protected:
  void SetUp() override { ASSERT_TRUE(MakeSigningKey(key_)); }

  Published Version(std::uint64_t version, const std::string& bytes = "weights") const {
    return {"0123456789abcdef", "latest", version, Sha256Hex(bytes)};
  }
  std::string Sign(const Published& published) const {
    return CheckpointSigner::Open(key_).value().Sign(published, R"({"step":100})").value();
  }
  CheckpointVerifier Verifier() const {
    return CheckpointVerifier::Open(key_.string() + ".pub", folder_.path() / "floor.json").value();
  }

  TemporaryFolder folder_;
  Path key_ = folder_.path() / "signing.key";
};

TEST_F(CheckpointSignatureTest, TakesWhatWasSignedAndKeepsTheRest) {
  const std::string metadata = Sign(Version(1));
  EXPECT_THAT(metadata, HasSubstr(R"("step":100)"));
  auto verifier = Verifier();
  EXPECT_TRUE(verifier.Check(Version(1), metadata));
  EXPECT_TRUE(verifier.Check(Version(1), metadata)) << "the same one again, after a restart";
}

TEST_F(CheckpointSignatureTest, RefusesTheUnsignedAndTheTampered) {
  auto verifier = Verifier();
  const auto unsigned_one = verifier.Check(Version(1), R"({"step":100})");
  ASSERT_FALSE(unsigned_one);
  EXPECT_THAT(unsigned_one.error().message, HasSubstr("not signed"));
  const std::string metadata = Sign(Version(1));
  EXPECT_FALSE(verifier.Check(Version(1, "other weights"), metadata)) << "altered, and hashed again";
  EXPECT_FALSE(verifier.Check(Version(2), metadata)) << "an old one as a new version";
  Published other_run = Version(1);
  other_run.owner = "fedcba9876543210";
  EXPECT_FALSE(verifier.Check(other_run, metadata));
  Published best = Version(1);
  best.channel = "best";
  EXPECT_FALSE(verifier.Check(best, metadata));
  EXPECT_FALSE(verifier.Check(Version(1), "no json"));
  EXPECT_FALSE(verifier.Check(Version(1), R"({"signature":"00"})"));
  const auto huge = verifier.Check(Version(1), "[" + std::string(2 << 20, '[') + "]");
  ASSERT_FALSE(huge);
  EXPECT_THAT(huge.error().message, HasSubstr("no checkpoint's")) << "not parsed before it is known whose it is";
}

TEST_F(CheckpointSignatureTest, RefusesOtherKeys) {
  const Path other = folder_.path() / "other.key";
  ASSERT_TRUE(MakeSigningKey(other));
  const auto metadata = CheckpointSigner::Open(other).value().Sign(Version(1), "{}");
  EXPECT_FALSE(Verifier().Check(Version(1), metadata.value()));
}

TEST_F(CheckpointSignatureTest, RefusesRollingBackOverRestarts) {
  EXPECT_TRUE(Verifier().Check(Version(5), Sign(Version(5))));
  auto restarted = Verifier();
  const auto older = restarted.Check(Version(4), Sign(Version(4)));
  ASSERT_FALSE(older);
  EXPECT_THAT(older.error().message, HasSubstr("not newer than 5"));
  EXPECT_THAT(older.error().message, HasSubstr("floor.json")) << "says where it is kept";
  EXPECT_FALSE(restarted.Check(Version(5, "another of that version"), Sign(Version(5, "another of that version"))));
  EXPECT_TRUE(restarted.Check(Version(6), Sign(Version(6))));
}

TEST_F(CheckpointSignatureTest, TwoThatShareAFloorKeepEachOthersEntries) {
  auto first = Verifier(), second = Verifier();
  Published other_run = Version(7);
  other_run.owner = "fedcba9876543210";
  ASSERT_TRUE(first.Check(Version(5), Sign(Version(5))));
  ASSERT_TRUE(second.Check(other_run, Sign(other_run)));
  EXPECT_FALSE(second.Check(Version(4), Sign(Version(4)))) << "the other one took a newer one";
  EXPECT_FALSE(Verifier().Check(Version(4), Sign(Version(4)))) << "after a restart";
  other_run.version = 6;
  EXPECT_FALSE(first.Check(other_run, Sign(other_run)));
}

TEST_F(CheckpointSignatureTest, AFloorThatCannotBeReadIsNoneThatIsMissing) {
  auto verifier = Verifier();
  const Path floor = folder_.path() / "floor.json";
  const std::string key = "0123456789abcdef/latest";
  for (const std::string& text :
       {std::string("no json"), std::string("[]"), "{\"" + key + "\": 5}", "{\"" + key + "\": {\"version\": \"5\"}}",
        "{\"" + key + "\": {\"version\": -1, \"sha256\": \"\"}}"}) {
    ASSERT_TRUE(WriteFileAtomically(floor, std::string_view(text)));
    const auto checked = verifier.Check(Version(1), Sign(Version(1)));
    ASSERT_FALSE(checked) << text;
    EXPECT_EQ(checked.error().code, Code::kUnavailable) << text;
    EXPECT_FALSE(CheckpointVerifier::Open(key_.string() + ".pub", floor)) << text;
  }
  std::filesystem::remove(floor);
  ASSERT_TRUE(MakeFolders(floor));
  EXPECT_FALSE(verifier.Check(Version(1), Sign(Version(1)))) << "a folder in its place";
}

// before, it began, and refused every checkpoint
TEST_F(CheckpointSignatureTest, AFloorThatCannotBeWrittenIsRefusedAtTheStart) {
  const auto opened = CheckpointVerifier::Open(key_.string() + ".pub", "/proc/nowhere/floor.json");
  ASSERT_FALSE(opened);
  EXPECT_THAT(opened.error().message, HasSubstr("/proc/nowhere"));
}

TEST_F(CheckpointSignatureTest, RefusesKeysThatOthersCanReadOrOverwrite) {
  std::filesystem::remove(key_.string() + ".pub");
  const auto again = MakeSigningKey(key_);
  ASSERT_FALSE(again) << "it would be lost";
  EXPECT_EQ(again.error().code, Code::kUnavailable);
  std::filesystem::permissions(key_, std::filesystem::perms::others_read, std::filesystem::perm_options::add);
  const auto signer = CheckpointSigner::Open(key_);
  ASSERT_FALSE(signer);
  EXPECT_THAT(signer.error().message, HasSubstr("chmod 600"));
}

}  // namespace checkpoint_signature_test
}  // namespace etude::security
