// SPDX-License-Identifier: Apache-2.0
#include "services/security/authority.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <memory>
#include <thread>

#include "services/core/clock.h"
#include "services/security/certificate.h"
#include "services/security/identity.h"
#include "tests/support/temporary_folder.h"

namespace etude::security {
namespace authority_test {

using ::testing::HasSubstr;

std::int64_t Now() { return static_cast<std::int64_t>(WallSeconds()); }

class AuthorityTest : public ::testing::Test {
 protected:
  void SetUp() override { ASSERT_TRUE(InitAuthority(folder_.path(), Protection::kEncrypt)); }

  // Valid from `begin` to `end`, seconds from now.
  Result<Path> IssueWorker(const std::string& name, std::int64_t begin = -60, std::int64_t end = 86400) {
    return Issue(folder_.path(), {.name = name,
                                  .roles = {Role::kWorker},
                                  .grants = {{true, "etude/campaign/request", "q/*"}},
                                  .not_before = Now() + begin,
                                  .not_after = Now() + end});
  }
  static std::string Refusal(const Path& identity, const std::vector<Role>& roles = {Role::kWorker}) {
    const auto opened = OpenIdentity(identity, roles);
    return opened ? "" : opened.error().message;
  }

  TemporaryFolder folder_;
};

TEST_F(AuthorityTest, AnIdentityIsWhatWasIssued) {
  const auto path = IssueWorker("rack-1");
  ASSERT_TRUE(path) << path.error().message;
  const auto identity = OpenIdentity(*path, {Role::kWorker});
  ASSERT_TRUE(identity) << identity.error().message;
  EXPECT_EQ(identity->name, "rack-1");
  EXPECT_EQ(identity->subject, "CN=rack-1,OU=worker,O=Etude");
  EXPECT_NEAR(static_cast<double>(identity->not_after), static_cast<double>(Now() + 86400), 5);
  struct stat info {};
  ASSERT_EQ(::stat((*path / "key.pem").c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777u, 0600u);
  ASSERT_EQ(::stat((folder_.path() / "ca" / "identity-ca.key").c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777u, 0600u);
}

// what two issue side by side is listed, and can be revoked
TEST_F(AuthorityTest, SeveralMayIssueSideBySide) {
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i) threads.emplace_back([&, i] { EXPECT_TRUE(IssueWorker("rack-" + std::to_string(i))); });
  for (auto& thread : threads) thread.join();
  EXPECT_EQ(ReadIssued(folder_.path())->size(), 4u);
  for (int i = 0; i < 4; ++i) EXPECT_TRUE(Revoke(folder_.path(), "rack-" + std::to_string(i)));
}

TEST_F(AuthorityTest, NamesAreTakenOnceAndAgainAfterRevocation) {
  ASSERT_TRUE(IssueWorker("rack-1"));
  EXPECT_FALSE(IssueWorker("rack-1"));
  ASSERT_TRUE(Revoke(folder_.path(), "rack-1"));
  const auto again = IssueWorker("rack-1");
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(Refusal(*again), "");
  EXPECT_FALSE(Revoke(folder_.path(), "nobody"));
}

TEST_F(AuthorityTest, ARoleThatIsGivenTwiceCountsOnce) {
  std::vector<Role> roles;
  for (int i = 0; i < 2; ++i) roles.insert(roles.end(), std::begin(kRoles), std::end(kRoles));
  const auto path =
      Issue(folder_.path(), {.name = "all", .roles = roles, .not_before = Now() - 60, .not_after = Now() + 86400});
  ASSERT_TRUE(path) << path.error().message;
  const auto identity = OpenIdentity(*path, {Role::kWorker, Role::kRelay});
  ASSERT_TRUE(identity) << identity.error().message;
  EXPECT_EQ(identity->roles.size(), std::size(kRoles)) << "none is left out, in silence or otherwise";
  EXPECT_EQ(ReadIssued(folder_.path()).value()[0].roles.size(), std::size(kRoles));
}

TEST_F(AuthorityTest, WhatCouldNotBeWrittenIsListedAndCanBeRevoked) {
  ASSERT_TRUE(WriteFileAtomically(folder_.path() / "rack-1", std::string_view("a file in the folder's place")));
  ASSERT_FALSE(IssueWorker("rack-1"));
  const auto issued = ReadIssued(folder_.path());
  ASSERT_TRUE(issued);
  ASSERT_EQ(issued->size(), 1u);
  EXPECT_FALSE(issued->front().serial.empty());
  EXPECT_TRUE(Revoke(folder_.path(), "rack-1"));
}

TEST_F(AuthorityTest, NamesThatWouldSplitASubjectAreRefused) {
  for (const char* name : {"", "a,b", "a/b", "A", "ca", "public", "a b", "..", "a--01c2d3e4"})
    EXPECT_FALSE(IssueWorker(name)) << name;
}

TEST_F(AuthorityTest, ASecondAuthorityInAFolderIsRefused) {
  EXPECT_FALSE(InitAuthority(folder_.path(), Protection::kEncrypt));
}

// the disk was full, say: neither to begin again nor to go on said what to do
TEST_F(AuthorityTest, OneThatWasNotMadeToItsEndSaysHowToBeginAgain) {
  std::filesystem::remove(folder_.path() / "ca" / "issued.json");
  EXPECT_THAT(InitAuthority(folder_.path(), Protection::kEncrypt).error().message,
              HasSubstr("remove 'ca' and 'public'"));
  EXPECT_THAT(IssueWorker("rack-1").error().message, HasSubstr("etude security init"));
}

// every process reads the list at its start: it must not grow with all that was ever revoked
TEST_F(AuthorityTest, TheRevocationListForgetsWhatHasExpired) {
  const auto listed = [&] {
    const auto list = ReadCrl(folder_.path() / "public" / "crl.pem");
    return list ? sk_X509_REVOKED_num(X509_CRL_get_REVOKED(list->get())) : -2;
  };
  ASSERT_TRUE(IssueWorker("now"));
  ASSERT_TRUE(Revoke(folder_.path(), "now"));
  EXPECT_EQ(listed(), 1);
  ASSERT_TRUE(IssueWorker("old", -10 * 86400, -3 * 86400));
  ASSERT_TRUE(Revoke(folder_.path(), "old"));
  EXPECT_EQ(listed(), 1);
  ASSERT_TRUE(IssueWorker("too"));
  ASSERT_TRUE(Revoke(folder_.path(), "too"));
  EXPECT_EQ(listed(), 2);
}

TEST_F(AuthorityTest, ShowsWhatWasIssued) {
  ASSERT_TRUE(IssueWorker("rack-1"));
  ASSERT_TRUE(IssueWorker("rack-2"));
  ASSERT_TRUE(Revoke(folder_.path(), "rack-2"));
  const auto issued = ReadIssued(folder_.path());
  ASSERT_TRUE(issued);
  ASSERT_EQ(issued->size(), 2u);
  EXPECT_FALSE((*issued)[0].revoked);
  EXPECT_TRUE((*issued)[1].revoked);
  EXPECT_EQ((*issued)[0].roles, std::vector<std::string>{"worker"});
}

TEST_F(AuthorityTest, RefusesWhatTheBusWouldBeSilentAbout) {
  const Path path = IssueWorker("rack-1").value();
  EXPECT_THAT(Refusal(path, {Role::kCollector}), HasSubstr("its role is worker"));
  EXPECT_THAT(Refusal(path / "nowhere"), HasSubstr("no such folder"));
  ASSERT_EQ(::chmod((path / "key.pem").c_str(), 0644), 0);
  EXPECT_THAT(Refusal(path), HasSubstr("chmod 600"));
  ASSERT_EQ(::chmod((path / "key.pem").c_str(), 0600), 0);
  EXPECT_EQ(Refusal(path), "");
  std::filesystem::remove(path / "crl.pem");
  EXPECT_THAT(Refusal(path), HasSubstr("'crl.pem' is missing"));
}

TEST_F(AuthorityTest, RefusesIdentitiesOutOfTheirTime) {
  EXPECT_THAT(Refusal(IssueWorker("past", -7200, -3600).value()), HasSubstr("it expired on"));
  EXPECT_THAT(Refusal(IssueWorker("future", 3600, 7200).value()), HasSubstr("it holds from"));
  EXPECT_THAT(Refusal(IssueWorker("ending", -86400, 30).value()), HasSubstr("about to expire"));
}

// As on a host whose clock is behind its administrator's: the library says no more than that it does not begin.
TEST_F(AuthorityTest, RefusesARevocationListOfTheFuture) {
  const Path path = IssueWorker("rack-1").value();
  const Crl crl = ReadCrl(path / "crl.pem").value();
  const std::unique_ptr<ASN1_TIME, decltype(&ASN1_TIME_free)> later(ASN1_TIME_set(nullptr, Now() + 600),
                                                                    &ASN1_TIME_free);
  ASSERT_EQ(X509_CRL_set1_lastUpdate(crl.get(), later.get()), 1);
  const Key key = ReadPrivateKey(folder_.path() / "ca" / "identity-ca.key").value();
  ASSERT_GT(X509_CRL_sign(crl.get(), key.get(), EVP_sha256()), 0);
  ASSERT_TRUE(WriteFileAtomically(path / "crl.pem", std::string_view(PemOf(crl).value())));
  EXPECT_THAT(Refusal(path), HasSubstr("is this machine's clock right?"));
}

// One folder that cannot be written: before, all identities issued after it went on with the old list.
TEST_F(AuthorityTest, ARevocationReachesAllThatCanBeWritten) {
  const Path first = IssueWorker("rack-1").value();
  ASSERT_TRUE(IssueWorker("rack-2"));
  const Path last = IssueWorker("rack-3").value();
  std::filesystem::remove(first / "crl.pem");
  std::filesystem::create_directories(first / "crl.pem" / "in the way");

  const Status revoked = Revoke(folder_.path(), "rack-2");
  ASSERT_FALSE(revoked);
  EXPECT_THAT(revoked.error().message, HasSubstr("'rack-2' is revoked, but not all identities here have the list"));
  EXPECT_EQ(sk_X509_REVOKED_num(X509_CRL_get_REVOKED(ReadCrl(last / "crl.pem").value().get())), 1);
}

TEST_F(AuthorityTest, RefusesTheRevoked) {
  const Path path = IssueWorker("rack-1").value();
  const Path other = IssueWorker("rack-2").value();
  ASSERT_TRUE(Revoke(folder_.path(), "rack-1"));
  EXPECT_THAT(Refusal(path), HasSubstr("is revoked"));
  EXPECT_EQ(Refusal(other), "");
}

TEST_F(AuthorityTest, RefusesAlteredDocumentsAndForeignParts) {
  const Path path = IssueWorker("rack-1").value();
  std::string text = ReadTextFile(path / "permissions.p7s").value();
  const std::string before = text;
  text.replace(text.find("q/*"), 3, "x/*");
  ASSERT_TRUE(WriteFileAtomically(path / "permissions.p7s", text));
  EXPECT_THAT(Refusal(path), HasSubstr("is not what permissions-ca.pem signed"));
  ASSERT_TRUE(WriteFileAtomically(path / "permissions.p7s", before));
  EXPECT_EQ(Refusal(path), "");

  const TemporaryFolder foreign;
  ASSERT_TRUE(InitAuthority(foreign.path(), Protection::kEncrypt));
  std::filesystem::copy_file(foreign.path() / "public" / "identity-ca.pem", path / "identity-ca.pem",
                             std::filesystem::copy_options::overwrite_existing);
  EXPECT_THAT(Refusal(path), HasSubstr("two authorities"));
}

// Renewed, and only cert.pem and key.pem copied: at the old end the library would end the participant without a word.
TEST_F(AuthorityTest, RefusesPermissionsOfAnEarlierTerm) {
  const Path path = IssueWorker("rack-1", -60, 3600).value();
  const std::string before = ReadTextFile(path / "permissions.p7s").value();
  ASSERT_TRUE(Revoke(folder_.path(), "rack-1"));
  ASSERT_EQ(IssueWorker("rack-1", -60, 86400).value(), path);
  EXPECT_EQ(Refusal(path), "");
  ASSERT_TRUE(WriteFileAtomically(path / "permissions.p7s", std::string_view(before)));
  EXPECT_THAT(Refusal(path), HasSubstr("permissions.p7s is not of this cert.pem (another name, or another end)"));

  const Path other = IssueWorker("rack-2").value();
  std::filesystem::copy_file(other / "permissions.p7s", path / "permissions.p7s",
                             std::filesystem::copy_options::overwrite_existing);
  EXPECT_THAT(Refusal(path), HasSubstr("copy the whole folder again"));
}

TEST_F(AuthorityTest, ChildrenGetTheNeighbourOfTheirRole) {
  const Path worker = IssueWorker("worker").value();
  const auto up = Issue(folder_.path(), {.name = "up",
                                         .roles = {Role::kCollector, Role::kGateway},
                                         .not_before = Now() - 60,
                                         .not_after = Now() + 86400});
  ASSERT_TRUE(up) << up.error().message;
  EXPECT_EQ(IdentityFor(*up, Role::kCollector), *up);
  EXPECT_EQ(IdentityFor(*up, Role::kWorker), worker.lexically_normal());
  EXPECT_EQ(IdentityFor(*up, Role::kTrainer), *up) << "it is refused there, with the reason";
}

TEST(IdentityDates, WarnInTimeAndEndBeforeTheEnd) {
  Identity identity;
  identity.not_before = 1'000'000;
  identity.not_after = 2'000'000;
  EXPECT_EQ(WarnAt(identity), 1'800'000);
  EXPECT_EQ(EndAt(identity), 1'999'700);
  identity.not_before = 1'999'990;
  EXPECT_EQ(EndAt(identity), 1'999'998) << "a short one, too, ends before the library ends it";
}

}  // namespace authority_test
}  // namespace etude::security
