// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace etude {

/// One line for a terminal: what came from elsewhere may hold what moves its cursor. Control characters (of ASCII, and
/// U+0080 to U+009F in UTF-8) become spaces.
std::string Printable(std::string line);
/// The same of each of its lines.
std::string PrintableLines(const std::string& text);

}  // namespace etude
