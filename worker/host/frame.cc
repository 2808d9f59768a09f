// SPDX-License-Identifier: Apache-2.0
#include "worker/host/frame.h"

#include <fmt/format.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <string>
#include <utility>

#include "services/core/file.h"
#include "services/episode/bounded_json.h"

namespace etude::host {
namespace {

constexpr std::array<std::uint8_t, 4> kMagic{'E', 't', 'd', 'F'};
constexpr int kDeepestHead = kMaxJsonDepth + 2;  // a head holds what was bounded itself

template <class Number>
void Put(Number number, std::uint8_t* to) {
  for (std::size_t k = 0; k < sizeof number; ++k) to[k] = static_cast<std::uint8_t>(number >> (8 * k));
}

template <class Number>
Number Get(const std::uint8_t* from) {
  Number number = 0;
  for (std::size_t k = 0; k < sizeof number; ++k) number |= static_cast<Number>(from[k]) << (8 * k);
  return number;
}

std::uint32_t HeadSize(const std::vector<std::uint8_t>& buffer) { return Get<std::uint32_t>(buffer.data() + 8); }
std::uint64_t BytesSize(const std::vector<std::uint8_t>& buffer) { return Get<std::uint64_t>(buffer.data() + 12); }

}  // namespace

std::array<std::uint8_t, kFrameHeader> FrameHeader(FrameKind kind, std::uint32_t head_size, std::uint64_t bytes_size) {
  std::array<std::uint8_t, kFrameHeader> header{};
  std::copy(kMagic.begin(), kMagic.end(), header.begin());
  header[4] = static_cast<std::uint8_t>(kind);
  Put(head_size, header.data() + 8);
  Put(bytes_size, header.data() + 12);
  return header;
}

Status FrameDecoder::CheckHeader() const {
  const bool known = buffer_[4] >= static_cast<std::uint8_t>(FrameKind::kCampaign) &&
                     buffer_[4] <= static_cast<std::uint8_t>(FrameKind::kFailure);
  const bool zeros = buffer_[5] == 0 && buffer_[6] == 0 && buffer_[7] == 0;
  if (!std::equal(kMagic.begin(), kMagic.end(), buffer_.begin()) || !known || !zeros)
    return Fail(Code::kCorrupt, fmt::format("read a frame: its header is none (kind {})", buffer_[4]));
  if (HeadSize(buffer_) > kLongestHead || BytesSize(buffer_) > kMostBytes)
    return Fail(Code::kCorrupt, fmt::format("read a frame: {} and {} bytes, at most {} and {} may be",
                                            HeadSize(buffer_), BytesSize(buffer_), kLongestHead, kMostBytes));
  return {};
}

Status FrameDecoder::Add(std::span<const std::uint8_t> bytes) {
  buffer_.insert(buffer_.end(), bytes.begin(), bytes.end());
  return buffer_.size() < kFrameHeader ? Status() : CheckHeader();
}

Result<std::optional<Frame>> FrameDecoder::Next() {
  if (buffer_.size() < kFrameHeader) return std::nullopt;
  ETUDE_RETURN_IF_ERROR(CheckHeader());
  const std::size_t head_size = HeadSize(buffer_);
  const std::size_t end = kFrameHeader + head_size + BytesSize(buffer_);
  if (buffer_.size() < end) return std::nullopt;
  const std::string text(buffer_.begin() + kFrameHeader,
                         buffer_.begin() + static_cast<std::ptrdiff_t>(kFrameHeader + head_size));
  auto head = ParseBoundedJson(text, kDeepestHead);
  if (!head || !head->is_object()) return Fail(Code::kCorrupt, "read a frame: its head is no JSON object");
  Frame frame{static_cast<FrameKind>(buffer_[4]), std::move(*head), {}};
  frame.bytes.assign(buffer_.begin() + static_cast<std::ptrdiff_t>(kFrameHeader + head_size),
                     buffer_.begin() + static_cast<std::ptrdiff_t>(end));
  buffer_.erase(buffer_.begin(), buffer_.begin() + static_cast<std::ptrdiff_t>(end));
  return std::optional<Frame>(std::move(frame));
}

namespace {

Status WriteAll(int fd, const std::uint8_t* data, std::size_t size) {
  while (size > 0) {
    const ssize_t sent = ::send(fd, data, size, MSG_NOSIGNAL);
    if (sent < 0 && errno == EINTR) continue;
    if (sent < 0 && (errno == EAGAIN || errno == EWOULDBLOCK))
      return Fail(Code::kTimeout, "write a frame: the other end does not read");
    if (sent < 0) return Fail(Code::kUnavailable, fmt::format("write a frame: {}", std::strerror(errno)));
    data += sent;
    size -= static_cast<std::size_t>(sent);
  }
  return {};
}

}  // namespace

Status Channel::Send(FrameKind kind, const OrderedJson& head, std::span<const std::uint8_t> bytes) {
  const std::string text = JsonText(head);
  if (text.size() > kLongestHead || bytes.size() > kMostBytes)
    return Fail(Code::kInvalidArgument,
                fmt::format("write a frame: {} and {} bytes are too many", text.size(), bytes.size()));
  const auto header = FrameHeader(kind, static_cast<std::uint32_t>(text.size()), bytes.size());
  ETUDE_RETURN_IF_ERROR(WriteAll(socket_.get(), header.data(), header.size()));
  ETUDE_RETURN_IF_ERROR(WriteAll(socket_.get(), reinterpret_cast<const std::uint8_t*>(text.data()), text.size()));
  return WriteAll(socket_.get(), bytes.data(), bytes.size());
}

Result<std::optional<Frame>> Channel::Receive(std::chrono::milliseconds timeout) {
  ETUDE_ASSIGN_OR_RETURN(auto ready, decoder_.Next());
  if (ready) return ready;
  pollfd readable{socket_.get(), POLLIN, 0};
  if (::poll(&readable, 1, static_cast<int>(timeout.count())) <= 0) return std::nullopt;
  std::vector<std::uint8_t> chunk(256 << 10);
  const ssize_t got = ::recv(socket_.get(), chunk.data(), chunk.size(), MSG_DONTWAIT);
  if (got < 0 && (errno == EINTR || errno == EAGAIN)) return std::nullopt;
  if (got < 0) return Fail(Code::kUnavailable, fmt::format("read a frame: {}", std::strerror(errno)));
  if (got == 0) return Fail(Code::kUnavailable, "read a frame: the other end has gone");
  ETUDE_RETURN_IF_ERROR(decoder_.Add(std::span(chunk).first(static_cast<std::size_t>(got))));
  return decoder_.Next();
}

void Channel::LimitSend(std::chrono::milliseconds timeout) {
  timeval limit{};
  limit.tv_sec = timeout.count() / 1000;
  limit.tv_usec = 1000 * (timeout.count() % 1000);
  ::setsockopt(socket_.get(), SOL_SOCKET, SO_SNDTIMEO, &limit, sizeof limit);
}

Result<std::array<int, 2>> MakeSocketPair() {
  std::array<int, 2> ends{};
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) == 0) return ends;
  return Fail(ErrnoError("make", "a socket pair for a child", errno));
}

}  // namespace etude::host
