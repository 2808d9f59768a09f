// SPDX-License-Identifier: Apache-2.0
// Text of others, made fit for a terminal or for being compared.
#pragma once

#include <string>
#include <string_view>

namespace etude {

/// One line for a terminal: what came from elsewhere may hold what moves its cursor. Control characters (of ASCII, and
/// U+0080 to U+009F in UTF-8) become spaces.
std::string Printable(std::string line);
/// The same of each of its lines.
std::string PrintableLines(const std::string& text);
/// Without the white space (blanks, tabs, ends of lines) around it; refers to `text`.
std::string_view Trimmed(std::string_view text);

}  // namespace etude
