// SPDX-License-Identifier: Apache-2.0
// Striped CRC-32C: the 8-byte words of a block are dealt out to four CRC-32C (Castagnoli) streams, so
// that a CPU computes four at once and reaches memory speed. Word i goes to stream i mod 4; the last
// size mod 32 bytes go to stream 0. Finds every single wrong bit and burst of a stream; it is no
// defence against somebody who wants to deceive (that is SHA-256's task).
#pragma once

#include <array>
#include <cstdint>
#include <span>

namespace etude::bus {

/// The four streams' CRCs, little-endian.
using StripedCrc = std::array<std::uint8_t, 16>;

StripedCrc StripedCrc32c(std::span<const std::uint8_t> bytes);

namespace internal {
/// The same without the CPU's CRC instruction; for tests and other CPUs.
StripedCrc StripedCrc32cPortable(std::span<const std::uint8_t> bytes);
}  // namespace internal

}  // namespace etude::bus
