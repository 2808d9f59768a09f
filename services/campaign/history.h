// SPDX-License-Identifier: Apache-2.0
// What earlier lives of a collector left in its folder: the epoch of the fencing tokens, the files of the user that
// episodes were made with, and the failed attempts.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "services/campaign/fingerprint.h"
#include "services/core/file.h"
#include "services/core/result.h"
#include "services/spec/campaign_spec.h"

namespace etude::campaign {

/// The last epoch of `folder`; 0 at first. @error kCorrupt when FOLDER/collector.json is not readable.
Result<std::uint64_t> LastEpoch(const Path& folder);
/// Durable when it returns. @error kCorrupt; kInvalidArgument: `epoch` is not larger than the last one; kUnavailable.
Status RememberEpoch(const Path& folder, std::uint64_t epoch);

/// SHA-256 of the files that the spec of `folder` names, as the first worker had them; nothing when none has worked.
std::optional<std::string> KnownFiles(const Path& folder);
/// @error kNotFound, kCorrupt: no FOLDER/collector.json, or not ours; kUnavailable when it cannot be written
Status RememberFiles(const Path& folder, const std::string& sha256);

/// What the first worker's bytes depended on; nothing when none has said it.
std::optional<Fingerprint> KnownFingerprint(const Path& folder);
/// @error as RememberFiles
Status RememberFingerprint(const Path& folder, const Fingerprint& fingerprint);

/// Which shard of its campaign the folder is, as Shard::text; nothing where it never was one.
std::optional<std::string> KnownShard(const Path& folder);
/// @error as RememberFiles
Status RememberShard(const Path& folder, const std::string& shard);

/// That the last collector of the folder was stopped before all was done; forgotten with the next epoch; the dashboard
/// reads it from collector.json ("ended": "stopped").
/// @error as RememberFiles
Status RememberStop(const Path& folder);

/// An older program let the lines of failures stand that count no more, and kept their number (now they are set aside,
/// store::DatasetWriter::ForgetFailures). Call it once the file has begun anew. @error as RememberFiles
Status DropForgottenCount(const Path& folder);

/// Whether the collectors of these folders, shards of one campaign, took episodes of hosts that agree: each compared
/// its workers with its own first one. Folders that know of none are passed over.
/// @param determinism  what hosts must agree in, as the spec says it   @error kInvalidArgument: which line differs
Status CheckHostsAgree(const std::vector<Path>& folders, const std::string& determinism);
/// Has `to`, which is made of datasets that agree, know what their hosts and files were: a collector that goes on there
/// holds workers to it. Nothing where none of them knows.
Status CarryHosts(const std::vector<Path>& folders, const Path& to);

struct History {
  struct Index {
    std::uint32_t failures = 0;
    std::uint32_t next_attempt = 0;  ///< one after the largest that failed for good
  };
  std::map<std::uint64_t, Index> indices;
  std::map<std::string, std::uint64_t> failures;  ///< typed reason -> count
  std::uint64_t total = 0;                        ///< without those whose policy did not answer
};

/// attempts.jsonl. Lines that are torn or not understood are skipped: the attempt is made again.
/// A line that stands twice (a crash between recording and leasing) counts once, unless the same attempt
/// may fail again by its nature (policy_error). An index that can never succeed has max_attempts failures. Lines that
/// an older program took for forgotten do not count.
History ReadHistory(const Path& folder, const CampaignSpec& spec);

}  // namespace etude::campaign
