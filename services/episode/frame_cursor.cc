// SPDX-License-Identifier: Apache-2.0
#include "services/episode/frame_cursor.h"

#include <fmt/format.h>

#include <vector>

#include "services/core/check.h"
#include "services/episode/codec.h"

namespace etude {

FrameCursor::FrameCursor(const Episode& episode, std::size_t camera)
    : track_(episode.cameras.at(camera)), cursor_(track_.layout()), frames_(RecordedFrames(episode, camera)) {
  ETUDE_CHECK(cursor_.layout().IsGood() && track_.streams.size() == cursor_.layout().streams(frames_),
              "{} streams of {} frames", track_.streams.size(), frames_);
}

Result<std::span<const std::uint8_t>> FrameCursor::Frame(std::size_t k) {
  ETUDE_CHECK(k < frames_, "{} of {}", k, frames_);
  return cursor_.Frame(k, [&](std::size_t block, std::vector<std::uint8_t>& pixels) -> Status {
    const codec::FrameLayout& layout = cursor_.layout();
    pixels.resize(layout.block_bytes());
    const auto its =
        std::span(track_.streams).subspan(layout.first_stream(block), static_cast<std::size_t>(layout.bands()));
    const std::vector<std::span<const std::uint8_t>> streams(its.begin(), its.end());
    if (Status inflated = codec::InflateBlock(layout, streams, pixels); !inflated)
      return Fail(inflated.error().Wrap(fmt::format("camera {} frame {}", track_.camera.name, k)));
    return {};
  });
}

}  // namespace etude
