// SPDX-License-Identifier: Apache-2.0
#include "services/codec/frames.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include "services/codec/deflate.h"
#include "services/core/check.h"

namespace etude::codec {
namespace {

constexpr std::size_t kChunkCache = 1 << 20;  // bytes that HDF5's library keeps of an array by default
constexpr std::size_t kMostBand = 24 << 10;   // bytes of a frame: with room for matches that moved
constexpr std::size_t kMostBlock = 64 << 20;  // bytes of its streams, inflated
constexpr int kMostFrames = 64;
constexpr int kMostSide = 1 << 20;  // px: products of two do not overflow

// Calls copy(offset in the stream of a band, offset in the frames, bytes) for each of the first `frames` frames.
template <class Copy>
void ForEachPiece(const FrameLayout& layout, int band, int frames, Copy copy) {
  const int first = band * layout.rows(), rows = std::min(layout.rows(), layout.height - first);
  for (int frame = 0; frame < frames; ++frame)
    copy(layout.band_bytes() * static_cast<std::size_t>(frame),
         layout.frame_bytes() * static_cast<std::size_t>(frame) + layout.row_bytes() * static_cast<std::size_t>(first),
         layout.row_bytes() * static_cast<std::size_t>(rows));
}

}  // namespace

ChunkShape ChunkShapeFor(int width, int height) {
  const FrameLayout frame{width, height, {}};
  const auto most_rows = static_cast<int>(std::max<std::size_t>(1, kMostBand / frame.row_bytes()));
  const int bands = (height + most_rows - 1) / most_rows;
  FrameLayout layout{width, height, {1, (height + bands - 1) / bands}};
  const std::size_t padded = layout.band_bytes() * static_cast<std::size_t>(layout.bands());  // of a frame
  const std::size_t frames = std::clamp<std::size_t>(kChunkCache / padded, 4, 16);
  if (frames > kMostBlock / padded) return {};  // frame by frame
  layout.chunk.frames = static_cast<int>(frames);
  return layout.chunk;
}

bool FrameLayout::IsGood() const {
  if (width < 1 || height < 1 || width > kMostSide || height > kMostSide) return false;
  if (chunk.frames < 1 || chunk.frames > kMostFrames || rows() < 1 || rows() > height) return false;
  return chunk.frames == 1 ||
         band_bytes() <= kMostBlock / static_cast<std::size_t>(chunk.frames) / static_cast<std::size_t>(bands());
}

FrameDeflater::FrameDeflater(const FrameLayout& layout) : layout_(layout) {
  ETUDE_CHECK(layout.IsGood(), "{}x{} px", layout.width, layout.height);
}

void FrameDeflater::Add(std::span<const std::uint8_t> frame) {
  ETUDE_CHECK(frame.size() == layout_.frame_bytes(), "{} bytes", frame.size());
  ++added_;
  if (layout_.whole()) {
    streams_.push_back(Deflate(frame));
    return;
  }
  if (held_ == 0) block_.assign(layout_.stream_bytes() * static_cast<std::size_t>(layout_.bands()), 0);
  const std::span<std::uint8_t> block = block_;
  for (int band = 0; band < layout_.bands(); ++band) {
    const auto place = block.subspan(layout_.stream_bytes() * static_cast<std::size_t>(band) +
                                     layout_.band_bytes() * static_cast<std::size_t>(held_));
    ForEachPiece(layout_, band, 1, [&](std::size_t in_stream, std::size_t in_frame, std::size_t size) {
      std::memcpy(place.data() + in_stream, frame.data() + in_frame, size);
    });
  }
  if (++held_ == layout_.chunk.frames) DeflateBlock(held_);
}

// Of each band its first `frames` frames.
void FrameDeflater::DeflateBlock(int frames) {
  const std::span<const std::uint8_t> block = block_;
  const std::size_t size = layout_.band_bytes() * static_cast<std::size_t>(frames);
  for (std::size_t at = 0; at < block.size(); at += layout_.stream_bytes())
    streams_.push_back(Deflate(block.subspan(at, size)));
  held_ = 0;
}

DeflatedFrames FrameDeflater::Finish() {
  ChunkShape chunk{layout_.chunk.frames, layout_.rows()};
  if (held_ > 0) {
    if (streams_.empty()) chunk.frames = held_;
    DeflateBlock(chunk.frames);
  }
  return {std::exchange(added_, 0), chunk, std::exchange(streams_, {})};
}

Status InflateBlock(const FrameLayout& layout, std::span<const std::span<const std::uint8_t>> streams,
                    std::span<std::uint8_t> frames) {
  ETUDE_CHECK(streams.size() == static_cast<std::size_t>(layout.bands()) && frames.size() == layout.block_bytes(),
              "{} streams, {} bytes", streams.size(), frames.size());
  if (layout.bands() == 1) return Inflate(streams[0], frames);
  std::vector<std::uint8_t> stream(layout.stream_bytes());
  for (int band = 0; band < layout.bands(); ++band) {
    ETUDE_RETURN_IF_ERROR(Inflate(streams[static_cast<std::size_t>(band)], stream));
    ForEachPiece(layout, band, layout.chunk.frames,
                 [&](std::size_t in_stream, std::size_t in_frames, std::size_t size) {
                   std::memcpy(frames.data() + in_frames, stream.data() + in_stream, size);
                 });
  }
  return {};
}

}  // namespace etude::codec
