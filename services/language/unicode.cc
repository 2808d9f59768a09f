// SPDX-License-Identifier: Apache-2.0
#include "services/language/unicode.h"

#include <algorithm>

namespace etude::language {
namespace {

/// First and last code point.
struct Range {
  char32_t first, last;
};

constexpr Range kSpaces[] = {{0x09, 0x0D},     {0x1C, 0x20},     {0x85, 0x85},     {0xA0, 0xA0},     {0x1680, 0x1680},
                             {0x2000, 0x200A}, {0x2028, 0x2029}, {0x202F, 0x202F}, {0x205F, 0x205F}, {0x3000, 0x3000}};

constexpr Range kNumbers[] = {{0x30, 0x39},     {0xB2, 0xB3},     {0xB9, 0xB9},     {0xBC, 0xBE},     {0x660, 0x669},
                              {0x6F0, 0x6F9},   {0x966, 0x96F},   {0x2070, 0x2070}, {0x2074, 0x2079}, {0x2080, 0x2089},
                              {0x2150, 0x2182}, {0x2185, 0x2189}, {0x2460, 0x249B}, {0x24EA, 0x24FF}, {0x2776, 0x2793},
                              {0x3007, 0x3007}, {0x3021, 0x3029}, {0xFF10, 0xFF19}};

constexpr Range kOthers[] = {
    // ASCII and Latin-1
    {0x00, 0x08},
    {0x0E, 0x1B},
    {0x21, 0x2F},
    {0x3A, 0x40},
    {0x5B, 0x60},
    {0x7B, 0x84},
    {0x86, 0x9F},
    {0xA1, 0xA9},
    {0xAB, 0xB1},
    {0xB4, 0xB4},
    {0xB6, 0xB8},
    {0xBB, 0xBB},
    {0xBF, 0xBF},
    {0xD7, 0xD7},
    {0xF7, 0xF7},
    // modifier symbols, combining marks, signs of Greek, Cyrillic, Armenian, Hebrew and Arabic
    {0x2C2, 0x2C5},
    {0x2D2, 0x2DF},
    {0x2E5, 0x2EB},
    {0x2ED, 0x2ED},
    {0x2EF, 0x36F},
    {0x375, 0x375},
    {0x37E, 0x37E},
    {0x384, 0x385},
    {0x387, 0x387},
    {0x3F6, 0x3F6},
    {0x482, 0x489},
    {0x55A, 0x55F},
    {0x589, 0x5C7},
    {0x5F3, 0x5F4},
    {0x600, 0x61F},
    {0x64B, 0x65F},
    {0x66A, 0x66D},
    {0x670, 0x670},
    {0x6D4, 0x6D4},
    // punctuation and currencies
    {0x200B, 0x200F},
    {0x2010, 0x2027},
    {0x202A, 0x202E},
    {0x2030, 0x205E},
    {0x2060, 0x206F},
    {0x207A, 0x207E},
    {0x208A, 0x208E},
    {0x20A0, 0x20FF},
    // letter-like symbols
    {0x2100, 0x2101},
    {0x2103, 0x2106},
    {0x2108, 0x2109},
    {0x2114, 0x2114},
    {0x2116, 0x2118},
    {0x211E, 0x2123},
    {0x2125, 0x2125},
    {0x2127, 0x2127},
    {0x2129, 0x2129},
    {0x212E, 0x212E},
    {0x213A, 0x213B},
    {0x2140, 0x2144},
    {0x214A, 0x214D},
    {0x214F, 0x214F},
    // arrows, mathematics, boxes, dingbats
    {0x218A, 0x245F},
    {0x249C, 0x24E9},
    {0x2500, 0x2775},
    {0x2794, 0x2BFF},
    {0x2E00, 0x2FFB},
    // CJK, private use, full width
    {0x3001, 0x3004},
    {0x3008, 0x3020},
    {0x302A, 0x3030},
    {0x3036, 0x3037},
    {0x303D, 0x303F},
    {0xE000, 0xF8FF},
    {0xFE00, 0xFE6F},
    {0xFEFF, 0xFEFF},
    {0xFF01, 0xFF0F},
    {0xFF1A, 0xFF20},
    {0xFF3B, 0xFF40},
    {0xFF5B, 0xFF65},
    {0xFFE0, 0xFFFF},
    // emoji, tags, private use
    {0x1F000, 0x1FAFF},
    {0xE0000, kNoCodePoint},
};

template <std::size_t N>
bool IsIn(const Range (&ranges)[N], char32_t code) {
  return std::any_of(std::begin(ranges), std::end(ranges),
                     [code](const Range& range) { return code >= range.first && code <= range.last; });
}

bool IsEven(char32_t code) { return code % 2 == 0; }

// Latin beyond ASCII and Latin-1, where capital and small letters stand in pairs
char32_t LatinToLower(char32_t code) {
  if (code == 0x130) return code;  // its small letter is two characters
  if (code == 0x178) return 0xFF;
  const bool even_first = (code >= 0x100 && code <= 0x137) || (code >= 0x14A && code <= 0x177) ||
                          (code >= 0x1E00 && code <= 0x1E95) || (code >= 0x1EA0 && code <= 0x1EFF);
  const bool odd_first = (code >= 0x139 && code <= 0x148) || (code >= 0x179 && code <= 0x17E);
  return (even_first && IsEven(code)) || (odd_first && !IsEven(code)) ? code + 1 : code;
}

char32_t GreekToLower(char32_t code) {
  if (code >= 0x391 && code <= 0x3AB && code != 0x3A2) return code + 0x20;
  if (code == 0x386) return 0x3AC;
  if (code >= 0x388 && code <= 0x38A) return code + 0x25;
  if (code == 0x38C) return 0x3CC;
  if (code == 0x38E || code == 0x38F) return code + 0x3F;
  return code;
}

}  // namespace

Character FirstCharacter(std::string_view text) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char lead = byte(0);
  if (lead < 0x80) return {lead, 1};
  const std::size_t size = lead >= 0xF0 ? 4 : lead >= 0xE0 ? 3 : 2;
  if (lead < 0xC2 || lead > 0xF4 || text.size() < size) return {};
  char32_t code = lead & (0x7FU >> size);
  for (std::size_t i = 1; i < size; ++i) {
    if ((byte(i) & 0xC0) != 0x80) return {};
    code = (code << 6) | (byte(i) & 0x3FU);
  }
  constexpr char32_t kLeast[] = {0, 0, 0x80, 0x800, 0x10000};
  if (code < kLeast[size] || code > 0x10FFFF || (code >= 0xD800 && code <= 0xDFFF)) return {};
  return {code, size};
}

