// SPDX-License-Identifier: Apache-2.0
// Tests services/bus/security_log.cc
#include "services/bus/security_log.h"

#include <gtest/gtest.h>

#include <string>

namespace etude::bus {
namespace security_log_test {

TEST(SecurityLog, SaysEachPeerAndReasonOnce) {
  const auto line = TranslateSecurity(
      "Begin handshake reply failed: Certificate not valid: error: unable to get local issuer certificate; subject: "
      "/O=Etude/OU=worker/CN=rack-7(code: 200)");
  ASSERT_TRUE(line);
  EXPECT_EQ(line->peer, "rack-7");
  EXPECT_EQ(line->reason, "unknown authority");
  EXPECT_EQ(
      TranslateSecurity("Begin handshake reply failed: Certificate not valid: error: certificate signature failure; "
                        "subject: /O=Etude/OU=worker/CN=rack-8(code: 200)")
          ->reason,
      "unknown authority");
  SecurityLines lines;
  EXPECT_TRUE(lines.Take(*line));
  EXPECT_FALSE(lines.Take(*line));
  EXPECT_TRUE(
      lines.Take(*TranslateSecurity("Process handshake failed: certificate revoked; subject: /CN=rack-7(code)")));
}

// before, whoever knocked with 4096 names had silenced all that came after it, for the life of the process
TEST(SecurityLog, ManyStrangersSilenceNobody) {
  SecurityLines lines;
  for (int i = 0; i < 10'000; ++i) EXPECT_TRUE(lines.Take({"unknown authority", std::to_string(i), "no"})) << i;
  EXPECT_TRUE(lines.Take({"revoked", "rack-7", "security: 'rack-7' revoked"}));
}

TEST(SecurityLog, FalseAlarmsAreSilentAndOtherLinesAreNone) {
  const auto harmless = TranslateSecurity("Remote secure participant 1100a0b:c0d0:e0f0:1c1 not allowed");
  ASSERT_TRUE(harmless);
  EXPECT_FALSE(SecurityLines().Take(*harmless));
  EXPECT_FALSE(TranslateSecurity("failed to increase socket receive buffer size"));
}

}  // namespace security_log_test
}  // namespace etude::bus
