// SPDX-License-Identifier: Apache-2.0
// Tests services/core/enum_name.h
#include "services/core/enum_name.h"

#include <gtest/gtest.h>

namespace etude {
namespace enum_name_test {

enum class Colour { kRed = 3, kBlue = 7 };

constexpr std::string_view NameOf(Colour colour) {
  return EnumName(colour, {{Colour::kRed, "red"}, {Colour::kBlue, "blue"}});
}

TEST(EnumName, IsFoundWhateverTheNumbersAre) {
  static_assert(NameOf(Colour::kRed) == "red");
  EXPECT_EQ(NameOf(Colour::kBlue), "blue");
}

TEST(EnumName, OfAValueThatIsNotThereIsWhatWasAskedFor) {
  EXPECT_EQ(NameOf(static_cast<Colour>(5)), "?");
  EXPECT_EQ(EnumName(Colour::kBlue, {{Colour::kRed, "red"}}, "other"), "other");
}

}  // namespace enum_name_test
}  // namespace etude
