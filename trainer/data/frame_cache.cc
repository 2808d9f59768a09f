// SPDX-License-Identifier: Apache-2.0
#include "trainer/data/frame_cache.h"

#include <fmt/format.h>

#include <algorithm>

namespace etude::data {
namespace {
constexpr std::size_t kRegionsPerSlab = 64;
}

FrameCache::Slots& FrameCache::SlotsOf(const EpisodeEntry& entry) {
  const MutexLock lock(slots_mutex_);
  auto& slots = slots_[entry.number()];
  if (!slots) slots = std::make_unique<Slots>(entry.record.frames.at(0).size());
  return *slots;
}

std::uint8_t* FrameCache::Allocate() {
  const MutexLock lock(slabs_mutex_);
  if (bytes_ + region_.bytes() > max_bytes_) return nullptr;
  if (slabs_.empty() || used_in_slab_ == kRegionsPerSlab) {
    slabs_.push_back(std::make_unique_for_overwrite<std::uint8_t[]>(kRegionsPerSlab * region_.bytes()));
    used_in_slab_ = 0;
  }
  bytes_ += region_.bytes();
  return slabs_.back().get() + region_.bytes() * used_in_slab_++;
}

// Keeps the regions of a block's frames that are not kept yet, as long as there is room.
Status FrameCache::Keep(Slots& slots, std::size_t first, std::span<const std::uint8_t> block,
                        const codec::FrameLayout& layout) {
  const std::size_t end = std::min(slots.pixels.size(), first + static_cast<std::size_t>(layout.chunk.frames));
  std::uint8_t* kept = nullptr;
  for (std::size_t k = first; k < end; ++k) {
    auto& slot = slots.pixels[k];
    if (slot.load(std::memory_order_relaxed) != nullptr) continue;
    if (kept == nullptr) kept = Allocate();
    if (kept == nullptr) break;
    ETUDE_RETURN_IF_ERROR(
        codec::CropPicture(layout.FrameIn(block, k), layout.width, layout.height, region_, {kept, region_.bytes()}));
    // two threads may have decoded the same block: the first copy stays, the other's room is for the next frame
    const std::uint8_t* expected = nullptr;
    if (slot.compare_exchange_strong(expected, kept, std::memory_order_acq_rel)) kept = nullptr;
  }
  return {};
}

Result<const std::uint8_t*> FrameCache::Get(const EpisodeEntry& entry, std::uint32_t frame, FrameScratch& scratch) {
  Slots& slots = SlotsOf(entry);
  auto& slot = slots.pixels.at(frame);
  if (const auto* pixels = slot.load(std::memory_order_acquire)) {
    ++hits_;
    return pixels;
  }
  ++misses_;
  const store::StoredFrames& frames = entry.record.frames.at(0);
  const codec::FrameLayout& layout = frames.layout;
  if (!codec::Fits(region_, layout.width, layout.height))
    return Fail(Code::kInvalidArgument,
                fmt::format("image.crop of the policy: {}x{} px at ({}, {}) does not fit pictures of {}x{} px",
                            region_.width, region_.height, region_.u, region_.v, layout.width, layout.height));
  const std::size_t block = layout.block_of(frame);
  ETUDE_RETURN_IF_ERROR(store::FrameReader::ReadBlock(entry.record.path, frames, block, scratch.block));
  ETUDE_RETURN_IF_ERROR(Keep(slots, block * static_cast<std::size_t>(layout.chunk.frames), scratch.block, layout));
  if (const auto* pixels = slot.load(std::memory_order_acquire)) return pixels;
  scratch.region.resize(region_.bytes());
  ETUDE_RETURN_IF_ERROR(
      codec::CropPicture(layout.FrameIn(scratch.block, frame), layout.width, layout.height, region_, scratch.region));
  return scratch.region.data();
}

}  // namespace etude::data
