// SPDX-License-Identifier: Apache-2.0
// Pictures to an mp4 file. libav stays behind this header.
//
//   ETUDE_ASSIGN_OR_RETURN(auto writer, Mp4Writer::Open(path, {.width = 448, .height = 448, .rate = {125, 5}}));
//   for (const auto& picture : pictures) ETUDE_RETURN_IF_ERROR(writer.Write(picture));
//   ETUDE_RETURN_IF_ERROR(writer.Finish());
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "services/core/file.h"
#include "services/core/result.h"

namespace etude::video {

/// numerator / denominator pictures a second.
struct FrameRate {
  int numerator = 25;
  int denominator = 1;
};

struct Mp4Options {
  int width = 0, height = 0;  ///< px; even, as H.264 halves colours
  FrameRate rate;
  int key_frame_every = 5;  ///< pictures; small: a jump to any picture decodes few others
};

/// One file, H.264 (MPEG-4 where libav has no encoder of it), constant frame rate, no B-frames, its index in front so
/// that a browser plays it while it arrives. Without Finish the file is not playable. Not thread-safe.
class Mp4Writer {
 public:
  /// @error kInvalidArgument: sides that are not even or not positive; kUnavailable: no encoder, or the disk refuses.
  static Result<Mp4Writer> Open(const Path& path, const Mp4Options& options);
  Mp4Writer(Mp4Writer&&) noexcept;
  Mp4Writer& operator=(Mp4Writer&&) noexcept;
  ~Mp4Writer();

  /// @param rgb  height * width * 3 bytes. @error kUnavailable when encoder or disk refuse
  Status Write(std::span<const std::uint8_t> rgb);
  /// Writes what the encoder still holds, and the index. Call once, last.
  Status Finish();

 private:
  struct Impl;
  explicit Mp4Writer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::video
