// SPDX-License-Identifier: Apache-2.0
// A frame's bytes: deflated once by the worker that rendered it, inflated by whoever looks at it.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "services/core/result.h"

namespace etude::codec {

/// Inflates one zlib stream (libdeflate) into exactly `pixels.size()` bytes. Thread-safe.
/// @error kCorrupt
Status InflateFrame(std::span<const std::uint8_t> stream, std::span<std::uint8_t> pixels);
/// zlib stream of `pixels` at a fast level; deterministic. Thread-safe.
std::vector<std::uint8_t> DeflateFrame(std::span<const std::uint8_t> pixels);

}  // namespace etude::codec
