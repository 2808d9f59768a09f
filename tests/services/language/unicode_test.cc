// SPDX-License-Identifier: Apache-2.0
// Tests services/language/unicode.cc
#include "services/language/unicode.h"

#include <gtest/gtest.h>

namespace etude::language {
namespace unicode_test {

TEST(Utf8, EveryCodePointIsReadAsItWasWritten) {
  int wrong = 0, read = 0;
  for (char32_t code = 0; code <= 0x10FFFF; ++code) {
    if (code == 0xD800) code = 0xE000;
    std::string text;
    AppendUtf8(code, text);
    const std::size_t size = code < 0x80 ? 1 : code < 0x800 ? 2 : code < 0x10000 ? 3 : 4;
    const Character first = FirstCharacter(text + "x");
    wrong += text.size() != size || first.code != code || first.size != size;
    ++read;
  }
  EXPECT_EQ(wrong, 0);
  EXPECT_EQ(read, 0x110000 - 0x800);
}

TEST(Utf8, IsWrittenAsTheStandardSays) {
  std::string text;
  for (const char32_t code : {U'$', U'¢', U'€', U'𐍈'}) AppendUtf8(code, text);
  EXPECT_EQ(text, "\x24\xC2\xA2\xE2\x82\xAC\xF0\x90\x8D\x88");
}

TEST(Utf8, WhatIsNoCharacterIsOneByte) {
  for (const char* text :
       {"\x80", "\xBF", "\xC0\x80", "\xC1\xBF", "\xC3", "\xC3(", "\xE0\x80\x80", "\xE2\x82", "\xE2\x82(",
        "\xED\xA0\x80", "\xF0\x80\x80\x80", "\xF0\x90\x8D", "\xF4\x90\x80\x80", "\xF5", "\xFF"}) {
    const Character first = FirstCharacter(text);
    EXPECT_EQ(first.code, kNoCodePoint) << text;
    EXPECT_EQ(first.size, 1u) << text;
  }
}

TEST(KindOf, TellsLettersNumbersAndSpacesFromTheRest) {
  for (const char32_t code : {U'a', U'Z', U'é', U'ß', U'µ', U'ª', U'ł', U'Ω', U'ж', U'א', U'あ', U'漢', U'한', U'Ω'})
    EXPECT_EQ(KindOf(code), CharacterKind::kLetter) << static_cast<unsigned>(code);
  for (const char32_t code : {U'0', U'9', U'²', U'½', U'٣', U'Ⅷ', U'①', U'７'})
    EXPECT_EQ(KindOf(code), CharacterKind::kNumber) << static_cast<unsigned>(code);
  for (const char32_t code : {U' ', U'\t', U'\n', U'\r', U'\u00A0', U'\u2003', U'\u3000'})
    EXPECT_EQ(KindOf(code), CharacterKind::kSpace) << static_cast<unsigned>(code);
  for (const char32_t code : {U'!', U'_', U'\'', U'\\', U'{', U'\0', U'\x7F', U'¡',    U'×',      U'’',
                              U'…', U'€', U'™',  U'→',  U'★', U'。', U'！',   U'🥫', U'\u0301', kNoCodePoint})
    EXPECT_EQ(KindOf(code), CharacterKind::kOther) << static_cast<unsigned>(code);
}

TEST(ToLower, KnowsLatinGreekAndCyrillic) {
  const std::u32string capitals = U"AZÀÖØÞĀĶĹŇŊŶŸŹŽẀỸΑΡΣΫΆΈΉΊΌΎΏАЯЀЏ";
  const std::u32string small = U"azàöøþāķĺňŋŷÿźžẁỹαρσϋάέήίόύώаяѐџ";
  ASSERT_EQ(capitals.size(), small.size());
  for (std::size_t i = 0; i < capitals.size(); ++i) {
    EXPECT_EQ(ToLower(capitals[i]), small[i]) << i;
    EXPECT_EQ(ToLower(small[i]), small[i]) << i;
  }
  for (const char32_t code : {U'1', U'@', U'[', U'×', U'ß', U'ĸ', U'ŉ', U'漢', U'\u03A2'})
    EXPECT_EQ(ToLower(code), code) << static_cast<unsigned>(code);
}

}  // namespace unicode_test
}  // namespace etude::language
