// SPDX-License-Identifier: Apache-2.0
#include "services/codec/checksum.h"

#include <libdeflate.h>

namespace etude::codec {

std::uint32_t Crc32(std::uint32_t before, std::span<const std::uint8_t> bytes) {
  return libdeflate_crc32(before, bytes.data(), bytes.size());
}

}  // namespace etude::codec
