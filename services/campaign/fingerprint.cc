// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/fingerprint.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>

#include "services/core/config.h"
#include "services/core/hash.h"
#include "services/episode/bounded_json.h"

namespace etude::campaign {
namespace {

constexpr std::size_t kMostLines = 32, kLongestValue = 4096;
constexpr const char* kNotSaid = "not said";

std::string ValueOf(const Fingerprint& fingerprint, const std::string& name) {
  const auto found = std::ranges::find(fingerprint, name, &Fingerprint::value_type::first);
  return found == fingerprint.end() ? kNotSaid : found->second;
}

}  // namespace

std::string FingerprintText(const Fingerprint& fingerprint) {
  OrderedJson json = OrderedJson::object();
  for (const auto& [name, value] : fingerprint) json[name] = value;
  return JsonText(json);
}

Result<Fingerprint> ParseFingerprint(std::string_view text) {
  const auto wrong = [] { return Fail(Code::kCorrupt, "a fingerprint: no JSON object of short texts"); };
  const auto json = ParseBoundedJson(text, 2);
  if (!json || !json->is_object() || json->size() > kMostLines) return wrong();
  Fingerprint fingerprint;
  for (const auto& [name, value] : json->items()) {
    if (!value.is_string() || name.size() > kLongestValue) return wrong();
    fingerprint.emplace_back(name, value.get<std::string>());
    if (fingerprint.back().second.size() > kLongestValue) return wrong();
  }
  return fingerprint;
}

std::string ShortHash(const Fingerprint& fingerprint) { return Sha256Hex(FingerprintText(fingerprint)).substr(0, 12); }

std::optional<std::string> FirstDifference(const Fingerprint& first, const Fingerprint& other,
                                           std::string_view determinism) {
  if (determinism == "none") return std::nullopt;
  Fingerprint all = first;  // names that only one of them has differ, too
  std::ranges::copy_if(other, std::back_inserter(all),
                       [&](const auto& line) { return ValueOf(first, line.first) == kNotSaid; });
  for (const auto& line : all) {
    const std::string& name = line.first;
    if (determinism == "physics" && (name == "gl" || name == "picture" || name == "deflated")) continue;
    const std::string here = ValueOf(first, name), there = ValueOf(other, name);
    // a campaign that an older program began goes on
    if (name == "deflated" && (here == kNotSaid || there == kNotSaid)) continue;
    if (here != there) return fmt::format("{}: here {}, there {}", name, here, there);
  }
  return std::nullopt;
}

}  // namespace etude::campaign
