// SPDX-License-Identifier: Apache-2.0
#include "trainer/learn/event_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <array>
#include <bit>
#include <cerrno>
#include <cstring>
#include <string_view>
#include <utility>

#include "services/core/append.h"
#include "services/core/clock.h"
#include "services/core/identity.h"

namespace etude::learn {
namespace {

constexpr std::array<std::uint32_t, 256> MakeTable() {
  std::array<std::uint32_t, 256> table{};
  for (std::uint32_t i = 0; i < 256; ++i) {
    std::uint32_t crc = i;
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ (crc & 1 ? 0x82f63b78u : 0u);
    table[i] = crc;
  }
  return table;
}
constexpr auto kTable = MakeTable();

template <class Number>
void PutFixed(std::string& out, Number value) {
  static_assert(std::endian::native == std::endian::little);
  out.append(reinterpret_cast<const char*>(&value), sizeof value);
}

void PutVarint(std::string& out, std::uint64_t value) {
  for (; value >= 0x80; value >>= 7) out.push_back(static_cast<char>(value | 0x80));
  out.push_back(static_cast<char>(value));
}

// protobuf field: wire type 2 (length-delimited)
void PutBytes(std::string& out, int field, std::string_view bytes) {
  PutVarint(out, static_cast<std::uint64_t>(field) << 3 | 2);
  PutVarint(out, bytes.size());
  out.append(bytes);
}

std::span<const std::uint8_t> Bytes(std::string_view text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

std::string Frame(const std::string& data) {
  std::string record;
  PutFixed(record, static_cast<std::uint64_t>(data.size()));
  const std::uint32_t length_crc = MaskedCrc32c(Bytes(record));
  PutFixed(record, length_crc);
  record += data;
  PutFixed(record, MaskedCrc32c(Bytes(data)));
  return record;
}

std::string EventHead(double wall_time) {
  std::string event(1, static_cast<char>(1 << 3 | 1));  // wall_time: double
  PutFixed(event, wall_time);
  return event;
}

}  // namespace

std::uint32_t Crc32c(std::span<const std::uint8_t> bytes) {
  std::uint32_t crc = ~0u;
  for (const std::uint8_t byte : bytes) crc = kTable[(crc ^ byte) & 0xff] ^ (crc >> 8);
  return ~crc;
}

std::uint32_t MaskedCrc32c(std::span<const std::uint8_t> bytes) {
  const std::uint32_t crc = Crc32c(bytes);
  return ((crc >> 15) | (crc << 17)) + 0xa282ead8u;
}

std::string EventRecord(double wall_time, std::uint64_t step, const std::map<std::string, double>& scalars) {
  std::string summary;
  for (const auto& [tag, number] : scalars) {
    std::string value;
    PutBytes(value, 1, tag);
    value.push_back(static_cast<char>(2 << 3 | 5));  // simple_value: float
    PutFixed(value, static_cast<float>(number));
    PutBytes(summary, 1, value);
  }
  std::string event = EventHead(wall_time);
  event.push_back(static_cast<char>(2 << 3 | 0));  // step: int64
  PutVarint(event, step);
  PutBytes(event, 5, summary);
  return Frame(event);
}

std::string VersionRecord(double wall_time) {
  std::string event = EventHead(wall_time);
  PutBytes(event, 3, "brain.Event:2");  // file_version
  return Frame(event);
}

Result<EventFile> EventFile::Open(const Path& folder) {
  ETUDE_RETURN_IF_ERROR(MakeFolders(folder));
  const double now = WallSeconds();
  const Path path = folder / fmt::format("events.out.tfevents.{:.0f}.{}.{}", now, HostName(), ::getpid());
  const int fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
  if (fd < 0) return Fail(ErrnoError("open", path, errno));
  EventFile file(path, fd);
  if (Status begun = AppendWhole(fd, path, Bytes(VersionRecord(now))); !begun) {
    ::unlink(path.c_str());  // it is tried again under another name
    return Fail(std::move(begun.error()));
  }
  return file;
}

Status EventFile::Write(std::uint64_t step, const std::map<std::string, double>& scalars) {
  return AppendWhole(file_.get(), path_, Bytes(EventRecord(WallSeconds(), step, scalars)));
}

}  // namespace etude::learn
