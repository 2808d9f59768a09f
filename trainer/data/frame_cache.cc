// SPDX-License-Identifier: Apache-2.0
#include "trainer/data/frame_cache.h"

#include <fmt/format.h>

namespace etude::data {
namespace {
constexpr std::size_t kRegionsPerBlock = 64;
}

FrameCache::Slots& FrameCache::SlotsOf(const EpisodeEntry& entry) {
  const MutexLock lock(slots_mutex_);
  auto& slots = slots_[entry.number()];
  if (!slots) slots = std::make_unique<Slots>(entry.record.frames.at(0).size());
  return *slots;
}

std::uint8_t* FrameCache::Allocate() {
  const MutexLock lock(blocks_mutex_);
  if (bytes_ + region_.bytes() > max_bytes_) return nullptr;
  if (blocks_.empty() || used_in_block_ == kRegionsPerBlock) {
    blocks_.push_back(std::make_unique_for_overwrite<std::uint8_t[]>(kRegionsPerBlock * region_.bytes()));
    used_in_block_ = 0;
  }
  bytes_ += region_.bytes();
  return blocks_.back().get() + region_.bytes() * used_in_block_++;
}

Result<const std::uint8_t*> FrameCache::Get(const EpisodeEntry& entry, std::uint32_t frame, FrameScratch& scratch) {
  auto& slot = SlotsOf(entry).pixels.at(frame);
  if (const auto* pixels = slot.load(std::memory_order_acquire)) {
    ++hits_;
    return pixels;
  }
  ++misses_;
  const Camera& camera = entry.episode().cameras.at(0).camera;
  if (!codec::Fits(region_, camera.width, camera.height))
    return Fail(Code::kInvalidArgument,
                fmt::format("image.crop of the policy: {}x{} px at ({}, {}) does not fit pictures of {}x{} px",
                            region_.width, region_.height, region_.u, region_.v, camera.width, camera.height));
  scratch.whole.resize(static_cast<std::size_t>(camera.width) * camera.height * 3);
  ETUDE_RETURN_IF_ERROR(store::FrameReader::Read(entry.record.path, entry.record.frames[0].at(frame), scratch.whole));

  std::uint8_t* kept = Allocate();
  scratch.region.resize(region_.bytes());
  std::uint8_t* out = kept ? kept : scratch.region.data();
  ETUDE_RETURN_IF_ERROR(
      codec::CropPicture(scratch.whole, camera.width, camera.height, region_, {out, region_.bytes()}));
  // two threads may have decoded the same frame: the first stays, the other copy is only wasted
  // room
  const std::uint8_t* expected = nullptr;
  if (kept && !slot.compare_exchange_strong(expected, kept, std::memory_order_acq_rel)) return expected;
  return out;
}

}  // namespace etude::data
