// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/history.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "services/campaign/worker_client.h"
#include "services/core/config.h"
#include "services/episode/bounded_json.h"
#include "services/store/attempts.h"

namespace etude::campaign {

namespace {

Path CollectorFile(const Path& folder) { return folder / "collector.json"; }

Status WriteCollectorFile(const Path& folder, const OrderedJson& json) {
  return WriteFileAtomically(CollectorFile(folder), json.dump() + "\n");
}

// Not an object when it is not understood.
Result<OrderedJson> ReadCollectorFile(const Path& folder) {
  ETUDE_ASSIGN_OR_RETURN(const std::string text, ReadTextFile(CollectorFile(folder), 1 << 20));
  return ParseBoundedJson(text).value_or(OrderedJson());
}

// A text beside the epoch, kept over starts.
std::optional<std::string> Known(const Path& folder, const char* key) {
  const auto json = ReadCollectorFile(folder);
  if (!json || !json->is_object() || !json->contains(key) || !(*json)[key].is_string()) return std::nullopt;
  return (*json)[key].get<std::string>();
}

Status Remember(const Path& folder, const char* key, const std::string& text) {
  ETUDE_ASSIGN_OR_RETURN(OrderedJson json, ReadCollectorFile(folder));
  if (!json.is_object())
    return Fail(Code::kCorrupt, fmt::format("'{}' is not a collector's", CollectorFile(folder).string()));
  json[key] = text;
  return WriteCollectorFile(folder, json);
}

}  // namespace

Result<std::uint64_t> LastEpoch(const Path& folder) {
  const auto json = ReadCollectorFile(folder);
  if (!json && json.error().code == Code::kNotFound) return 0;
  if (!json) return Fail(json.error());
  if (!json->is_object() || !json->contains("epoch") || !(*json)["epoch"].is_number_unsigned())
    return Fail(Code::kCorrupt, fmt::format("read the collector's epoch from '{}': not {{\"epoch\": N}}; write the "
                                            "number of times that a collector was started here into it",
                                            CollectorFile(folder).string()));
  return (*json)["epoch"].get<std::uint64_t>();
}

Status RememberEpoch(const Path& folder, std::uint64_t epoch) {
  ETUDE_ASSIGN_OR_RETURN(const std::uint64_t last, LastEpoch(folder));
  if (epoch <= last || epoch >= (1ull << 32))
    return Fail(Code::kInvalidArgument, fmt::format("'{}': epoch {} after {}: it must grow and fit into 32 bits",
                                                    CollectorFile(folder).string(), epoch, last));
  auto json = ReadCollectorFile(folder).value_or(OrderedJson::object());
  json["epoch"] = epoch;
  return WriteCollectorFile(folder, json);
}

std::optional<std::string> KnownFiles(const Path& folder) { return Known(folder, "files_sha256"); }

Status RememberFiles(const Path& folder, const std::string& sha256) { return Remember(folder, "files_sha256", sha256); }

std::optional<Fingerprint> KnownFingerprint(const Path& folder) {
  const auto text = Known(folder, "fingerprint");
  if (!text) return std::nullopt;
  auto known = ParseFingerprint(*text);
  return known ? std::optional(std::move(*known)) : std::nullopt;
}

Status RememberFingerprint(const Path& folder, const Fingerprint& fingerprint) {
  return Remember(folder, "fingerprint", FingerprintText(fingerprint));
}

LeaseTable::Retry RetryOf(const CampaignSpec& spec, const std::string& outcome) {
  if (outcome == kPolicyError) return LeaseTable::Retry::kSameAttempt;
  // a rollout's scene is a function of its index: another attempt would be the same
  if (outcome == kSceneInvalid && spec.mode == "rollout") return LeaseTable::Retry::kNever;
  return LeaseTable::Retry::kNextAttempt;
}

History ReadHistory(const Path& folder, const CampaignSpec& spec) {
  History history;
  std::set<std::pair<std::uint64_t, std::uint32_t>> seen;
  store::ForEachAttempt(folder, [&](const store::AttemptLine& line) {
    const auto retry = RetryOf(spec, line.outcome);
    if (retry == LeaseTable::Retry::kSameAttempt) {
      ++history.failures[line.outcome];  // and nothing of the index's own attempts
      return;
    }
    if (!seen.emplace(line.index, line.attempt).second) return;
    History::Index& past = history.indices[line.index];
    past.failures =
        retry == LeaseTable::Retry::kNever ? static_cast<std::uint32_t>(spec.max_attempts) : past.failures + 1;
    past.next_attempt = std::max(past.next_attempt, line.attempt + 1);
    ++history.failures[line.outcome];
    ++history.total;
  });
  return history;
}

}  // namespace etude::campaign
