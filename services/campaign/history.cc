// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/history.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <set>
#include <string>
#include <utility>

#include "services/campaign/lease_table.h"
#include "services/core/config.h"
#include "services/episode/bounded_json.h"
#include "services/spec/attempt_outcome.h"
#include "services/store/attempts.h"

namespace etude::campaign {

namespace {

// How the last collector ended, where it could say so.
constexpr const char* kEnded = "ended";
// How many of the first lines of attempts.jsonl do not count, as text: of an older program (DropForgottenCount).
constexpr const char* kForgotten = "forgotten_attempts";

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
  if (epoch <= last || epoch >= kEpochs)
    return Fail(Code::kInvalidArgument, fmt::format("'{}': epoch {} after {}: it must grow, and stay below {}",
                                                    CollectorFile(folder).string(), epoch, last, kEpochs));
  auto json = ReadCollectorFile(folder).value_or(OrderedJson::object());
  json["epoch"] = epoch;
  json.erase(kEnded);
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

std::optional<std::string> KnownShard(const Path& folder) { return Known(folder, "shard"); }

Status RememberShard(const Path& folder, const std::string& shard) { return Remember(folder, "shard", shard); }

Status RememberStop(const Path& folder) { return Remember(folder, kEnded, "stopped"); }

Status DropForgottenCount(const Path& folder) {
  return Known(folder, kForgotten) ? Remember(folder, kForgotten, "0") : Status();
}

Status CheckHostsAgree(const std::vector<Path>& folders, const std::string& determinism) {
  std::optional<std::pair<Path, std::string>> files;
  std::optional<std::pair<Path, Fingerprint>> host;
  const auto differ = [](const Path& first, const Path& other, const std::string& difference) {
    return Fail(Code::kInvalidArgument,
                fmt::format("'{}' and '{}' have episodes of hosts that differ ({}): together they are not what one "
                            "collector would have taken. Collect one of them again with the other's libraries and "
                            "files, or allow it with determinism: physics or none",
                            first.string(), other.string(), difference));
  };
  for (const Path& folder : folders) {
    if (auto known = KnownFiles(folder)) {
      if (!files) files.emplace(folder, *known);
      if (files->second != *known)
        return differ(files->first, folder, fmt::format("files of the user: {:.12}, {:.12}", files->second, *known));
    }
    if (auto known = KnownFingerprint(folder)) {
      if (!host) host.emplace(folder, *known);
      if (const auto difference = FirstDifference(host->second, *known, determinism))
        return differ(host->first, folder, *difference);
    }
  }
  return {};
}

Status CarryHosts(const std::vector<Path>& folders, const Path& to) {
  OrderedJson known{{"epoch", 0}};
  for (const char* key : {"files_sha256", "fingerprint"})
    for (const Path& folder : folders)
      if (const auto text = Known(folder, key)) known[key] = *text;
  return known.size() > 1 ? WriteCollectorFile(to, known) : Status();
}

History ReadHistory(const Path& folder, const CampaignSpec& spec) {
  History history;
  std::set<std::pair<std::uint64_t, std::uint32_t>> seen;
  std::uint64_t forgotten = std::strtoull(Known(folder, kForgotten).value_or("0").c_str(), nullptr, 10);
  store::ForEachAttempt(folder, [&](const store::AttemptLine& line) {
    if (forgotten > 0) {
      --forgotten;
      return;
    }
    const auto retry = RetryOf(spec, line.outcome);
    if (retry == Retry::kSameAttempt) {
      ++history.failures[line.outcome];  // and nothing of the index's own attempts
      return;
    }
    if (!seen.emplace(line.index, line.attempt).second) return;
    History::Index& past = history.indices[line.index];
    past.failures = retry == Retry::kNever ? static_cast<std::uint32_t>(spec.max_attempts) : past.failures + 1;
    past.next_attempt = std::max(past.next_attempt, line.attempt + 1);
    ++history.failures[line.outcome];
    ++history.total;
  });
  return history;
}

}  // namespace etude::campaign
