// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <fmt/format.h>

#include <cerrno>

#include "services/codec/deflate.h"
#include "services/core/check.h"
#include "services/core/descriptor.h"
#include "services/core/file.h"
#include "services/store/dataset.h"

namespace etude::store {
namespace {

constexpr std::uint64_t kMaxOffset = 1ull << 60;

// The bytes of streams that follow each other in the file, as those of a block that was written here do.
struct Run {
  std::uint64_t offset = 0, size = 0;
};

std::vector<Run> RunsOf(std::span<const StreamLocation> streams) {
  std::vector<Run> runs;
  for (const auto& stream : streams) {
    if (runs.empty() || runs.back().offset + runs.back().size != stream.offset) runs.push_back({stream.offset, 0});
    runs.back().size += stream.size;
  }
  return runs;
}

// Where the streams lie in `bytes`, which get them one after the other.
Result<std::vector<std::span<const std::uint8_t>>> ReadStreams(const Path& file,
                                                               std::span<const StreamLocation> streams,
                                                               std::vector<std::uint8_t>& bytes) {
  std::size_t total = 0;
  for (const auto& stream : streams) total += stream.size;
  bytes.resize(total);
  const Descriptor open(::open(file.c_str(), O_RDONLY | O_CLOEXEC));
  if (!open) return Fail(ErrnoError("open", file, errno));
  std::span<std::uint8_t> left = bytes;
  for (const auto& [offset, size] : RunsOf(streams)) {
    ETUDE_ASSIGN_OR_RETURN(const std::size_t got, ReadAt(open.get(), file, offset, left.first(size)));
    if (got < size)
      return Fail(Code::kCorrupt, fmt::format("read '{}': it ends at {} inside a frame", file.string(), offset + got));
    left = left.subspan(size);
  }
  std::vector<std::span<const std::uint8_t>> spans;
  std::span<const std::uint8_t> rest = bytes;
  for (const auto& stream : streams) {
    spans.push_back(rest.first(stream.size));
    rest = rest.subspan(stream.size);
  }
  return spans;
}

}  // namespace

Status FrameReader::ReadBlock(const Path& file, const StoredFrames& frames, std::size_t block,
                              std::vector<std::uint8_t>& pixels) {
  const codec::FrameLayout& layout = frames.layout;
  ETUDE_CHECK(block < layout.blocks(frames.count) && frames.streams.size() == layout.streams(frames.count),
              "block {} of {} frames", block, frames.count);
  const auto streams =
      std::span(frames.streams).subspan(layout.first_stream(block), static_cast<std::size_t>(layout.bands()));
  for (const auto& [offset, size] : streams)
    if (size > codec::StreamBound(layout.stream_bytes()) || offset > kMaxOffset)
      return Fail(Code::kCorrupt, fmt::format("read '{}': a stream of {} bytes at {} for {} of pixels", file.string(),
                                              size, offset, layout.stream_bytes()));
  std::vector<std::uint8_t> bytes;
  ETUDE_ASSIGN_OR_RETURN(const auto spans, ReadStreams(file, streams, bytes));
  pixels.resize(layout.block_bytes());
  if (Status inflated = codec::InflateBlock(layout, spans, pixels); !inflated)
    return Fail(inflated.error().Wrap(fmt::format("'{}' at {}", file.string(), streams[0].offset)));
  return {};
}

Result<std::span<const std::uint8_t>> FrameReader::Read(std::size_t k) {
  ETUDE_CHECK(k < frames_.count, "{} of {}", k, frames_.count);
  return cursor_.Frame(k, [&](std::size_t block, std::vector<std::uint8_t>& pixels) {
    return ReadBlock(file_, frames_, block, pixels);
  });
}

}  // namespace etude::store
