// SPDX-License-Identifier: Apache-2.0
// What `etude results` reads of an eval.json, and keeps. One that another version wrote may lack any number: that is
// never a reason to end.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "services/core/config.h"

namespace etude::cli {

/// What lies at `key`; null where the key is missing or `json` is no map.
const OrderedJson* FindPart(const OrderedJson& json, const char* key);
/// A part of a part: what lies at the end of the path.
template <typename... Keys>
const OrderedJson* FindPart(const OrderedJson& json, const char* key, Keys... keys) {
  const OrderedJson* part = FindPart(json, key);
  return part ? FindPart(*part, keys...) : nullptr;
}
/// The number at `key` of a report; none where the key is missing, is no integer or is negative, or `json` is no map.
std::optional<std::uint64_t> CountAt(const OrderedJson& json, const char* key);
/// Whether an eval.json has come to its end: its rollouts, and the scenes that do not count because the expert cannot
/// do the task in them ("scenes", "invalid"), are `episodes` together. False where it is no report.
bool IsWholeReport(const OrderedJson& report, std::uint64_t episodes);
/// What tables show of an eval.json, and of its comparison which row ("with") and which rollouts of it ("with_sha256",
/// RolloutsHash) it is with. Numbers of a report that another version wrote may be missing.
OrderedJson BriefReport(const OrderedJson& report);
/// Why a row that is compared with another one was not: what stands in the place of its comparison; "": it was, or is
/// not to be.
std::string MissingComparison(const OrderedJson& report);
/// ", content 7, rollouts 5": by which versions of them an eval.json was made; "" where it does not say.
std::string VersionsText(const OrderedJson& report);
/// Of an eval.json, or of what is kept of it: SHA-256 of what it says overall, which is another one of other rollouts.
std::string RolloutsHash(const OrderedJson& report);

}  // namespace etude::cli
