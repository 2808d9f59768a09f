// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/http/message.h"

#include <fmt/format.h>
#include <unistd.h>

#include <charconv>

namespace etude::http {
namespace {

int Nibble(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

template <class Number>
bool Parse(std::string_view text, Number& number) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  return error == std::errc() && end == text.data() + text.size();
}

}  // namespace

std::optional<std::string> PercentDecoded(std::string_view text, bool plus_is_space) {
  std::string decoded;
  decoded.reserve(text.size());
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] == '+' && plus_is_space) {
      decoded += ' ';
    } else if (text[i] != '%') {
      decoded += text[i];
    } else {
      if (i + 2 >= text.size()) return std::nullopt;
      const int high = Nibble(text[i + 1]), low = Nibble(text[i + 2]);
      if (high < 0 || low < 0) return std::nullopt;
      decoded += static_cast<char>(high * 16 + low);
      i += 2;
    }
  }
  return decoded;
}

std::optional<std::vector<std::string>> SplitPath(std::string_view path) {
  std::vector<std::string> segments;
  while (!path.empty()) {
    const auto slash = path.find('/');
    const auto raw = path.substr(0, slash);
    path = slash == std::string_view::npos ? std::string_view() : path.substr(slash + 1);
    if (raw.empty()) continue;
    auto segment = PercentDecoded(raw);
    if (!segment || *segment == ".." || *segment == "." || segment->find('\0') != std::string::npos)
      return std::nullopt;
    segments.push_back(std::move(*segment));
  }
  return segments;
}

Query::Query(std::string_view text) {
  while (!text.empty()) {
    const auto end = text.find('&');
    const auto item = text.substr(0, end);
    text = end == std::string_view::npos ? std::string_view() : text.substr(end + 1);
    if (item.empty()) continue;
    const auto equals = item.find('=');
    const auto key = item.substr(0, equals);
    const auto value = equals == std::string_view::npos ? std::string_view() : item.substr(equals + 1);
    items_.emplace_back(PercentDecoded(key, true).value_or(std::string(key)),
                        PercentDecoded(value, true).value_or(std::string(value)));
  }
}

std::optional<std::string> Query::Get(std::string_view key) const {
  for (const auto& [name, value] : items_)
    if (name == key) return value;
  return std::nullopt;
}

std::vector<std::string> Query::All(std::string_view key) const {
  std::vector<std::string> values;
  for (const auto& [name, value] : items_)
    if (name == key && !value.empty()) values.push_back(value);
  return values;
}

Result<std::int64_t> Query::Integer(std::string_view key, std::int64_t fallback, std::int64_t low,
                                    std::int64_t high) const {
  const auto text = Get(key);
  if (!text || text->empty()) return fallback;
  std::int64_t number = 0;
  if (Parse(*text, number) && number >= low && number <= high) return number;
  return Fail(Code::kInvalidArgument,
              fmt::format("{}={:.40}: not a whole number from {} to {}", key, *text, low, high));
}

Result<std::uint64_t> Request::Index(const std::string& name) const {
  std::uint64_t number = 0;
  const std::string text = Parameter(name);
  if (Parse(text, number)) return number;
  return Fail(Code::kNotFound, fmt::format("'{:.40}' is not a number", text));
}

}  // namespace etude::http
