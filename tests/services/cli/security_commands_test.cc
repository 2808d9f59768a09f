// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/security.cc
#include <sys/stat.h>

#include "tests/services/cli/cli_fixture.h"
#include "tests/support/matchers.h"

namespace etude {
namespace security_commands_test {

using testing::HasSubstr;
using testing::Not;

class SecurityCommands : public CliFixture {
 protected:
  void SetUp() override { ASSERT_EQ(Etude({"security", "init", In("fleet")}).exit_code, kExitOk); }

  CommandOutcome Issue(const std::string& name, std::vector<std::string> more) {
    std::vector<std::string> arguments{"security", "issue", In("fleet"), "--name", name};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return Etude(arguments);
  }
  std::string Shown() { return Etude({"security", "show", In("fleet")}).text; }
  // The line of `show` about `name`.
  std::string Line(const std::string& name) {
    const std::string text = Shown();
    const auto at = text.find(name);
    return at == std::string::npos ? "" : text.substr(at, text.find('\n', at) - at);
  }
  mode_t ModeOf(const std::string& name) {
    struct stat info {};
    EXPECT_EQ(::stat(In(name).c_str(), &info), 0) << name;
    return info.st_mode & 0777;
  }
};

TEST_F(SecurityCommands, AnIdentityIsMadeShownAndTakenBack) {
  EXPECT_THAT(Shown(), HasSubstr("nothing issued yet"));
  const CommandOutcome issued = Issue("rack-1", {"--role", "worker", "--days", "2"});
  ASSERT_EQ(issued.exit_code, kExitOk) << issued.text;
  EXPECT_THAT(issued.text, HasSubstr(In("fleet/rack-1"))) << "where it is";
  EXPECT_EQ(ModeOf("fleet/rack-1/key.pem"), 0600u);
  EXPECT_THAT(Line("rack-1"), HasAll({"worker", "campaigns any", "runs any", "2.0 days left"}));

  const std::string before = ReadTextFile(folder_ / "fleet/public/crl.pem").value_or("");
  const CommandOutcome revoked = Etude({"security", "revoke", In("fleet"), "rack-1"});
  ASSERT_EQ(revoked.exit_code, kExitOk) << revoked.text;
  EXPECT_THAT(revoked.text, HasSubstr("crl.pem")) << "what to copy to the other hosts";
  EXPECT_THAT(Line("rack-1"), HasSubstr("revoked 20"));
  EXPECT_NE(ReadTextFile(folder_ / "fleet/public/crl.pem").value_or(""), before);
}

TEST_F(SecurityCommands, RolesCampaignsAndRunsAreAsTheyWereAsked) {
  ASSERT_EQ(Issue("both", {"--role", "collector", "--role", "gateway", "--campaign", "lab", "--campaign", "hall",
                           "--run", "base", "--domain", "9", "--domain", "12"})
                .exit_code,
            kExitOk);
  EXPECT_THAT(Line("both"), HasAll({"collector,gateway", "campaigns lab,hall", "runs base", "domains 9,12"}))
      << "whoever issues it again has to know";
}

TEST_F(SecurityCommands, WhatCannotBeAnIdentityIsUsage) {
  const CommandOutcome king = Issue("rack-1", {"--role", "king"});
  EXPECT_EQ(king.exit_code, kExitUsage);
  EXPECT_THAT(king.text, HasAll({"king", "collector, worker, trainer, policy, subscriber, robot, gateway, relay"}));
  EXPECT_EQ(Issue("rack-1", {}).exit_code, kExitUsage) << "no role";
  EXPECT_EQ(Issue("Rack 1", {"--role", "worker"}).exit_code, kExitUsage);
  EXPECT_EQ(Issue("../rack", {"--role", "worker"}).exit_code, kExitUsage);
  EXPECT_EQ(Issue("rack-1", {"--role", "worker", "--days", "0"}).exit_code, kExitUsage);
  EXPECT_EQ(Issue("rack-1", {"--role", "worker", "--domain", "231"}).exit_code, kExitUsage);
  EXPECT_THAT(Shown(), HasSubstr("nothing issued yet")) << "none of them is listed";
  ASSERT_EQ(Issue("rack-1", {"--role", "worker"}).exit_code, kExitOk);
  EXPECT_EQ(Issue("rack-1", {"--role", "worker"}).exit_code, kExitUsage) << "the name is taken";
}

// before, it was said when the collection was done and training should have begun
TEST_F(SecurityCommands, UpSaysAtTheStartWhoseIdentityIsMissing) {
  ASSERT_EQ(Issue("up", {"--role", "collector", "--role", "gateway", "--role", "relay"}).exit_code, kExitOk);
  ASSERT_EQ(Issue("worker", {"--role", "worker"}).exit_code, kExitOk);
  const auto campaign = std::filesystem::absolute("deploy/campaigns/quickstart.yaml");
  const std::string file = WriteFile("up.yaml", "campaign: " + campaign.string());
  const CommandOutcome up = Etude({"up", file, "--out", In("out"), "--security", In("fleet/up"), "--domain", "81"});
  EXPECT_EQ(up.exit_code, kExitMachine) << up.text;
  EXPECT_THAT(up.text, HasAll({"starts as trainer", "fleet/up"}));
  EXPECT_FALSE(std::filesystem::exists(In("out")));
}

TEST_F(SecurityCommands, AnAuthorityIsMadeOnceAndNeededForTheRest) {
  const std::string key = ReadTextFile(folder_ / "fleet/ca/identity-ca.key").value_or("");
  EXPECT_EQ(Etude({"security", "init", In("fleet")}).exit_code, kExitUsage);
  EXPECT_EQ(ReadTextFile(folder_ / "fleet/ca/identity-ca.key").value_or(""), key);
  EXPECT_EQ(ModeOf("fleet/ca/identity-ca.key"), 0600u);
  EXPECT_EQ(Etude({"security", "init", In("other"), "--protect", "nothing"}).exit_code, kExitUsage);
  EXPECT_EQ(Etude({"security", "show", In("none")}).exit_code, kExitFailure);
  EXPECT_EQ(Etude({"security", "issue", In("none"), "--role", "worker", "--name", "a"}).exit_code, kExitFailure);
  EXPECT_EQ(Etude({"security", "revoke", In("fleet"), "nobody"}).exit_code, kExitFailure);
}

TEST_F(SecurityCommands, ASigningKeyHasAPublicHalfAndIsMadeOnce) {
  ASSERT_EQ(Etude({"security", "signing-key", In("sign")}).exit_code, kExitOk);
  EXPECT_EQ(ModeOf("sign"), 0600u);
  const std::string key = ReadTextFile(folder_ / "sign").value_or("");
  EXPECT_THAT(key, HasSubstr("PRIVATE KEY"));
  const std::string half = ReadTextFile(folder_ / "sign.pub").value_or("");
  EXPECT_THAT(half, HasSubstr("PUBLIC KEY"));
  EXPECT_THAT(half, Not(HasSubstr("PRIVATE")));
  EXPECT_NE(Etude({"security", "signing-key", In("sign")}).exit_code, kExitOk);
  EXPECT_EQ(ReadTextFile(folder_ / "sign").value_or(""), key)
      << "what was signed with it could not be checked any more";
}

}  // namespace security_commands_test
}  // namespace etude
