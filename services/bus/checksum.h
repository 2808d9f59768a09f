// SPDX-License-Identifier: Apache-2.0
// CRC-32C (Castagnoli): what verifies streams of frames. Finds faults; it is no defence against somebody
// who wants to deceive (that is SHA-256's task).
#pragma once

#include <cstdint>
#include <span>

namespace etude::bus {

/// Runs at a good part of the cache's speed where the CPU multiplies without carries.
std::uint32_t Crc32c(std::span<const std::uint8_t> bytes);

namespace internal {
/// The same, one byte at a time: for other CPUs, and to compare with.
std::uint32_t Crc32cPortable(std::span<const std::uint8_t> bytes);
}  // namespace internal

}  // namespace etude::bus
