// SPDX-License-Identifier: Apache-2.0
#include "services/episode/frame_cursor.h"

#include <fmt/format.h>

#include "services/core/check.h"
#include "services/episode/codec.h"

namespace etude {

FrameCursor::FrameCursor(const Episode& episode, std::size_t camera)
    : track_(episode.cameras.at(camera)), layout_(track_.layout()), frames_(RecordedFrames(episode, camera)) {
  ETUDE_CHECK(layout_.IsGood() && track_.streams.size() == layout_.streams(frames_), "{} streams of {} frames",
              track_.streams.size(), frames_);
}

Result<std::span<const std::uint8_t>> FrameCursor::Frame(std::size_t k) {
  ETUDE_CHECK(k < frames_, "{} of {}", k, frames_);
  const auto of_block = static_cast<std::size_t>(layout_.chunk.frames);
  const std::size_t block = k / of_block, bands = static_cast<std::size_t>(layout_.bands());
  if (block != held_) {
    held_ = SIZE_MAX;
    pixels_.resize(layout_.block_bytes());
    const auto first = track_.streams.begin() + static_cast<std::ptrdiff_t>(block * bands);
    const std::vector<std::span<const std::uint8_t>> streams(first, first + static_cast<std::ptrdiff_t>(bands));
    if (Status inflated = codec::InflateBlock(layout_, streams, pixels_); !inflated)
      return Fail(inflated.error().Wrap(fmt::format("camera {} frame {}", track_.camera.name, k)));
    held_ = block;
  }
  return std::span<const std::uint8_t>(pixels_).subspan(k % of_block * layout_.frame_bytes(), layout_.frame_bytes());
}

}  // namespace etude
