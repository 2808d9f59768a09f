// SPDX-License-Identifier: Apache-2.0
// Tests services/core/printable.cc
#include "services/core/printable.h"

#include <gtest/gtest.h>

namespace etude {
namespace printable_test {

TEST(Printable, HasNothingThatMovesACursor) {
  EXPECT_EQ(Printable("a\x1b[2Jb\nc\x7f"), "a [2Jb c ");
  EXPECT_EQ(Printable("a\xc2\x9b"
                      "31mb"),
            "a  31mb")
      << "a control sequence in two bytes";
  EXPECT_EQ(Printable("M\xc3\xbcller, 5 \xc2\xb5m \xc2"), "M\xc3\xbcller, 5 \xc2\xb5m \xc2") << "other characters stay";
  EXPECT_EQ(Printable(""), "");
}

TEST(PrintableLines, KeepTheirEnds) {
  EXPECT_EQ(PrintableLines("a\x1b[1A\nb\n\nc"), "a [1A\nb\n\nc");
  EXPECT_EQ(PrintableLines(""), "");
}

TEST(Trimmed, HasNoWhiteSpaceAroundIt) {
  EXPECT_EQ(Trimmed(" \t a b\r\n"), "a b");
  EXPECT_EQ(Trimmed("a"), "a");
  EXPECT_EQ(Trimmed(" \n"), "");
  EXPECT_EQ(Trimmed(""), "");
}

}  // namespace printable_test
}  // namespace etude
