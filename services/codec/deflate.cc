// SPDX-License-Identifier: Apache-2.0
#include "services/codec/deflate.h"

#include <fmt/format.h>
#include <libdeflate.h>

#include <memory>

#include "services/core/check.h"

namespace etude::codec {
namespace {

// Pictures are deflated in the worker's loop, between two steps of the simulation. Of blocks of them (frames.h) level 2
// makes a tenth less than level 1 in two thirds of its time; higher ones take longer for 2 % less.
constexpr int kDeflateLevel = 2;

struct FreeCompressor {
  void operator()(libdeflate_compressor* c) const { libdeflate_free_compressor(c); }
};
struct FreeDecompressor {
  void operator()(libdeflate_decompressor* d) const { libdeflate_free_decompressor(d); }
};

}  // namespace

std::vector<std::uint8_t> Deflate(std::span<const std::uint8_t> bytes) {
  thread_local const std::unique_ptr<libdeflate_compressor, FreeCompressor> compressor(
      libdeflate_alloc_compressor(kDeflateLevel));
  ETUDE_CHECK(compressor != nullptr);
  std::vector<std::uint8_t> stream(libdeflate_zlib_compress_bound(compressor.get(), bytes.size()));
  const std::size_t size =
      libdeflate_zlib_compress(compressor.get(), bytes.data(), bytes.size(), stream.data(), stream.size());
  ETUDE_CHECK(size > 0, "{} into {}", bytes.size(), stream.size());
  stream.resize(size);
  return stream;
}

Status Inflate(std::span<const std::uint8_t> stream, std::span<std::uint8_t> bytes) {
  thread_local const std::unique_ptr<libdeflate_decompressor, FreeDecompressor> decompressor(
      libdeflate_alloc_decompressor());
  ETUDE_CHECK(decompressor != nullptr);
  std::size_t used = 0;
  std::size_t made = 0;
  const libdeflate_result result = libdeflate_zlib_decompress_ex(decompressor.get(), stream.data(), stream.size(),
                                                                 bytes.data(), bytes.size(), &used, &made);
  if (result != LIBDEFLATE_SUCCESS || used != stream.size() || made != bytes.size())
    return Fail(Code::kCorrupt,
                fmt::format("inflate: {} bytes are not a zlib stream of {}", stream.size(), bytes.size()));
  return {};
}

}  // namespace etude::codec
