// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/history.h"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <set>

#include "services/campaign/worker_client.h"
#include "services/core/config.h"

namespace etude::campaign {

namespace {

Path CollectorFile(const Path& folder) { return folder / "collector.json"; }

Status WriteCollectorFile(const Path& folder, const OrderedJson& json) {
  return WriteFileAtomically(CollectorFile(folder), json.dump() + "\n");
}

// Not an object when it is not understood.
Result<OrderedJson> ReadCollectorFile(const Path& folder) {
  ETUDE_ASSIGN_OR_RETURN(const std::string text, ReadTextFile(CollectorFile(folder), 1 << 16));
  return OrderedJson::parse(text, nullptr, false);
}

}  // namespace

Result<std::uint64_t> NextEpoch(const Path& folder) {
  const Path path = CollectorFile(folder);
  const auto read = ReadCollectorFile(folder);
  if (!read && read.error().code != Code::kNotFound) return Fail(read.error().Wrap("read the collector's epoch"));
  OrderedJson json = read ? *read : OrderedJson{{"epoch", 0u}};
  if (!json.is_object() || !json.contains("epoch") || !json["epoch"].is_number_unsigned())
    return Fail(Code::kCorrupt, fmt::format("read the collector's epoch from '{}': not {{\"epoch\": N}}; write the "
                                            "number of times that a collector was started here into it",
                                            path.string()));
  const std::uint64_t epoch = json["epoch"].get<std::uint64_t>() + 1;
  if (epoch >= (1ull << 32))
    return Fail(Code::kCorrupt, fmt::format("'{}': epoch {} is too large", path.string(), epoch));
  json["epoch"] = epoch;
  ETUDE_RETURN_IF_ERROR(WriteCollectorFile(folder, json));
  return epoch;
}

std::optional<std::string> KnownFiles(const Path& folder) {
  const auto json = ReadCollectorFile(folder);
  if (!json || !json->is_object() || !json->contains("files_sha256") || !(*json)["files_sha256"].is_string())
    return std::nullopt;
  return (*json)["files_sha256"].get<std::string>();
}

Status RememberFiles(const Path& folder, const std::string& sha256) {
  ETUDE_ASSIGN_OR_RETURN(OrderedJson json, ReadCollectorFile(folder));
  if (!json.is_object())
    return Fail(Code::kCorrupt, fmt::format("'{}' is not a collector's", CollectorFile(folder).string()));
  json["files_sha256"] = sha256;
  return WriteCollectorFile(folder, json);
}

History ReadHistory(const Path& folder) {
  History history;
  std::set<std::pair<std::uint64_t, std::uint32_t>> seen;
  std::ifstream file(folder / "attempts.jsonl");
  for (std::string line; std::getline(file, line);) {
    const OrderedJson json = OrderedJson::parse(line, nullptr, false);
    const auto is_unsigned = [&](const char* key) { return json.contains(key) && json[key].is_number_unsigned(); };
    if (!json.is_object() || !is_unsigned("index") || !is_unsigned("attempt") || !json.contains("outcome") ||
        !json["outcome"].is_string())
      continue;
    const auto index = json["index"].get<std::uint64_t>();
    const auto attempt = json["attempt"].get<std::uint32_t>();
    const auto outcome = json["outcome"].get<std::string>();
    const bool same = outcome == kPolicyError;
    if (!same && !seen.emplace(index, attempt).second) continue;
    History::Index& past = history.indices[index];
    ++past.failures;
    if (!same) past.next_attempt = std::max(past.next_attempt, attempt + 1);
    ++history.failures[outcome];
    ++history.total;
  }
  return history;
}

}  // namespace etude::campaign
