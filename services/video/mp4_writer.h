// SPDX-License-Identifier: Apache-2.0
// Pictures to an mp4 file, or to a moving picture. libav stays behind this header.
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

enum class Container : std::uint8_t {
  kMp4,
  kAnimatedWebp,  ///< for pages that show pictures and play no video; repeats for ever, and cannot be jumped in
};

struct Mp4Options {
  int width = 0, height = 0;  ///< px; even, as H.264 halves colours
  FrameRate rate;
  int key_frame_every = 5;  ///< pictures; small: a jump to any picture decodes few others
  int crf = 21;             ///< x264's constant rate factor; smaller is better and larger

  Container container = Container::kMp4;
  float webp_quality = 55;  ///< 0 to 100

  static constexpr const char* kCodec = "h264";
  static constexpr const char* kPixelFormat = "yuv420p";
  static constexpr const char* kPreset = "veryfast";
};

enum class KeyFrame : std::uint8_t {
  kAsNeeded,
  kForced,  ///< e.g. the first picture of an episode: nothing before it is needed to show it
};

/// One file, H.264 (MPEG-4 where libav has no encoder of it), picture k shown at exactly k / rate, no B-frames, its
/// index in front so that a browser plays it while it arrives. The same pictures are the same bytes. It is written
/// beside its place and put there by Finish: what was there before stays until then, and for good without. Not
/// thread-safe.
class Mp4Writer {
 public:
  /// @error kInvalidArgument: sides that are not even or not positive; kUnavailable: no encoder, or the disk refuses.
  static Result<Mp4Writer> Open(const Path& path, const Mp4Options& options);
  Mp4Writer(Mp4Writer&&) noexcept;
  Mp4Writer& operator=(Mp4Writer&&) noexcept;
  ~Mp4Writer();

  /// @param rgb  height * width * 3 bytes, row-major, top row first. @error kUnavailable when encoder or disk refuse
  Status Write(std::span<const std::uint8_t> rgb, KeyFrame key = KeyFrame::kAsNeeded);
  /// Writes what the encoder still holds, and the index; durable when it returns. Call once, last.
  Status Finish();

  std::int64_t pictures() const;  ///< written
  std::uint64_t bytes() const;    ///< handed to the file until now

 private:
  struct Impl;
  explicit Mp4Writer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::video
