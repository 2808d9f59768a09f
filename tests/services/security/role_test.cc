// SPDX-License-Identifier: Apache-2.0
// Tests services/security/role.cc and certificate.cc
#include "services/security/role.h"

#include <gtest/gtest.h>

#include <set>

#include "services/security/authority.h"
#include "services/security/certificate.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::security {
namespace role_test {

TEST(Role, NamesAreReadBackAndEachIsItsOwn) {
  std::set<std::string> names;
  for (const Role role : kRoles) {
    const std::string name = ToString(role);
    EXPECT_TRUE(names.insert(name).second) << name;
    ASSERT_THAT(ParseRole(name), IsOk());
    EXPECT_EQ(*ParseRole(name), role);
    // they are put together with dots in a certificate, and are names of folders and options
    EXPECT_EQ(name.find_first_not_of("abcdefghijklmnopqrstuvwxyz"), std::string::npos) << name;
  }
  EXPECT_EQ(names.size(), std::size(kRoles));
}

TEST(Role, WhatIsNoneNamesThoseThatThereAre) {
  for (const char* text : {"", "Worker", "worker ", "king", "worker.collector"}) {
    const auto role = ParseRole(text);
    EXPECT_THAT(role, HasCode(Code::kInvalidArgument)) << text;
    EXPECT_THAT(role, MessageHas("collector, worker, trainer, policy, subscriber, robot, gateway, relay"));
  }
}

TEST(Role, ListsAreForPeople) {
  EXPECT_EQ(ListText({}), "");
  EXPECT_EQ(ListText({Role::kRelay}), "relay");
  EXPECT_EQ(ListText({Role::kGateway, Role::kCollector}), "gateway, collector") << "in the order that is given";
}

// X.509 bounds the parts of a name at 64 bytes: one identity may have every role
TEST(Role, AllOfThemFitIntoOneCertificate) {
  const TemporaryFolder folder;
  ASSERT_THAT(InitAuthority(folder.path(), Protection::kSign), IsOk());
  IssueOptions options{.name = "all", .roles = {std::begin(kRoles), std::end(kRoles)}};
  options.not_before = 1'700'000'000;
  options.not_after = 4'000'000'000;
  const auto issued = Issue(folder.path(), options);
  ASSERT_THAT(issued, IsOk());
  const auto identity = ReadIdentityCertificate(*issued / "cert.pem");
  ASSERT_THAT(identity, IsOk());
  EXPECT_EQ(identity->roles, options.roles);
  for (const Role role : kRoles) EXPECT_TRUE(identity->Has(role));
  EXPECT_EQ(identity->not_before, 1'700'000'000);
  EXPECT_EQ(identity->not_after, 4'000'000'000) << "beyond 2050 dates are written in another way";
  EXPECT_EQ(identity->serial.size(), 32u) << "16 bytes";
}

TEST(Certificate, WhatIsNoneIsSaidByItsName) {
  const TemporaryFolder folder;
  ASSERT_THAT(InitAuthority(folder.path(), Protection::kSign), IsOk());
  ASSERT_THAT(WriteFileAtomically(folder / "text.pem", std::string_view("not PEM")), IsOk());
  EXPECT_THAT(ReadCertificate(folder / "text.pem"), HasCode(Code::kCorrupt));
  EXPECT_THAT(ReadCertificate(folder / "text.pem"), MessageHas("text.pem"));
  EXPECT_THAT(ReadCertificate(folder / "none.pem"), HasCode(Code::kNotFound));
  // PEM, but of something else
  EXPECT_THAT(ReadCertificate(folder / "ca/identity-ca.key"), HasCode(Code::kCorrupt));
  EXPECT_THAT(ReadPrivateKey(folder / "public/identity-ca.pem"), MessageHas("private key"));
  EXPECT_THAT(ReadCrl(folder / "public/identity-ca.pem"), MessageHas("revocation list"));
  EXPECT_THAT(ReadCrl(folder / "public/crl.pem"), IsOk());
  // of the authority, but not one that it issued: it has no roles
  EXPECT_THAT(ReadIdentityCertificate(folder / "public/identity-ca.pem"), MessageHas("etude security issue"));
}

TEST(Certificate, KeysAndCertificatesSurviveTheirText) {
  const TemporaryFolder folder;
  const auto key = MakeEcKey();
  ASSERT_THAT(key, IsOk());
  const auto text = PemOf(*key);
  ASSERT_THAT(text, IsOk());
  ASSERT_THAT(WriteSecret(folder / "key.pem", *text), IsOk());
  const auto back = ReadPrivateKey(folder / "key.pem");
  ASSERT_THAT(back, IsOk());
  EXPECT_EQ(EVP_PKEY_eq(key->get(), back->get()), 1);
  const auto other = MakeEcKey();
  ASSERT_THAT(other, IsOk());
  EXPECT_NE(EVP_PKEY_eq(key->get(), other->get()), 1) << "each is drawn anew";
}

TEST(UtcText, IsTheDateInUtc) {
  EXPECT_EQ(UtcText(0), "1970-01-01 00:00:00Z");
  EXPECT_EQ(UtcText(951'782'400), "2000-02-29 00:00:00Z");
  EXPECT_EQ(UtcText(4'102'444'799), "2099-12-31 23:59:59Z");
}

}  // namespace role_test
}  // namespace etude::security
