// SPDX-License-Identifier: Apache-2.0
#include "services/codec/frame.h"

#include <fmt/format.h>
#include <libdeflate.h>

#include <memory>

#include "services/core/check.h"

namespace etude::codec {
namespace {

// The fastest: a frame is deflated in the worker's loop, between two steps of the simulation.
constexpr int kDeflateLevel = 1;

struct FreeCompressor {
  void operator()(libdeflate_compressor* c) const { libdeflate_free_compressor(c); }
};
struct FreeDecompressor {
  void operator()(libdeflate_decompressor* d) const { libdeflate_free_decompressor(d); }
};

}  // namespace

Status InflateFrame(std::span<const std::uint8_t> stream, std::span<std::uint8_t> pixels) {
  thread_local const std::unique_ptr<libdeflate_decompressor, FreeDecompressor> decompressor(
      libdeflate_alloc_decompressor());
  ETUDE_CHECK(decompressor != nullptr);
  std::size_t used = 0;
  std::size_t made = 0;
  const libdeflate_result result = libdeflate_zlib_decompress_ex(decompressor.get(), stream.data(), stream.size(),
                                                                 pixels.data(), pixels.size(), &used, &made);
  if (result != LIBDEFLATE_SUCCESS || used != stream.size() || made != pixels.size())
    return Fail(Code::kCorrupt,
                fmt::format("inflate a frame: {} bytes are not a zlib stream of {}", stream.size(), pixels.size()));
  return {};
}

std::vector<std::uint8_t> DeflateFrame(std::span<const std::uint8_t> pixels) {
  thread_local const std::unique_ptr<libdeflate_compressor, FreeCompressor> compressor(
      libdeflate_alloc_compressor(kDeflateLevel));
  ETUDE_CHECK(compressor != nullptr);
  std::vector<std::uint8_t> stream(libdeflate_zlib_compress_bound(compressor.get(), pixels.size()));
  const std::size_t size =
      libdeflate_zlib_compress(compressor.get(), pixels.data(), pixels.size(), stream.data(), stream.size());
  ETUDE_CHECK(size > 0, "{} bytes into {}", pixels.size(), stream.size());
  stream.resize(size);
  return stream;
}

}  // namespace etude::codec
