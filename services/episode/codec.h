// SPDX-License-Identifier: Apache-2.0
// Episode <-> bytes on the bus. Layout (little-endian):
//   8 bytes "ETUDEEP1" | u32 header size | JSON header | blobs back to back
// The header has every scalar and string, for each array {name, dtype, shape, offset, size}, and
// for each camera the sizes of its streams, which follow the arrays. The bytes are a pure function
// of the episode. A decoder trusts nothing: every length is checked against what is left before
// anything is allocated.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "services/core/result.h"
#include "services/episode/episode.h"

namespace etude {

/// Bounds that an episode from the wire or a file must keep.
inline constexpr std::int64_t kMaxSteps = 1'000'000;
inline constexpr int kMaxImageSide = 4096;  ///< px
inline constexpr int kMaxObjects = 64;
inline constexpr int kMaxCameras = 8;
inline constexpr std::size_t kMaxStreams = 1'000'000;  ///< of one camera: their sizes stand in the header, of 8 MiB

/// Frames that T control steps have: those at steps 0, image_stride, 2 * image_stride, ... below T.
inline std::int64_t FrameCount(std::int64_t steps, int image_stride) {
  return (steps + image_stride - 1) / image_stride;
}

/// Frames of one camera that the episode holds: none, or FrameCount of its steps.
std::size_t RecordedFrames(const Episode& episode, std::size_t camera);

/// Everything that later readers rely on: at least one step, T rows in every track (`states` may be
/// absent), finite values (but pixels, NaN behind the camera), unit quaternions, plain unique names
/// of objects and cameras, phases that have a name, and for each camera either no stream or
/// those of FrameCount() frames. Whether they inflate is not looked at.
/// @error kInvalidArgument with the first thing that does not fit.
Status ValidateEpisode(const Episode& episode);

/// What ValidateEpisode asks of the streams of one camera, for those that the episode does not hold itself.
Status ValidateStreams(const Episode& episode, std::size_t camera,
                       std::span<const std::span<const std::uint8_t>> streams);

/// The episode should be valid (DecodeEpisode refuses others). Text that is not UTF-8 is replaced.
std::vector<std::uint8_t> EncodeEpisode(const Episode& episode);

/// @error kCorrupt with what does not fit: magic, header, sizes, row counts that differ from T,
/// NaN.
Result<Episode> DecodeEpisode(std::span<const std::uint8_t> bytes);

/// Deflated frames that lie elsewhere, [camera][stream].
using StreamSpans = std::vector<std::vector<std::span<const std::uint8_t>>>;
/// Those of an episode that holds them; valid as long as it is.
StreamSpans StreamsOf(const Episode& episode);

/// SHA-256, hex, of EncodeEpisode's bytes, which are not made for it. The streams are those of `streams`, wherever they
/// lie, and not those that the episode may hold.
std::string EpisodeSha256(const Episode& episode, const StreamSpans& streams);

/// An episode whose streams were left where they are.
struct EpisodeView {
  Episode episode;      ///< cameras have no streams
  StreamSpans streams;  ///< into the bytes that were decoded
};
/// DecodeEpisode without copying the streams, for bytes that are EncodeEpisode's own: their SHA-256 is then that of
/// the episode. @error as DecodeEpisode; kCorrupt, too, when the same episode would be encoded otherwise
Result<EpisodeView> ViewEpisode(std::span<const std::uint8_t> bytes);

}  // namespace etude
