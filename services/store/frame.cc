// SPDX-License-Identifier: Apache-2.0
#include "services/codec/frame.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>

#include "services/core/descriptor.h"
#include "services/store/dataset.h"

namespace etude::store {
namespace {

constexpr std::uint64_t kMaxOffset = 1ull << 60;

// More than any zlib stream of `size` bytes takes.
std::uint64_t StreamBound(std::size_t size) { return size + size / 256 + 64; }

Status ReadAt(const Path& file, std::uint64_t offset, std::span<std::uint8_t> bytes) {
  const Descriptor open(::open(file.c_str(), O_RDONLY | O_CLOEXEC));
  if (!open) return Fail(ErrnoError("open", file, errno));
  std::size_t done = 0;
  int error_number = 0;
  while (done < bytes.size()) {
    const ssize_t got =
        ::pread(open.get(), bytes.data() + done, bytes.size() - done, static_cast<off_t>(offset + done));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) error_number = errno;
    if (got <= 0) break;
    done += static_cast<std::size_t>(got);
  }
  if (error_number != 0) return Fail(ErrnoError("read", file, error_number));
  if (done < bytes.size())
    return Fail(Code::kCorrupt, fmt::format("read '{}': it ends at {} inside a frame", file.string(), offset + done));
  return {};
}

}  // namespace

Status FrameReader::Read(const Path& file, const FrameLocation& location, std::span<std::uint8_t> pixels) {
  if (location.size > StreamBound(pixels.size()) || location.offset > kMaxOffset)
    return Fail(Code::kCorrupt, fmt::format("read '{}': a frame of {} bytes at {} for {} of pixels", file.string(),
                                            location.size, location.offset, pixels.size()));
  thread_local std::vector<std::uint8_t> stream;
  stream.resize(location.size);
  ETUDE_RETURN_IF_ERROR(ReadAt(file, location.offset, stream));
  if (Status inflated = codec::InflateFrame(stream, pixels); !inflated)
    return Fail(inflated.error().Wrap(fmt::format("'{}' at {}", file.string(), location.offset)));
  return {};
}

}  // namespace etude::store