void AppendUtf8(char32_t code, std::string& text) {
  const auto append = [&](char32_t byte) { text += static_cast<char>(byte); };
  if (code < 0x80) {
    append(code);
    return;
  }
  const int following = code < 0x800 ? 1 : code < 0x10000 ? 2 : 3;
  constexpr char32_t kLead[] = {0, 0xC0, 0xE0, 0xF0};
  append(kLead[following] | (code >> (6 * following)));
  for (int i = following - 1; i >= 0; --i) append(0x80 | ((code >> (6 * i)) & 0x3F));
}

CharacterKind KindOf(char32_t code) {
  if ((code >= 'a' && code <= 'z') || (code >= 'A' && code <= 'Z')) return CharacterKind::kLetter;
  if (IsIn(kSpaces, code)) return CharacterKind::kSpace;
  if (IsIn(kNumbers, code)) return CharacterKind::kNumber;
  return IsIn(kOthers, code) ? CharacterKind::kOther : CharacterKind::kLetter;
}

char32_t ToLower(char32_t code) {
  if ((code >= 'A' && code <= 'Z') || (code >= 0xC0 && code <= 0xDE && code != 0xD7)) return code + 0x20;
  if ((code >= 0x100 && code <= 0x17E) || (code >= 0x1E00 && code <= 0x1EFF)) return LatinToLower(code);
  if (code >= 0x386 && code <= 0x3AB) return GreekToLower(code);
  if (code >= 0x400 && code <= 0x40F) return code + 0x50;
  if (code >= 0x410 && code <= 0x42F) return code + 0x20;
  return code;
}

}  // namespace etude::language
