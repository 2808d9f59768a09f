// SPDX-License-Identifier: Apache-2.0
#include "services/codec/frame.h"

#include <fcntl.h>
#include <fmt/format.h>

#include <cerrno>

#include "services/core/descriptor.h"
#include "services/core/file.h"
#include "services/store/dataset.h"

namespace etude::store {
namespace {

constexpr std::uint64_t kMaxOffset = 1ull << 60;

// More than any zlib stream of `size` bytes takes.
std::uint64_t StreamBound(std::size_t size) { return size + size / 256 + 64; }

}  // namespace

Status FrameReader::Read(const Path& file, const FrameLocation& location, std::span<std::uint8_t> pixels) {
  if (location.size > StreamBound(pixels.size()) || location.offset > kMaxOffset)
    return Fail(Code::kCorrupt, fmt::format("read '{}': a frame of {} bytes at {} for {} of pixels", file.string(),
                                            location.size, location.offset, pixels.size()));
  thread_local std::vector<std::uint8_t> stream;
  stream.resize(location.size);
  const Descriptor open(::open(file.c_str(), O_RDONLY | O_CLOEXEC));
  if (!open) return Fail(ErrnoError("open", file, errno));
  ETUDE_ASSIGN_OR_RETURN(const std::size_t size, ReadAt(open.get(), file, location.offset, stream));
  if (size < stream.size())
    return Fail(Code::kCorrupt,
                fmt::format("read '{}': it ends at {} inside a frame", file.string(), location.offset + size));
  if (Status inflated = codec::InflateFrame(stream, pixels); !inflated)
    return Fail(inflated.error().Wrap(fmt::format("'{}' at {}", file.string(), location.offset)));
  return {};
}

}  // namespace etude::store
