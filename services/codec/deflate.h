// SPDX-License-Identifier: Apache-2.0
// zlib streams (RFC 1950), by libdeflate.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "services/core/result.h"

namespace etude::codec {

/// zlib stream of `bytes` at a fast level; the same bytes on every CPU. Thread-safe.
std::vector<std::uint8_t> Deflate(std::span<const std::uint8_t> bytes);
/// Inflates one stream into exactly `bytes.size()` bytes. Thread-safe.
/// @error kCorrupt
Status Inflate(std::span<const std::uint8_t> stream, std::span<std::uint8_t> bytes);

/// More than any stream of `size` bytes takes: what deflate cannot make smaller grows by 5 bytes a block of at least
/// 4 KiB.
inline std::uint64_t StreamBound(std::uint64_t size) { return size + size / 256 + 64; }

}  // namespace etude::codec
