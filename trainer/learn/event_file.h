// SPDX-License-Identifier: Apache-2.0
// TensorBoard event files, written without TensorFlow. Source of the format: TFRecord framing
// (length, masked CRC-32C, data, masked CRC-32C) around the Event and Summary protocol buffers.
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>

#include "services/core/descriptor.h"
#include "services/core/file.h"

namespace etude::learn {

/// CRC-32C (Castagnoli), as in RFC 3720.
std::uint32_t Crc32c(std::span<const std::uint8_t> bytes);
/// The masking that TFRecord uses, so that a CRC of bytes with CRCs in them is not degenerate.
std::uint32_t MaskedCrc32c(std::span<const std::uint8_t> bytes);

/// One framed record with scalar values by tag. @param wall_time  seconds since the epoch
std::string EventRecord(double wall_time, std::uint64_t step, const std::map<std::string, double>& scalars);
/// The record every event file begins with.
std::string VersionRecord(double wall_time);

/// Appends events to FOLDER/events.out.tfevents.TIME.HOST. Not thread-safe.
class EventFile {
 public:
  /// @error kUnavailable
  static Result<EventFile> Open(const Path& folder);

  Status Write(std::uint64_t step, const std::map<std::string, double>& scalars);

 private:
  EventFile(Path path, int fd) : path_(std::move(path)), file_(fd) {}
  Path path_;
  Descriptor file_;
};

}  // namespace etude::learn
