// SPDX-License-Identifier: Apache-2.0
#include "services/bus/wire.h"

#include <fmt/format.h>

#include "services/bus/assembly.h"

namespace etude::bus {

bool Encoder::CheckText(const char* name, const std::string& text, std::size_t bound) {
  if (text.size() > bound) {
    Refuse(name, text.size(), bound);
    return false;
  }
  if (text.find('\0') != std::string::npos) {
    problem_ = fmt::format("{} contains a NUL byte", name);
    return false;
  }
  return true;
}

void Encoder::Refuse(const char* name, std::size_t size, std::size_t bound) {
  problem_ = fmt::format("{} has {} bytes or items, at most {} fit", name, size, bound);
}

bool IsSound(const BlobManifest& manifest) {
  return manifest.sha256.size() == 32 && ShapeIsSound(manifest.size, manifest.chunk_size, manifest.chunk_count) &&
         (manifest.data.empty() || manifest.data.size() == manifest.size);
}

bool IsSound(const BlobChunk& chunk) { return !chunk.data.empty(); }

bool IsSound(const Observation& observation) {
  constexpr std::uint32_t kMaxSide = 4096;
  return observation.width <= kMaxSide && observation.height <= kMaxSide &&
         observation.image.size() == std::size_t{3} * observation.width * observation.height &&
         (observation.intrinsics.empty() || observation.intrinsics.size() == 4) &&
         (observation.camera_pose.empty() || observation.camera_pose.size() == 7);
}

}  // namespace etude::bus
