// SPDX-License-Identifier: Apache-2.0
// Decoded crops in memory. A hit costs nothing; a miss reads a block of frames (services/codec/frames.h), inflates it
// once and keeps the crops of all of them.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <span>
#include <unordered_map>
#include <vector>

#include "services/codec/crop.h"
#include "services/codec/frames.h"
#include "services/core/thread_annotations.h"
#include "trainer/data/dataset.h"

namespace etude::data {

using codec::Region;

/// Buffers of one thread.
struct FrameScratch {
  std::vector<std::uint8_t> block, region;
};

/// Keeps what it decoded until `max_bytes` are used, then keeps what it has: with uniform sampling
/// no replacement strategy has more hits (those that nobody draws are kept with their block). Thread-safe.
class FrameCache {
 public:
  /// `region` of every picture of the first camera.
  FrameCache(Region region, std::size_t max_bytes) : region_(region), max_bytes_(max_bytes) {}

  const Region& region() const { return region_; }
  /// Pixels of the region, (height, width, 3) row-major; valid while the cache lives, or until
  /// `scratch` is used again. @error kCorrupt, kNotFound from reading; kInvalidArgument when the
  /// picture is too small.
  Result<const std::uint8_t*> Get(const EpisodeEntry& entry, std::uint32_t frame, FrameScratch& scratch);

  std::size_t bytes() const { return bytes_; }
  std::uint64_t hits() const { return hits_; }
  std::uint64_t misses() const { return misses_; }

 private:
  struct Slots {
    explicit Slots(std::size_t n) : pixels(n) {}
    std::vector<std::atomic<const std::uint8_t*>> pixels;
  };
  Slots& SlotsOf(const EpisodeEntry& entry) ETUDE_EXCLUDES(slots_mutex_);
  std::uint8_t* Allocate() ETUDE_EXCLUDES(slabs_mutex_);
  Status Keep(Slots& slots, std::size_t first, std::span<const std::uint8_t> block, const codec::FrameLayout& layout);

  Region region_;
  std::size_t max_bytes_;
  Mutex slots_mutex_;
  std::unordered_map<std::uint64_t, std::unique_ptr<Slots>> slots_ ETUDE_GUARDED_BY(slots_mutex_);
  Mutex slabs_mutex_;
  std::vector<std::unique_ptr<std::uint8_t[]>> slabs_ ETUDE_GUARDED_BY(slabs_mutex_);
  std::size_t used_in_slab_ ETUDE_GUARDED_BY(slabs_mutex_) = 0;
  std::atomic<std::size_t> bytes_{0};
  std::atomic<std::uint64_t> hits_{0}, misses_{0};
};

}  // namespace etude::data
