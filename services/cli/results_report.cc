// SPDX-License-Identifier: Apache-2.0
#include "services/cli/results_report.h"

#include <fmt/format.h>

#include "services/core/hash.h"

namespace etude::cli {

const OrderedJson* FindPart(const OrderedJson& json, const char* key) {
  return json.is_object() && json.contains(key) ? &json[key] : nullptr;
}

std::optional<std::uint64_t> CountAt(const OrderedJson& json, const char* key) {
  const OrderedJson* number = FindPart(json, key);
  if (!number || !number->is_number_integer()) return std::nullopt;
  if (!number->is_number_unsigned() && number->get<std::int64_t>() < 0) return std::nullopt;
  return number->get<std::uint64_t>();
}

bool IsWholeReport(const OrderedJson& report, std::uint64_t episodes) {
  const auto done = CountAt(report, "done");
  if (!done) return false;
  const OrderedJson* scenes = FindPart(report, "scenes");
  const auto invalid = scenes ? CountAt(*scenes, "invalid") : std::nullopt;
  return *done + invalid.value_or(0) >= episodes;
}

OrderedJson BriefReport(const OrderedJson& report) {
  OrderedJson brief = OrderedJson::object();
  for (const char* key : {"overall", "per_task"})
    if (const OrderedJson* part = FindPart(report, key)) brief[key] = *part;
  const auto keep = [&](const char* part, const char* key) {
    if (const OrderedJson* kept = FindPart(report, part, key)) brief[part][key] = *kept;
  };
  keep("scenes", "first_draw");
  for (const char* key : {"overall", "with", "with_sha256"}) keep("comparison", key);
  if (const std::string missing = MissingComparison(report); !missing.empty()) brief["comparison"]["missing"] = missing;
  return brief;
}

std::string MissingComparison(const OrderedJson& report) {
  const OrderedJson* missing = FindPart(report, "comparison", "missing");
  return missing && missing->is_string() ? missing->get<std::string>() : "";
}

std::string VersionsText(const OrderedJson& report) {
  const OrderedJson* rules = FindPart(report, "rules");
  const auto content = rules ? CountAt(*rules, "content") : std::nullopt;
  const auto rollout = rules ? CountAt(*rules, "rollout") : std::nullopt;
  return content && rollout ? fmt::format(", content {}, rollouts {}", *content, *rollout) : "";
}

std::string RolloutsHash(const OrderedJson& report) {
  const OrderedJson* overall = FindPart(report, "overall");
  return Sha256Hex(overall ? overall->dump() : "");
}

}  // namespace etude::cli
