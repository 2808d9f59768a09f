// SPDX-License-Identifier: Apache-2.0
// As much of Unicode as splitting a sentence into words needs.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace etude::language {

/// A code point that none is: of bytes that are not UTF-8.
inline constexpr char32_t kNoCodePoint = 0xFFFFFFFF;

/// One character of UTF-8 text.
struct Character {
  char32_t code = kNoCodePoint;
  std::size_t size = 1;  ///< bytes that it takes; 1 of a byte that begins no character
};

/// The first character of `text`, which is not empty. Overlong forms, surrogates and what lies beyond U+10FFFF are no
/// characters.
Character FirstCharacter(std::string_view text);
/// Appends `code`, which is at most U+10FFFF, in UTF-8.
void AppendUtf8(char32_t code, std::string& text);

enum class CharacterKind {
  kSpace,   ///< \s
  kLetter,  ///< \p{L}
  kNumber,  ///< \p{N}
  kOther,   ///< everything else, bytes that are not UTF-8 included
};

/// Exact for ASCII, Latin, Greek, Cyrillic and the blocks of punctuation, symbols and emoji; marks, digits and
/// punctuation of other scripts count as letters unless they are common. Source: the Unicode Character Database.
CharacterKind KindOf(char32_t code);

/// The small letter of a capital one of Latin, Greek and Cyrillic; anything else as it is.
char32_t ToLower(char32_t code);

}  // namespace etude::language
