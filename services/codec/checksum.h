// SPDX-License-Identifier: Apache-2.0
// A checksum that finds damage at the speed of memory. It says nothing of who wrote the bytes: that is SHA-256's part.
#pragma once

#include <cstdint>
#include <span>

namespace etude::codec {

/// CRC-32 (of gzip) of bytes that come in pieces: `before` is that of the pieces so far, 0 of none. Finds every change
/// of one or two bits and of 32 in a row. Thread-safe.
std::uint32_t Crc32(std::uint32_t before, std::span<const std::uint8_t> bytes);

}  // namespace etude::codec
