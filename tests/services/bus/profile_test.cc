// SPDX-License-Identifier: Apache-2.0
// Tests what services/bus/profile.h takes for a file, for text and for a list.
#include "services/bus/profile.h"

#include <gtest/gtest.h>
#include <stdlib.h>

#include <filesystem>

#include "services/core/file.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::bus {
namespace profile_test {

class ProfileOfTheEnvironment : public ::testing::Test {
 protected:
  void SetUp() override {
    std::filesystem::create_directory(folder_ / "site,2");
    ASSERT_THAT(WriteFileAtomically(file_, std::string_view("<Domain/>")), IsOk());
  }
  void TearDown() override { ::unsetenv("CYCLONEDDS_URI"); }
  static std::string Of(const std::string& uri) {
    ::setenv("CYCLONEDDS_URI", uri.c_str(), 1);
    return ProfileText("").value_or("none");
  }

  const TemporaryFolder folder_;
  const Path file_ = folder_ / "site,2" / "lan.xml";
};

// --profile read it, and the children of that program, who are told it so, took the name for a list
TEST_F(ProfileOfTheEnvironment, AFileWithACommaInItsNameIsAFile) {
  EXPECT_EQ(ProfileText(file_.string()).value_or("none"), "<Domain/>");
  EXPECT_EQ(Of(file_.string()), "<Domain/>");
  EXPECT_EQ(Of("file://" + file_.string()), "<Domain/>");
}

TEST_F(ProfileOfTheEnvironment, TextAndListsAreHandedOn) {
  EXPECT_EQ(Of(" <Domain/> "), "<Domain/>");
  EXPECT_EQ(Of("a.xml,b.xml"), "a.xml,b.xml");
  EXPECT_NE(Of("").find("MaxAutoParticipantIndex"), std::string::npos) << "the built-in one";
  EXPECT_EQ(Of("missing.xml"), "none");
}

TEST(LeaseSeconds, IsWhatTheProfileSays) {
  EXPECT_EQ(LeaseSeconds("<Domain/>"), 10);
  EXPECT_EQ(LeaseSeconds("<Discovery><LeaseDuration> 20s </LeaseDuration></Discovery>"), 20);
  EXPECT_EQ(LeaseSeconds("<LeaseDuration>1500 ms</LeaseDuration>"), 1.5);
  EXPECT_EQ(LeaseSeconds("<LeaseDuration>soon</LeaseDuration>"), 10);
  EXPECT_EQ(LeaseSeconds("<!-- <LeaseDuration>3s</LeaseDuration> -->"), 10);
}

}  // namespace profile_test
}  // namespace etude::bus
