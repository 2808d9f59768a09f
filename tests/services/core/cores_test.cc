// SPDX-License-Identifier: Apache-2.0
#include "services/core/cores.h"

#include <gtest/gtest.h>

namespace etude {
namespace cores_test {

TEST(CoresTest, AQuotaIsWorthSoManyRoundedUp) {
  EXPECT_EQ(CoresOf(64, "200000 100000"), 2);
  EXPECT_EQ(CoresOf(64, "250000 100000"), 3);
  EXPECT_EQ(CoresOf(64, "50000 100000"), 1);
  EXPECT_EQ(CoresOf(2, "800000 100000"), 2);  // more than there are
}

TEST(CoresTest, WithoutAQuotaAllThatThereAre) {
  for (const char* none : {"max 100000", "", "0 100000", "100000"}) EXPECT_EQ(CoresOf(8, none), 8) << none;
  EXPECT_EQ(CoresOf(0, ""), 1);  // not known
  EXPECT_GE(Cores(), 1);
}

}  // namespace cores_test
}  // namespace etude
