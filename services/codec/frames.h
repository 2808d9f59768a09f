// SPDX-License-Identifier: Apache-2.0
// A camera's frames as bytes: deflated once by the worker that rendered them, inflated by whoever looks at them.
//
// Between two frames of a camera that stands still few pixels change (2 % of a demonstration's), but deflate looks back
// 32 KiB only, and a frame of 224 x 224 px has 150. So several frames are cut into bands of rows, and a band of all of
// them is one stream: what was there in the frame before lies within reach. A file of HDF5 calls such a piece a chunk
// and has it as it is, so that every reader of HDF5 inflates it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "services/core/result.h"

namespace etude::codec {

/// What one stream holds of an array (frames, height, width, 3).
struct ChunkShape {
  int frames = 1;
  int rows = 0;  ///< 0: all

  bool operator==(const ChunkShape&) const = default;
};

/// The shape that is written. As many frames, at most 16, as HDF5's library keeps inflated (1 MiB of chunks), so that
/// readers who take one frame after the other inflate each once; but 4 at least, up to a block of 64 MiB. Bands of at
/// most 24 KiB a frame, or one row.
ChunkShape ChunkShapeFor(int width, int height);

/// How frames of width x height are cut: into blocks of chunk.frames, one after the other, each into bands() streams
/// from the top down. What is beyond the last frame and the last row is zeros.
struct FrameLayout {
  int width, height;  ///< px
  ChunkShape chunk;

  int rows() const { return chunk.rows == 0 ? height : chunk.rows; }
  int bands() const { return (height + rows() - 1) / rows(); }
  bool whole() const { return chunk.frames == 1 && rows() == height; }  ///< a frame is a stream
  std::size_t row_bytes() const { return std::size_t{3} * static_cast<std::size_t>(width); }
  std::size_t frame_bytes() const { return row_bytes() * static_cast<std::size_t>(height); }
  std::size_t block_bytes() const { return frame_bytes() * static_cast<std::size_t>(chunk.frames); }
  std::size_t band_bytes() const { return row_bytes() * static_cast<std::size_t>(rows()); }           ///< of one frame
  std::size_t stream_bytes() const { return band_bytes() * static_cast<std::size_t>(chunk.frames); }  ///< inflated
  std::size_t blocks(std::size_t frames) const {
    const auto of = static_cast<std::size_t>(chunk.frames);
    return frames / of + (frames % of != 0 ? 1 : 0);
  }
  std::size_t streams(std::size_t frames) const { return first_stream(blocks(frames)); }
  std::size_t block_of(std::size_t frame) const { return frame / static_cast<std::size_t>(chunk.frames); }
  std::size_t first_stream(std::size_t block) const { return block * static_cast<std::size_t>(bands()); }
  /// Of the frames of its block, as InflateBlock gives them.
  std::span<const std::uint8_t> FrameIn(std::span<const std::uint8_t> block, std::size_t frame) const {
    return block.subspan(frame % static_cast<std::size_t>(chunk.frames) * frame_bytes(), frame_bytes());
  }

  /// Whether a reader takes it: sides of at least 1, a chunk within the frame, and one frame, or at most 64 in streams
  /// of at most 64 MiB in all.
  bool IsGood() const;
};

/// What frames are written in.
inline FrameLayout LayoutFor(int width, int height) { return {width, height, ChunkShapeFor(width, height)}; }

struct DeflatedFrames {
  std::size_t count = 0;
  ChunkShape chunk;
  std::vector<std::vector<std::uint8_t>> streams;
};

/// Frames in order -> their streams in order: block by block, bands from the top down. Not thread-safe.
class FrameDeflater {
 public:
  /// @pre layout.IsGood()
  explicit FrameDeflater(const FrameLayout& layout);

  /// @pre frame.size() == layout.frame_bytes(); RGB, row-major, top row first
  void Add(std::span<const std::uint8_t> frame);
  /// Of all that were added, and their shape: the layout's, or of fewer frames where there are not as many (an array of
  /// HDF5 has no chunk that is larger than itself). It begins anew then.
  DeflatedFrames Finish();

 private:
  void DeflateBlock(int frames);

  FrameLayout layout_;
  std::vector<std::uint8_t> block_;  // as its streams have it: band by band, in each frame by frame
  int held_ = 0;                     // frames in it
  std::size_t added_ = 0;
  std::vector<std::vector<std::uint8_t>> streams_;
};

/// All frames of a block, one after the other. Thread-safe.
/// @pre layout.IsGood(), as many streams as it has bands, frames.size() == layout.block_bytes()
/// @error kCorrupt
Status InflateBlock(const FrameLayout& layout, std::span<const std::span<const std::uint8_t>> streams,
                    std::span<std::uint8_t> frames);

/// Frames in any order; those of the block that was asked for last are there already. Not thread-safe.
class BlockCursor {
 public:
  explicit BlockCursor(const FrameLayout& layout) : layout_(layout) {}

  const FrameLayout& layout() const { return layout_; }
  /// RGB (height, width, 3); valid until the next call. `fill`(block, pixels) puts the frames of a block, one after the
  /// other, into `pixels`, which it gives their size. @error that of `fill`
  template <class Fill>
  Result<std::span<const std::uint8_t>> Frame(std::size_t k, Fill fill) {
    if (const std::size_t block = layout_.block_of(k); block != held_) {
      held_ = SIZE_MAX;
      ETUDE_RETURN_IF_ERROR(fill(block, pixels_));
      held_ = block;
    }
    return layout_.FrameIn(pixels_, k);
  }

 private:
  FrameLayout layout_;
  std::size_t held_ = SIZE_MAX;  // the block that is in pixels_
  std::vector<std::uint8_t> pixels_;
};

}  // namespace etude::codec
