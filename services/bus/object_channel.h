// SPDX-License-Identifier: Apache-2.0
// Large objects (episodes, checkpoints) as a manifest and chunks of at most 512 KiB: a single large DDS
// sample is many times slower than the same bytes in chunks. The reader sees a whole, SHA-256-verified
// object or nothing.
//
//   point to point, acknowledged (episodes):  ObjectSender -> ObjectReceiver
//   published, transient-local (checkpoints): ObjectPublisher -> ObjectSubscriber
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "services/bus/messages.h"
#include "services/bus/participant.h"
#include "services/core/result.h"

namespace etude::bus {

inline constexpr std::uint32_t kMaxChunkSize = 512 * 1024;

/// How an object is verified at the receiving end.
enum class Integrity : std::uint8_t {
  kSha256,  ///< also an identity: what datasets and checkpoints are named by
  kCrc32c,  ///< finds faults at the speed of a copy; for streams of camera frames
};

struct SendOptions {
  std::uint32_t chunk_size = 128 * 1024;        ///< bytes, <= kMaxChunkSize
  std::uint32_t window = 32;                    ///< chunks in flight without progress
  std::chrono::milliseconds resend_after{500};  ///< without any ack: send what is missing again
  Integrity integrity = Integrity::kSha256;
};

/// How the receiver judged an object.
struct Verdict {
  AckKind kind = AckKind::kDone;  ///< kDone | kDuplicate | kRefused
  std::string reason;
};

struct Sent {
  std::uint64_t id = 0;
  Verdict verdict;
};

/// Sends objects and waits for their acknowledgement: one at a time (Send), or several in flight
/// (Begin, Next). An object that fits into one chunk travels as a single sample.
/// Thread safety: one thread at a time.
class ObjectSender {
 public:
  static Result<ObjectSender> Open(const Participant& participant, const std::string& partition,
                                   const std::string& channel, const std::string& sender,
                                   const SendOptions& options = {});
  ObjectSender(ObjectSender&&) noexcept;
  ObjectSender& operator=(ObjectSender&&) noexcept;
  ~ObjectSender();

  /// Sends one object and blocks until the receiver's verdict; resends what is missing for as long as it
  /// takes (a receiver may be down for a minute), until `timeout` or a stop request.
  /// @error kTimeout, after which the same object may be sent again with the same id.
  Result<Verdict> Send(std::uint64_t id, std::span<const std::uint8_t> bytes, std::uint64_t token,
                       const std::string& meta_json, std::chrono::nanoseconds timeout);

  /// Starts an object and sends what the window allows. `bytes` must stay valid and unchanged until its
  /// verdict came from Next, or Cancel. The caller bounds the number begun with in_flight().
  Status Begin(std::uint64_t id, std::span<const std::uint8_t> bytes, std::uint64_t token,
               const std::string& meta_json);
  /// Goes on sending, and returns the next verdict; nothing after `timeout` or a stop request.
  std::optional<Sent> Next(std::chrono::nanoseconds timeout);
  /// Forgets an object that was begun; the receiver may still have got it.
  void Cancel(std::uint64_t id);
  std::size_t in_flight() const;
  int matched_receivers() const;

 private:
  struct Impl;
  explicit ObjectSender(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

struct ReceivedObject {
  ObjectManifest manifest;
  std::vector<std::uint8_t> bytes;  ///< verified against manifest.sha256
};

/// The same without a copy. Both are valid until the next call of ReceiveView or Receive.
struct ObjectView {
  const ObjectManifest* manifest = nullptr;
  std::span<const std::uint8_t> bytes;
};

struct ReceiveOptions {
  std::uint64_t max_object_size = 1ull << 30;  ///< larger manifests are refused before allocation
  std::uint64_t max_memory = 2ull << 30;       ///< of all unfinished objects together; others wait
  /// kDone verdicts that travel together. With more than 1, objects of a stream are also handed on so
  /// many at a time: throughput for up to half a millisecond of latency.
  std::uint32_t ack_batch = 1;
};

/// Receives objects of one channel from any number of senders. Thread safety: one thread at a time.
class ObjectReceiver {
 public:
  static Result<ObjectReceiver> Open(const Participant& participant, const std::string& partition,
                                     const std::string& channel, const ReceiveOptions& options = {});
  ObjectReceiver(ObjectReceiver&&) noexcept;
  ObjectReceiver& operator=(ObjectReceiver&&) noexcept;
  ~ObjectReceiver();

  /// The next verified object, or nothing within `timeout` (or a stop request). Objects whose hash does
  /// not fit are refused here and counted.
  std::optional<ReceivedObject> Receive(std::chrono::nanoseconds timeout);
  /// The same into an object whose memory is used again; false when there is none.
  bool Receive(ReceivedObject& object, std::chrono::nanoseconds timeout);
  /// The same where it lies: an object of one chunk is not copied out of DDS's memory.
  std::optional<ObjectView> ReceiveView(std::chrono::nanoseconds timeout);
  /// Tells the sender. kDone only after the object is durable. Repeats of an acknowledged object are
  /// answered with the same verdict without another Receive. With `ack_batch` > 1 a kDone leaves with
  /// others, half a millisecond later at most while Receive waits.
  Status Acknowledge(const ObjectManifest& manifest, const Verdict& verdict);
  std::uint64_t corrupt_objects() const;
  std::uint64_t malformed_samples() const;

 private:
  struct Impl;
  explicit ObjectReceiver(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// Publishes versions of an object on channels (e.g. run "demo", channels latest | best); late joiners
/// get the newest complete one. Memory on the bus is two versions a channel.
class ObjectPublisher {
 public:
  static Result<ObjectPublisher> Open(const Participant& participant, const std::string& partition,
                                      const SendOptions& options = {});
  ObjectPublisher(ObjectPublisher&&) noexcept;
  ObjectPublisher& operator=(ObjectPublisher&&) noexcept;
  ~ObjectPublisher();

  /// `version` must grow per channel.
  Status Publish(const std::string& channel, std::uint64_t version, std::span<const std::uint8_t> bytes,
                 const std::string& meta_json);
  int matched_subscribers() const;

 private:
  struct Impl;
  explicit ObjectPublisher(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

struct PublishedObject {
  std::string channel;
  std::uint64_t version = 0;
  std::string meta_json;
  std::string sha256;               ///< hex
  std::vector<std::uint8_t> bytes;  ///< verified
};

class ObjectSubscriber {
 public:
  /// `channel` empty: all channels of the partition.
  static Result<ObjectSubscriber> Open(const Participant& participant, const std::string& partition,
                                       const std::string& channel, const ReceiveOptions& options = {});
  ObjectSubscriber(ObjectSubscriber&&) noexcept;
  ObjectSubscriber& operator=(ObjectSubscriber&&) noexcept;
  ~ObjectSubscriber();

  /// The next complete, verified object newer than the last one returned of its channel; skips versions
  /// that were superseded before they completed. Nothing within `timeout`, or on a stop request.
  std::optional<PublishedObject> Wait(std::chrono::nanoseconds timeout);
  std::uint64_t corrupt_objects() const;

 private:
  struct Impl;
  explicit ObjectSubscriber(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::bus
