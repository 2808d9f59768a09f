// SPDX-License-Identifier: Apache-2.0
#include "services/bus/assembly.h"

#include <sys/mman.h>

#include <algorithm>

#include "services/bus/blob_transfer.h"

namespace etude::bus {

std::uint32_t ChunkCount(std::uint64_t size, std::uint32_t chunk_size) {
  return static_cast<std::uint32_t>((size + chunk_size - 1) / chunk_size);
}

bool ShapeIsSound(std::uint64_t size, std::uint32_t chunk_size, std::uint32_t chunk_count) {
  constexpr std::uint64_t kMaxSize = 1ull << 40;
  return chunk_size > 0 && chunk_size <= kMaxChunkSize && size <= kMaxSize &&
         (size + chunk_size - 1) / chunk_size == chunk_count;
}

std::span<const std::uint8_t> ChunkOf(std::span<const std::uint8_t> bytes, std::uint32_t chunk_size,
                                      std::uint32_t index) {
  const std::size_t begin = std::size_t{index} * chunk_size;
  return bytes.subspan(begin, std::min<std::size_t>(chunk_size, bytes.size() - begin));
}

namespace {

// A fresh blob is touched page by page as it arrives: with pages of 2 MiB the kernel is asked 20 times for
// 40 MB instead of 10,000. Only a hint.
void UseHugePages([[maybe_unused]] std::uint8_t* data, [[maybe_unused]] std::uint64_t size) {
#ifdef MADV_HUGEPAGE
  constexpr std::uintptr_t kPage = 4096;
  constexpr std::uint64_t kWorthIt = 8u << 20;
  if (size < kWorthIt) return;
  const auto begin = (reinterpret_cast<std::uintptr_t>(data) + kPage - 1) / kPage * kPage;
  const auto end = (reinterpret_cast<std::uintptr_t>(data) + size) / kPage * kPage;
  ::madvise(reinterpret_cast<void*>(begin), end - begin, MADV_HUGEPAGE);
#endif
}

}  // namespace

Assembly::Assembly(std::uint64_t size, std::uint32_t chunk_size)
    : size_(size), chunk_size_(chunk_size), count_(ChunkCount(size, chunk_size)) {
  bytes_.reserve(size);
  UseHugePages(bytes_.data(), size);
}

Assembly::Added Assembly::Add(std::uint32_t index, std::span<const std::uint8_t> data) {
  if (index >= count_) return Added::kMalformed;
  const std::uint64_t begin = std::uint64_t{index} * chunk_size_;
  if (data.size() != std::min<std::uint64_t>(chunk_size_, size_ - begin)) return Added::kMalformed;
  if (index < next_ || early_.contains(index)) return Added::kRepeat;
  if (index > next_) {
    early_.emplace(index, std::vector<std::uint8_t>(data.begin(), data.end()));
    return Added::kNew;
  }
  Append(data);
  for (auto it = early_.begin(); it != early_.end() && it->first == next_; it = early_.erase(it)) {
    Append(it->second);
  }
  return Added::kNew;
}

void Assembly::Append(std::span<const std::uint8_t> data) {
  hash_.Update(data);
  bytes_.insert(bytes_.end(), data.begin(), data.end());
  ++next_;
}

std::vector<std::uint32_t> Assembly::Missing(std::size_t at_most) const {
  std::vector<std::uint32_t> missing;
  for (std::uint32_t i = next_; i < count_ && missing.size() < at_most; ++i) {
    if (!early_.contains(i)) missing.push_back(i);
  }
  return missing;
}

}  // namespace etude::bus
