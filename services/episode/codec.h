// SPDX-License-Identifier: Apache-2.0
// Episode <-> bytes on the bus. Layout (little-endian):
//   8 bytes "ETUDEEP1" | u32 header size | JSON header | blobs back to back
// The header has every scalar and string, and for each array or frame {name, dtype, shape, offset, size}.
// The bytes are a pure function of the episode. A decoder trusts nothing: every length is checked against
// what is left before anything is allocated.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "services/core/result.h"
#include "services/episode/episode.h"

namespace etude {

std::vector<std::uint8_t> EncodeEpisode(const Episode& episode);

/// @error kCorrupt with what does not fit: magic, header, sizes, row counts that differ from T, NaN.
Result<Episode> DecodeEpisode(std::span<const std::uint8_t> bytes);

}  // namespace etude
