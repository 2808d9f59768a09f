// SPDX-License-Identifier: Apache-2.0
// Signatures (Ed25519) on what a run publishes: whoever holds the public key takes nothing that was altered, comes from
// elsewhere, or is older than what it had, whoever passed it on.
//
// Signed are the run's id, the channel, the version (which grows over all starts of a run) and the SHA-256 of the
// bytes. The signature is the field "signature" of the published metadata, so subscribers without a key go on as
// before.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <string_view>

#include "services/core/file.h"
#include "services/core/result.h"

namespace etude::security {

/// Makes `key` (mode 0600) and `key`.pub. @error kUnavailable: one of them is there already, or the disk.
Status MakeSigningKey(const Path& key);

/// What a signature is about.
struct Published {
  std::string owner;    ///< id of the run
  std::string channel;  ///< latest | best
  std::uint64_t version = 0;
  std::string sha256;  ///< hexadecimal, of the bytes
};

/// Thread-safe.
class CheckpointSigner {
 public:
  /// @error kUnavailable: no such key, or others can read it; kCorrupt: no Ed25519 key
  static Result<CheckpointSigner> Open(const Path& key);
  CheckpointSigner(CheckpointSigner&&) noexcept;
  CheckpointSigner& operator=(CheckpointSigner&&) noexcept;
  ~CheckpointSigner();

  /// `meta_json` (an object) with the signature in it. @error kInvalidArgument: no JSON object
  Result<std::string> Sign(const Published& published, const std::string& meta_json) const;

 private:
  struct Impl;
  explicit CheckpointSigner(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// Checks signatures and keeps a floor: the newest version that was taken of each run and channel, in a file, so that a
/// restarted subscriber cannot be given an older one. Several may share a file. Not thread-safe.
class CheckpointVerifier {
 public:
  /// @param floor  the file of the floor; empty: DefaultFloor(key)
  /// @error kUnavailable, kCorrupt: no such key, no Ed25519 key, a floor that cannot be locked or read
  static Result<CheckpointVerifier> Open(const Path& public_key, const Path& floor = {});
  CheckpointVerifier(CheckpointVerifier&&) noexcept;
  CheckpointVerifier& operator=(CheckpointVerifier&&) noexcept;
  ~CheckpointVerifier();

  /// Ok: signed, and not older than the floor, which is then raised (durably).
  /// @error kCorrupt: not signed, or altered; kInvalidArgument: older than the floor, or another
  /// one of its version; kUnavailable: the floor cannot be read, locked or written
  Status Check(const Published& published, const std::string& meta_json);
  const Path& floor() const;

 private:
  struct Impl;
  explicit CheckpointVerifier(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// `--verify` and `--floor` of a command that takes published checkpoints.
struct VerifyArguments {
  std::string key;    ///< file of the public key; empty: everything is taken
  std::string floor;  ///< file; empty: DefaultFloor
  /// None without a key; says where the floor is. @error as CheckpointVerifier::Open
  Result<std::shared_ptr<CheckpointVerifier>> Open() const;
};

/// $XDG_STATE_HOME (else ~/.local/state)/etude/checkpoint-floor-<first digits of the key's SHA-256>.json
Result<Path> DefaultFloor(const Path& public_key);

}  // namespace etude::security
