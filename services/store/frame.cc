// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <fmt/format.h>
#include <libdeflate.h>
#include <unistd.h>

#include <cerrno>
#include <memory>

#include "services/core/check.h"
#include "services/store/dataset.h"

namespace etude::store {
namespace {

// The fastest: a frame is deflated in the worker's loop, between two steps of the simulation.
constexpr int kDeflateLevel = 1;

struct FreeCompressor {
  void operator()(libdeflate_compressor* c) const { libdeflate_free_compressor(c); }
};
struct FreeDecompressor {
  void operator()(libdeflate_decompressor* d) const { libdeflate_free_decompressor(d); }
};

constexpr std::uint64_t kMaxOffset = 1ull << 60;

// More than any zlib stream of `size` bytes takes.
std::uint64_t StreamBound(std::size_t size) { return size + size / 256 + 64; }

Status ReadAt(const Path& file, std::uint64_t offset, std::span<std::uint8_t> bytes) {
  const int fd = ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) return Fail(ErrnoError("open", file, errno));
  std::size_t done = 0;
  int error_number = 0;
  while (done < bytes.size()) {
    const ssize_t got = ::pread(fd, bytes.data() + done, bytes.size() - done, static_cast<off_t>(offset + done));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) error_number = errno;
    if (got <= 0) break;
    done += static_cast<std::size_t>(got);
  }
  ::close(fd);
  if (error_number != 0) return Fail(ErrnoError("read", file, error_number));
  if (done < bytes.size())
    return Fail(Code::kCorrupt, fmt::format("read '{}': it ends at {} inside a frame", file.string(), offset + done));
  return {};
}

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

Status FrameReader::Read(const Path& file, const FrameLocation& location, std::span<std::uint8_t> pixels) {
  if (location.size > StreamBound(pixels.size()) || location.offset > kMaxOffset)
    return Fail(Code::kCorrupt, fmt::format("read '{}': a frame of {} bytes at {} for {} of pixels", file.string(),
                                            location.size, location.offset, pixels.size()));
  thread_local std::vector<std::uint8_t> stream;
  stream.resize(location.size);
  ETUDE_RETURN_IF_ERROR(ReadAt(file, location.offset, stream));
  if (Status inflated = InflateFrame(stream, pixels); !inflated)
    return Fail(inflated.error().Wrap(fmt::format("'{}' at {}", file.string(), location.offset)));
  return {};
}

}  // namespace etude::store
