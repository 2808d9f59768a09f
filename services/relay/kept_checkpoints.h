// SPDX-License-Identifier: Apache-2.0
// The newest checkpoint of each channel of a run, on disk: what a relay passes on.
//
//   FOLDER/kept.json                              the run and its user; of each channel version, hash and metadata
//   FOLDER/relayed-latest-4294967299.safetensors  a checkpoint's bytes, as they were published
//   FOLDER/kept.lock                              held by the one relay of the folder
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "services/bus/blob_transfer.h"
#include "services/bus/owner.h"
#include "services/core/file.h"
#include "services/core/file_lock.h"
#include "services/core/result.h"

namespace etude::relay {

struct Kept {
  std::uint64_t version = 0;
  std::string sha256;     ///< of the bytes, hexadecimal
  std::string meta_json;  ///< as published, with the signature that it may have
  std::string file;       ///< name in the folder
  bool whole = true;      ///< false: the file is damaged or missing; the version counts all the same
};

/// Whose checkpoints are kept.
struct KeptOwner : bus::Owner {
  std::string user;  ///< whose run it is; "": an older program did not say
};

/// The run whose checkpoints are in `folder`; nothing when there are none.
/// @error kCorrupt, kUnavailable: they cannot be read
Result<std::optional<KeptOwner>> KeptRun(const Path& folder);

/// One file a channel: what is newer takes the place of what there was, durably and by one rename, so that a kill or a
/// power cut leaves the old one or the new one. Versions never go back, but where one is forgotten. Not thread-safe.
class KeptCheckpoints {
 public:
  /// More channels than a run has are not kept: what a publisher can fill is bounded.
  static constexpr std::size_t kMostChannels = 8;

  /// Takes the folder, which is made when missing; what it has of another run goes with the first checkpoint of this
  /// one. Files are read and held against their hashes.
  /// @param user  whose run it is; "": as the folder says
  /// @error kUnavailable: another relay has the folder, or the disk; kCorrupt: kept.json is not understood
  static Result<KeptCheckpoints> Open(const Path& folder, const bus::Owner& run, const std::string& user = "");

  /// Keeps a verified blob of the run. What is kept already is not written again.
  /// @error kInvalidArgument: no plain channel, too many of them, older than what is kept, or another one of its
  /// version; kUnavailable: the disk, and nothing has changed
  Status Keep(const bus::PublishedBlob& blob);
  /// Sets aside what is kept of a channel, as refused-NAME, its bytes alone: it is not offered, and its version counts
  /// no more. Of a channel that is not kept: nothing.
  /// @error kUnavailable: the disk; it is kept
  Status Forget(const std::string& channel);

  const std::map<std::string, Kept>& channels() const { return channels_; }  ///< by channel
  /// The bytes. @error kCorrupt: they do not fit their hash any more, and `whole` is false from now on; kUnavailable,
  /// kNotFound
  Result<std::vector<std::uint8_t>> Read(const std::string& channel);

 private:
  KeptCheckpoints(Path folder, bus::Owner run, FileLock lock)
      : folder_(std::move(folder)), run_(std::move(run)), lock_(std::move(lock)) {}
  Status CheckVersion(const bus::PublishedBlob& blob) const;
  Status WriteRecord(const std::map<std::string, Kept>& channels) const;
  void RemoveOthers() const;

  Path folder_;
  bus::Owner run_;
  std::string user_;
  FileLock lock_;
  std::map<std::string, Kept> channels_;
};

}  // namespace etude::relay
