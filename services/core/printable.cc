// SPDX-License-Identifier: Apache-2.0
#include "services/core/printable.h"

#include <algorithm>

namespace etude {

std::string Printable(std::string line) {
  for (std::size_t i = 0; i < line.size(); ++i) {
    const auto byte = static_cast<unsigned char>(line[i]);
    const auto next = i + 1 < line.size() ? static_cast<unsigned char>(line[i + 1]) : 0u;
    const bool is_wide_control = byte == 0xc2 && next >= 0x80 && next < 0xa0;
    if (is_wide_control) line[i + 1] = ' ';
    if (is_wide_control || byte < 0x20 || byte == 0x7f) line[i] = ' ';
  }
  return line;
}

std::string PrintableLines(const std::string& text) {
  std::string lines;
  for (std::size_t from = 0; from < text.size();) {
    const std::size_t end = std::min(text.find('\n', from), text.size());
    lines += Printable(text.substr(from, end - from));
    if (end < text.size()) lines += '\n';
    from = end + 1;
  }
  return lines;
}

std::string_view Trimmed(std::string_view text) {
  constexpr std::string_view kWhiteSpace = " \t\r\n";
  text.remove_prefix(std::min(text.find_first_not_of(kWhiteSpace), text.size()));
  return text.substr(0, text.find_last_not_of(kWhiteSpace) + 1);
}

}  // namespace etude
