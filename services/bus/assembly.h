// SPDX-License-Identifier: Apache-2.0
// A blob while its chunks arrive. Internal to services/bus.
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <vector>

#include "services/core/hash.h"

namespace etude::bus {

/// True when size, chunk size and count fit together and the chunk size is allowed.
bool ShapeIsSound(std::uint64_t size, std::uint32_t chunk_size, std::uint32_t chunk_count);
/// Chunks of a blob; 0 for an empty one. `chunk_size` > 0.
std::uint32_t ChunkCount(std::uint64_t size, std::uint32_t chunk_size);
/// The part of `bytes` that is chunk `index`.
std::span<const std::uint8_t> ChunkOf(std::span<const std::uint8_t> bytes, std::uint32_t chunk_size,
                                      std::uint32_t index);

/// Appends chunks in order and hashes them while they are in the cache. Chunks that arrive too early
/// wait beside; that happens only around lost connections. Not thread-safe.
class Assembly {
 public:
  enum class Added { kNew, kRepeat, kMalformed };

  /// The shape must be sound. Memory is reserved here, touched as chunks come.
  Assembly(std::uint64_t size, std::uint32_t chunk_size);

  Added Add(std::uint32_t index, std::span<const std::uint8_t> data);

  bool complete() const { return next_ == count_; }
  std::uint32_t next() const { return next_; }  ///< chunks received in order from 0
  std::uint32_t count() const { return count_; }
  std::uint64_t size() const { return size_; }
  std::uint32_t chunk_size() const { return chunk_size_; }
  /// Indices not received yet, the smallest `at_most` ones.
  std::vector<std::uint32_t> Missing(std::size_t at_most) const;

  /// Both once, when complete.
  Sha256Digest Digest() { return hash_.Finish(); }
  std::vector<std::uint8_t> TakeBytes() { return std::move(bytes_); }

 private:
  void Append(std::span<const std::uint8_t> data);

  std::uint64_t size_;
  std::uint32_t chunk_size_;
  std::uint32_t count_;
  std::uint32_t next_ = 0;
  std::vector<std::uint8_t> bytes_;
  std::map<std::uint32_t, std::vector<std::uint8_t>> early_;
  Sha256 hash_;
};

}  // namespace etude::bus
