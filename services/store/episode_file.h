// SPDX-License-Identifier: Apache-2.0
// One episode <-> the bytes of its HDF5 file; format.md tells the layout. A file is an HDF5 file
// followed by a seal, one line of text with a checksum of all before it. HDF5 readers ignore what
// follows their data, and a damaged file is recognised before anything else is read.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "services/core/result.h"
#include "services/episode/action.h"
#include "services/episode/codec.h"
#include "services/episode/episode.h"
#include "services/store/dataset.h"

namespace etude::store::internal {

/// Bytes of an episode's file that is read at all.
inline constexpr std::uint64_t kMaxEpisodeFile = 4ull << 30;

/// Bounds that scale actions_abs (x, y, z in m, rotation in 6D, gripper) to actions in [-1, 1].
inline constexpr double kActionLow[kWaypointSize] = {-1.5, -1.5, -0.5, -1, -1, -1, -1, -1, -1, 0};
inline constexpr double kActionHigh[kWaypointSize] = {1.5, 1.5, 1.5, 1, 1, 1, 1, 1, 1, 1};

/// The bytes are a pure function of the episode.
/// @error kInvalidArgument when the episode is not valid or a stream does not inflate to its size.
Result<std::vector<std::uint8_t>> EncodeEpisodeFile(const Episode& episode);
/// The same file as HDF5's own library lays it out, without a seal: what the one above is compared with.
/// @error kInternal
Result<std::vector<std::uint8_t>> EncodeByLibrary(const Episode& episode);

/// A file in pieces, so that streams are not copied: they lie where `streams` says, between `head` and `seal`.
struct EpisodeFileParts {
  std::vector<std::uint8_t> head;
  std::vector<std::span<const std::uint8_t>> streams;
  std::string seal;

  std::vector<std::span<const std::uint8_t>> pieces() const;  ///< in order
  std::uint64_t size() const;
};
/// Of an episode that was found valid (ViewEpisode). Does not take the mutex of HDF5, makes no pass over the streams
/// but that of the checksum. `streams` must outlive the result. @error kInternal
Result<EpisodeFileParts> LayOutEpisodeFile(const Episode& episode, const StreamSpans& streams,
                                           const std::string& content_sha256);

struct EpisodeFile {
  int schema_version = kSchemaVersion;  ///< of the file; `episode` is converted to this program's
  Episode episode;                      ///< cameras have no streams
  std::vector<StoredFrames> frames;     ///< of each camera; offsets into the file
  std::string content_sha256;           ///< as the writer saw it: ContentHash of its own schema

  /// Its schema had other content, which reading converts: ContentHash of `episode` is another then.
  bool converted() const { return schema_version < 2; }
};

/// @error kCorrupt: the seal is missing or broken, or the content is not an episode.
Result<EpisodeFile> DecodeEpisodeFile(std::span<const std::uint8_t> bytes);
/// Where its streams lie in `bytes`, the same that were decoded.
StreamSpans StreamsIn(const EpisodeFile& file, std::span<const std::uint8_t> bytes);
/// Copies the streams out of `bytes`, the same that were decoded.
Episode WithStreams(EpisodeFile file, std::span<const std::uint8_t> bytes);

/// SHA-256 of the encoded episode: of what it says, not of how the file lies.
std::string ContentHash(const Episode& episode);

/// Every `every`th stream, beginning with one that follows from the episode's index, is one of zlib and of its camera's
/// size; the others begin as one. @error kCorrupt
Status CheckStreams(const Episode& episode, const StreamSpans& streams, std::uint64_t every = 1);

/// Bytes of the seal that is written. An earlier kind, of 113 bytes with a SHA-256, is read, too.
inline constexpr std::size_t kSealSize = 56;
void AppendSeal(std::vector<std::uint8_t>& bytes);
/// The bytes without their seal. @error kCorrupt
Result<std::span<const std::uint8_t>> CheckSeal(std::span<const std::uint8_t> bytes);

/// "/data/demo_12"
std::string DemoGroup(std::uint64_t index);
/// "demo_12"
std::string DemoName(std::uint64_t index);
/// What robomimic wants to know of the environment, as JSON.
std::string EnvArgs();

}  // namespace etude::store::internal
