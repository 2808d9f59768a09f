// SPDX-License-Identifier: Apache-2.0
// What a host and its child say to each other over a socket pair: frames of a JSON head and bytes.
//
//   4 bytes "EtdF", 1 kind, 3 zero, 4 size of the head, 8 size of the bytes (little endian), head, bytes
//
// Lengths are checked before anything is allocated: a child that writes garbage costs itself, not its host.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "services/core/config.h"
#include "services/core/descriptor.h"
#include "services/core/result.h"

namespace etude::host {

enum class FrameKind : std::uint8_t {
  kCampaign = 1,  ///< down: what to make episodes of
  kReady = 2,     ///< up: the campaign's scene is built
  kWork = 3,      ///< down: one attempt
  kProgress = 4,  ///< up: how far it is
  kQuestion = 5,  ///< up: what a rollout asks its policy; bytes: the picture
  kAnswer = 6,    ///< down
  kResult = 7,    ///< up; bytes: the episode
  kFailure = 8,   ///< up, or down instead of an answer: an Error
};

struct Frame {
  FrameKind kind = FrameKind::kReady;
  OrderedJson head = OrderedJson::object();
  std::vector<std::uint8_t> bytes;
};

inline constexpr std::size_t kFrameHeader = 20;
/// A policy's modules may be 4 MiB on the bus, and more as JSON in JSON.
inline constexpr std::uint32_t kLongestHead = 16 << 20;
inline constexpr std::uint64_t kMostBytes = 1ull << 30;

std::array<std::uint8_t, kFrameHeader> FrameHeader(FrameKind kind, std::uint32_t head_size, std::uint64_t bytes_size);

/// Frames out of a stream of bytes, however they are cut. After an error it stays in error.
class FrameDecoder {
 public:
  /// @error kCorrupt: no frame, or one of an impossible size; nothing is allocated for it.
  Status Add(std::span<const std::uint8_t> bytes);
  /// The next whole frame; nothing when more bytes are needed. @error kCorrupt: its head is no JSON object.
  Result<std::optional<Frame>> Next();

 private:
  Status CheckHeader() const;
  std::vector<std::uint8_t> buffer_;
};

/// A connected stream socket; owns the descriptor. One thread at a time.
class Channel {
 public:
  explicit Channel(int descriptor) : socket_(descriptor) {}

  int descriptor() const { return socket_.get(); }
  /// Blocks until all is written. @error kUnavailable: nobody reads; kTimeout: not within the socket's send timeout.
  Status Send(FrameKind kind, const OrderedJson& head, std::span<const std::uint8_t> bytes = {});
  /// The next frame; nothing within `timeout`. @error kUnavailable: the other end has gone; kCorrupt
  Result<std::optional<Frame>> Receive(std::chrono::milliseconds timeout);
  /// How long Send may block.
  void LimitSend(std::chrono::milliseconds timeout);

 private:
  Descriptor socket_;
  FrameDecoder decoder_;
};

/// Two connected channels' descriptors, closed by an exec.
Result<std::array<int, 2>> MakeSocketPair();

}  // namespace etude::host
