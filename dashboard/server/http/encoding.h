// SPDX-License-Identifier: Apache-2.0
// What happens to an answer on its way out: compression, validators, ranges.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "dashboard/server/http/message.h"

namespace etude::http {

/// gzip at a fast level.
std::string Gzip(std::string_view text);
/// Whether the client takes `coding`: "gzip, deflate;q=0" takes gzip and not deflate.
bool Accepts(std::string_view accept_encoding, std::string_view coding);

/// First and last byte, both included.
struct ByteRange {
  std::uint64_t first = 0, last = 0;
  std::uint64_t size() const { return last - first + 1; }
};
enum class RangeKind : std::uint8_t { kNone, kPart, kUnsatisfiable };
struct RangeRequest {
  RangeKind kind = RangeKind::kNone;
  ByteRange range;
};
/// "bytes=0-99", "bytes=100-", "bytes=-100". Several ranges, or other units, are answered by the whole: kNone.
RangeRequest ParseRange(std::string_view header, std::uint64_t size);

/// Whether `if_none_match` lists the tag, in quotes or weak, or is "*".
bool MatchesTag(std::string_view if_none_match, std::string_view etag);

/// Gives the answer its tag, 304 where the client has it, and compresses text beyond 1 kB.
void Finish(const Request& request, Answer& answer);

}  // namespace etude::http
