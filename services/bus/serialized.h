// SPDX-License-Identifier: Apache-2.0
// Reading chunks where Cyclone DDS holds them: taking them as C structs would copy every byte once
// more. Cyclone has already validated the bytes against the type; the cursor checks again. Internal to
// services/bus.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string_view>

#include "services/bus/participant_state.h"

namespace etude::bus {

struct ManifestView {
  std::uint64_t id = 0;
  std::uint64_t size = 0;
  std::uint64_t token = 0;
  std::uint32_t chunk_size = 0;
  std::uint32_t chunk_count = 0;
  std::string_view channel;
  std::string_view sender;
  std::string_view owner;
  std::span<const std::uint8_t> sha256;
  std::string_view meta_json;
  std::span<const std::uint8_t> data;
  std::string_view host;
};

struct ChunkView {
  std::uint64_t id = 0;
  std::uint32_t index = 0;
  std::string_view channel;
  std::string_view sender;
  std::span<const std::uint8_t> data;
};

struct PublishedChunkView {
  std::uint64_t version = 0;
  std::uint64_t size = 0;
  std::uint32_t chunk_size = 0;
  std::uint32_t index = 0;
  std::uint8_t slot = 0;
  std::string_view channel;
  std::string_view publisher;
  std::span<const std::uint8_t> data;
};

// `cdr` is a serialised sample with its 4-byte header; views point into it. False when malformed.
bool Parse(std::span<const std::uint8_t> cdr, ManifestView& view);
bool Parse(std::span<const std::uint8_t> cdr, ChunkView& view);
bool Parse(std::span<const std::uint8_t> cdr, PublishedChunkView& view);

/// Takes up to `at_most` samples and shows the bytes of each to `visit`, for as long as the call lasts. Returns how
/// many were taken, those without data included.
int TakeSerialized(const Endpoint& reader, int at_most,
                   const std::function<void(std::span<const std::uint8_t>)>& visit);

}  // namespace etude::bus
