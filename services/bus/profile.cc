// SPDX-License-Identifier: Apache-2.0
#include "services/bus/profile.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <optional>
#include <string_view>
#include <system_error>

#include "services/bus/local_profile.h"
#include "services/core/file.h"
#include "services/core/printable.h"

namespace etude::bus {
namespace {

constexpr std::string_view kWhiteSpace = " \t\r\n";
constexpr std::string_view kFileUri = "file://";

Result<std::string> ReadProfile(const std::string& file) {
  auto text = ReadTextFile(file, 1 << 20);
  if (text) return std::move(*text);
  Error error = std::move(text).error().Wrap("DDS profile");
  error.code = Code::kUnavailable;
  return Fail(std::move(error));
}

// Cyclone takes the names of elements in either.
std::string LowerCaseWithoutComments(std::string text) {
  for (std::size_t begin = 0; (begin = text.find("<!--", begin)) != std::string::npos;) {
    const std::size_t end = text.find("-->", begin);
    text.erase(begin, end == std::string::npos ? end : end + 3 - begin);
  }
  std::ranges::transform(text, text.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

// What stands in the next element of that name (in lower case), children and all; `rest` goes on behind it.
std::optional<std::string_view> TakeElement(std::string_view& rest, const std::string& name) {
  for (std::size_t begin; (begin = rest.find("<" + name)) != std::string_view::npos;) {
    rest.remove_prefix(begin + 1 + name.size());
    const bool is_longer_name =
        rest.empty() || (rest.front() != '>' && kWhiteSpace.find(rest.front()) == std::string_view::npos);
    const std::size_t open = rest.find('>');
    if (is_longer_name || open == std::string_view::npos) continue;
    const bool is_empty = open > 0 && rest[open - 1] == '/';
    rest.remove_prefix(open + 1);
    if (is_empty) continue;
    const std::string_view content = rest.substr(0, rest.find("</" + name));
    rest.remove_prefix(content.size());
    return content;
  }
  return std::nullopt;
}

// The text of an element without children.
std::string_view Value(std::string_view content) { return Trimmed(content.substr(0, content.find('<'))); }

// A number with its unit, as the profile says sizes; nothing when it is none.
std::optional<double> BytesOf(std::string_view value) {
  static const std::map<std::string, double, std::less<>> kUnits{
      {"", 1}, {"b", 1}, {"kb", 1024}, {"kib", 1024}, {"mb", 1024 * 1024}, {"mib", 1024 * 1024}};
  const std::string text(value);
  char* end = nullptr;
  const double number = std::strtod(text.c_str(), &end);
  if (end == text.c_str()) return std::nullopt;
  const auto unit = kUnits.find(Trimmed(end));
  return unit == kUnits.end() ? std::nullopt : std::optional(number * unit->second);
}

// The same for times.
std::optional<double> SecondsOf(std::string_view value) {
  static const std::map<std::string, double, std::less<>> kUnits{{"ns", 1e-9}, {"us", 1e-6}, {"ms", 1e-3},   {"s", 1},
                                                                 {"min", 60},  {"hr", 3600}, {"day", 86'400}};
  const std::string text(value);
  char* end = nullptr;
  const double number = std::strtod(text.c_str(), &end);
  const auto unit = kUnits.find(Trimmed(end));
  if (end == text.c_str() || unit == kUnits.end() || !(number > 0)) return std::nullopt;
  return number * unit->second;
}

}  // namespace

Result<std::string> ProfileText(const std::string& profile) {
  if (Trimmed(profile).starts_with('<')) return profile;
  if (!profile.empty()) return ReadProfile(profile);
  const char* const variable = std::getenv("CYCLONEDDS_URI");
  const std::string_view uri = Trimmed(variable != nullptr ? variable : "");
  if (uri.empty()) return std::string(kLocalProfile);
  if (uri.starts_with('<')) return std::string(uri);
  const std::string file(uri.starts_with(kFileUri) ? uri.substr(kFileUri.size()) : uri);
  // a list, unless that is a file's name: children are told --profile's so
  std::error_code error;
  if (uri.find(',') != std::string_view::npos && !std::filesystem::exists(file, error)) return std::string(uri);
  return ReadProfile(file);
}

double LeaseSeconds(const std::string& profile) {
  constexpr double kDefault = 10;
  const std::string text = LowerCaseWithoutComments(profile);
  std::string_view rest = text;
  const auto content = TakeElement(rest, "leaseduration");
  return content ? SecondsOf(Value(*content)).value_or(kDefault) : kDefault;
}

Status CheckSecuredProfile(const std::string& profile) {
  const std::string_view trimmed = Trimmed(profile);
  if (!trimmed.starts_with('<') || !trimmed.ends_with('>'))
    return Fail(
        Code::kUnavailable,
        fmt::format("DDS profile: CYCLONEDDS_URI is a list, '{}': with security on it must be one file, which is "
                    "checked for what fails in silence",
                    trimmed));
  const std::string text = LowerCaseWithoutComments(profile);
  constexpr double kMostFragment = 65000;
  std::string_view rest = text;
  while (const auto content = TakeElement(rest, "fragmentsize")) {
    const auto fragment = BytesOf(Value(*content));
    if (fragment && *fragment > kMostFragment)
      return Fail(
          Code::kUnavailable,
          fmt::format("DDS profile: FragmentSize is {:.0f} B: what security adds makes datagrams larger than UDP "
                      "takes, and nothing arrives; at most {:.0f} B",
                      *fragment, kMostFragment));
  }
  for (const char* name : {"sharedmemory", "shm"}) {
    rest = text;
    while (const auto content = TakeElement(rest, name)) {
      std::string_view inside = *content;
      const auto enable = TakeElement(inside, "enable");
      if (enable && Value(*enable) == "true")
        return Fail(Code::kUnavailable,
                    "DDS profile: SharedMemory is on, which passes by all security; set SharedMemory/Enable to false");
    }
  }
  return {};
}

}  // namespace etude::bus
