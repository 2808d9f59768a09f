// SPDX-License-Identifier: Apache-2.0
// Pictures -> an mp4 whose picture k is shown at exactly k / fps: H.264, constant rate, no B-frames, every second
// picture a key frame, so that readers who ask for single pictures find them quickly. libav stays behind this header.
//
//   ETUDE_ASSIGN_OR_RETURN(auto video, Mp4Writer::Create("a.mp4", {.width = 64, .height = 64, .fps = 25}));
//   for (const auto& rgb : pictures) ETUDE_RETURN_IF_ERROR(video.Add(rgb, KeyFrame::kAsNeeded));
//   ETUDE_RETURN_IF_ERROR(video.Finish());
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "services/core/file.h"
#include "services/core/result.h"

namespace etude::exports {

/// How pictures are encoded; what LeRobot's info.json says of a video.
struct VideoFormat {
  int width = 0, height = 0;  ///< px, even: H.264 halves colours
  int fps = 25;

  static constexpr const char* kCodec = "h264";
  static constexpr const char* kPixelFormat = "yuv420p";
  static constexpr int kKeyFrameEvery = 2;  ///< pictures
  static constexpr int kCrf = 23;           ///< x264's constant rate factor; smaller is better and larger
  static constexpr const char* kPreset = "veryfast";
};

enum class KeyFrame : std::uint8_t {
  kAsNeeded,
  kForced,  ///< e.g. the first picture of an episode: nothing before it is needed to show it
};

/// One file. Not a video until Finish has succeeded. Not thread-safe; one encoder thread.
class Mp4Writer {
 public:
  /// @error kInvalidArgument: odd or no size, a rate below 1; kUnavailable: no H.264 encoder, or the disk refuses
  static Result<Mp4Writer> Create(const Path& path, const VideoFormat& format);
  Mp4Writer(Mp4Writer&&) noexcept;
  Mp4Writer& operator=(Mp4Writer&&) noexcept;
  ~Mp4Writer();

  /// @param rgb  height * width * 3 bytes, row-major, top row first
  /// @error kInvalidArgument: another size; kUnavailable, kInternal of libav
  Status Add(std::span<const std::uint8_t> rgb, KeyFrame key);
  /// Durable when it returns. Nothing may be added after it.
  Status Finish();

  std::int64_t frames() const;  ///< added
  std::uint64_t bytes() const;  ///< handed to the file until now

 private:
  struct Impl;
  explicit Mp4Writer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::exports
