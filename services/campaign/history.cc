// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/history.h"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <set>

#include "services/campaign/worker_client.h"
#include "services/core/config.h"

namespace etude::campaign {

Result<std::uint64_t> NextEpoch(const Path& folder) {
  const Path path = folder / "collector.json";
  std::uint64_t epoch = 0;
  auto text = ReadTextFile(path, 1 << 16);
  if (text) {
    const OrderedJson json = OrderedJson::parse(*text, nullptr, false);
    if (!json.is_object() || !json.contains("epoch") || !json["epoch"].is_number_unsigned())
      return Fail(Code::kCorrupt, fmt::format("read the collector's epoch from '{}': not {{\"epoch\": N}}; write the "
                                              "number of times that a collector was started here into it",
                                              path.string()));
    epoch = json["epoch"].get<std::uint64_t>();
  } else if (text.error().code != Code::kNotFound) {
    return Fail(text.error().Wrap("read the collector's epoch"));
  }
  ++epoch;
  if (epoch >= (1ull << 32))
    return Fail(Code::kCorrupt, fmt::format("'{}': epoch {} is too large", path.string(), epoch));
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(path, OrderedJson{{"epoch", epoch}}.dump() + "\n"));
  return epoch;
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
