// SPDX-License-Identifier: Apache-2.0
// The frames of an episode that holds them, inflated.
#pragma once

#include <cstdint>
#include <span>

#include "services/core/result.h"
#include "services/episode/episode.h"

namespace etude {

/// Frames of one camera in any order; those of the block that was asked for last are there already. Not thread-safe.
class FrameCursor {
 public:
  /// `episode` must outlive it.
  explicit FrameCursor(const Episode& episode, std::size_t camera = 0);
  explicit FrameCursor(Episode&& episode, std::size_t camera = 0) = delete;

  /// Frames that were recorded.
  std::size_t size() const { return frames_; }
  /// RGB (height, width, 3); valid until the next call. @pre k < size(). @error kCorrupt
  Result<std::span<const std::uint8_t>> Frame(std::size_t k);

 private:
  const CameraTrack& track_;
  codec::BlockCursor cursor_;
  std::size_t frames_;
};

}  // namespace etude
