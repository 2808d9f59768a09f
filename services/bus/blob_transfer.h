// SPDX-License-Identifier: Apache-2.0
// Large blobs (episodes, checkpoints) as a manifest and chunks of at most 512 KiB: a single large DDS
// sample is many times slower than the same bytes in chunks. The reader sees a whole, SHA-256-verified
// blob or nothing.
//
//   point to point, acknowledged (episodes):  BlobSender -> BlobReceiver
//   published, transient-local (checkpoints): BlobPublisher -> BlobSubscriber, also by way of a relay
//
// Both ends name the blobs' owner. It is in the partition and in every manifest: blobs of another owner are not taken.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "services/bus/messages.h"
#include "services/bus/owner.h"
#include "services/bus/participant.h"
#include "services/core/result.h"
#include "services/security/checkpoint_signature.h"

namespace etude::bus {

inline constexpr std::uint32_t kMaxChunkSize = 512 * 1024;

struct SendOptions {
  std::uint32_t chunk_size = 128 * 1024;        ///< bytes, <= kMaxChunkSize
  std::uint32_t window = 32;                    ///< chunks in flight without progress
  std::chrono::milliseconds resend_after{500};  ///< without any ack: send what is missing again
};

/// How the receiver judged a blob.
struct Verdict {
  AckKind kind = AckKind::kDone;  ///< kDone | kDuplicate | kRefused
  std::string reason;
};

/// Sends blobs, one at a time, and waits for their acknowledgement. A blob that fits into one chunk travels as a single
/// sample.
/// Thread safety: one thread at a time.
class BlobSender {
 public:
  static Result<BlobSender> Open(const Participant& participant, const Owner& owner, const std::string& channel,
                                 const std::string& sender, const SendOptions& options = {});
  BlobSender(BlobSender&&) noexcept;
  BlobSender& operator=(BlobSender&&) noexcept;
  ~BlobSender();

  /// Sends one blob and blocks until the receiver's verdict; resends what is missing for as long as it
  /// takes (a receiver may be down for a minute), until `timeout` or a stop request.
  /// @error kTimeout, after which the same blob may be sent again with the same id.
  Result<Verdict> Send(std::uint64_t id, std::span<const std::uint8_t> bytes, std::uint64_t token,
                       const std::string& meta_json, std::chrono::nanoseconds timeout);

 private:
  struct Impl;
  explicit BlobSender(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

struct ReceivedBlob {
  BlobManifest manifest;
  std::vector<std::uint8_t> bytes;  ///< verified against manifest.sha256
};

/// What the receiver itself has refused: too large, or not the bytes of its checksum.
struct RefusedBlob {
  BlobManifest manifest;
  std::string reason;
};

struct PublishedBlob;

struct ReceiveOptions {
  std::uint64_t max_blob_size = 1ull << 30;  ///< larger manifests are refused before allocation
  /// Of all blobs that came and were not acknowledged yet, with what is said of them; others wait. One may be larger.
  std::uint64_t max_memory = 2ull << 30;
  /// Verdicts remembered for each sender, to answer repeats of a blob whose acknowledgement was lost.
  std::uint32_t verdicts_kept = 4;
  /// Of subscribers: judges a whole, verified blob. One that it refuses is logged and dropped as if never published, so
  /// that it cannot hold back a good one of a lower version; with kUnavailable it is asked again. Empty: all are taken.
  std::function<Status(const PublishedBlob&)> accept;
  /// Of subscribers: also takes what relays pass on. A relay itself listens to the run alone.
  bool from_relays = true;
};

/// Receives blobs of one channel from any number of senders. Thread safety: one thread at a time; Acknowledge from any.
class BlobReceiver {
 public:
  static Result<BlobReceiver> Open(const Participant& participant, const Owner& owner, const std::string& channel,
                                   const ReceiveOptions& options = {});
  BlobReceiver(BlobReceiver&&) noexcept;
  BlobReceiver& operator=(BlobReceiver&&) noexcept;
  ~BlobReceiver();

  /// The next verified blob, or nothing within `timeout` (or a stop request). Blobs whose hash does
  /// not fit are refused here and counted.
  std::optional<ReceivedBlob> Receive(std::chrono::nanoseconds timeout);
  /// Tells the sender. kDone only after the blob is durable. Repeats of an acknowledged blob are
  /// answered with the same verdict without another Receive.
  Status Acknowledge(const BlobManifest& manifest, const Verdict& verdict);
  /// Those refused since the last call, at most some hundred; their senders know.
  std::vector<RefusedBlob> TakeRefused();
  std::uint64_t corrupt_blobs() const;
  std::uint64_t malformed_samples() const;

 private:
  struct Impl;
  explicit BlobReceiver(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// Publishes versions of a blob on channels (e.g. run "demo", channels latest | best); late joiners
/// get the newest complete one. Memory on the bus is two versions a channel.
class BlobPublisher {
 public:
  static Result<BlobPublisher> Open(const Participant& participant, const Owner& owner,
                                    const SendOptions& options = {});
  /// Passes on what the owner itself has published, with its version and metadata: a relay. Subscribers take it as if
  /// it came from the owner, each version once.
  static Result<BlobPublisher> OpenRelay(const Participant& participant, const Owner& owner,
                                         const SendOptions& options = {});
  BlobPublisher(BlobPublisher&&) noexcept;
  BlobPublisher& operator=(BlobPublisher&&) noexcept;
  ~BlobPublisher();

  /// `version` must grow per channel.
  Status Publish(const std::string& channel, std::uint64_t version, std::span<const std::uint8_t> bytes,
                 const std::string& meta_json);
  /// Waits until all that are there have all of it, or for `timeout`: what is on its way when a publisher ends is kept
  /// for a second and then lost. @returns false where some have not.
  bool AwaitTaken(std::chrono::nanoseconds timeout);
  int matched_subscribers() const;

 private:
  struct Impl;
  explicit BlobPublisher(std::unique_ptr<Impl> impl);
  static Result<BlobPublisher> OpenIn(const Participant& participant, const Owner& owner, const std::string& partition,
                                      const SendOptions& options);
  std::unique_ptr<Impl> impl_;
};

struct PublishedBlob {
  std::string channel;
  std::uint64_t version = 0;
  std::string owner;  ///< id of the run
  std::string meta_json;
  std::string sha256;               ///< hex
  std::vector<std::uint8_t> bytes;  ///< verified
};

/// For ReceiveOptions::accept: only what `verifier` takes; none: everything.
std::function<Status(const PublishedBlob&)> AcceptSigned(std::shared_ptr<security::CheckpointVerifier> verifier);

class BlobSubscriber {
 public:
  /// `channel` empty: all channels of the owner.
  static Result<BlobSubscriber> Open(const Participant& participant, const Owner& owner, const std::string& channel,
                                     const ReceiveOptions& options = {});
  BlobSubscriber(BlobSubscriber&&) noexcept;
  BlobSubscriber& operator=(BlobSubscriber&&) noexcept;
  ~BlobSubscriber();

  /// The next complete, verified blob newer than the last one returned of its channel; skips versions
  /// that were superseded before they completed. Nothing within `timeout`, or on a stop request.
  std::optional<PublishedBlob> Wait(std::chrono::nanoseconds timeout);
  /// Whether a publisher which is still there has this version for late joiners, as of the last Wait. One that was
  /// killed counts as there for DDS's lease (10 s).
  bool Offered(const std::string& channel, std::uint64_t version) const;
  std::uint64_t corrupt_blobs() const;

 private:
  struct Impl;
  explicit BlobSubscriber(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::bus
