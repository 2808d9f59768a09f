// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/http/encoding.h"

#include <zlib.h>

#include <algorithm>
#include <charconv>

#include "services/core/check.h"
#include "services/core/hash.h"

namespace etude::http {
namespace {

constexpr std::size_t kCompressFrom = 1024;  // bytes; below it the header costs more

std::string_view Trimmed(std::string_view text) {
  while (text.starts_with(' ')) text.remove_prefix(1);
  while (text.ends_with(' ')) text.remove_suffix(1);
  return text;
}

bool Compressible(std::string_view type) {
  return type.starts_with("text/") || type.starts_with("application/json") ||
         type.starts_with("application/problem+json") || type.starts_with("image/svg") ||
         type.starts_with("application/javascript") || type.starts_with("application/vnd.safetensors");
}

std::optional<std::uint64_t> Number(std::string_view text) {
  std::uint64_t number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc() || end != text.data() + text.size() || text.empty()) return std::nullopt;
  return number;
}

// calls fn for each item of a list; ends when it returns true, and then returns true
template <class Function>
bool AnyItem(std::string_view list, Function&& fn) {
  while (!list.empty()) {
    const auto comma = list.find(',');
    if (fn(Trimmed(list.substr(0, comma)))) return true;
    list = comma == std::string_view::npos ? std::string_view() : list.substr(comma + 1);
  }
  return false;
}

}  // namespace

std::string Gzip(std::string_view text) {
  z_stream stream{};
  constexpr int kLevel = 5, kGzipWindow = 15 + 16, kMemory = 8;
  ETUDE_CHECK(deflateInit2(&stream, kLevel, Z_DEFLATED, kGzipWindow, kMemory, Z_DEFAULT_STRATEGY) == Z_OK);
  std::string compressed(deflateBound(&stream, text.size()), '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(text.data()));
  stream.avail_in = static_cast<uInt>(text.size());
  stream.next_out = reinterpret_cast<Bytef*>(compressed.data());
  stream.avail_out = static_cast<uInt>(compressed.size());
  const int code = deflate(&stream, Z_FINISH);
  compressed.resize(stream.total_out);
  deflateEnd(&stream);
  ETUDE_CHECK(code == Z_STREAM_END, "deflate={}", code);
  return compressed;
}

bool Accepts(std::string_view accept_encoding, std::string_view coding) {
  return AnyItem(accept_encoding, [&](std::string_view item) {
    const auto semicolon = item.find(';');
    if (Trimmed(item.substr(0, semicolon)) != coding) return false;
    if (semicolon == std::string_view::npos) return true;
    const auto weight = Trimmed(item.substr(semicolon + 1));
    return weight != "q=0" && weight != "q=0.0" && weight != "q=0.00" && weight != "q=0.000";
  });
}

RangeRequest ParseRange(std::string_view header, std::uint64_t size) {
  constexpr std::string_view kUnit = "bytes=";
  if (!header.starts_with(kUnit)) return {};
  header.remove_prefix(kUnit.size());
  const auto dash = header.find('-');
  if (dash == std::string_view::npos || header.find(',') != std::string_view::npos) return {};
  const auto first = Number(Trimmed(header.substr(0, dash))), last = Number(Trimmed(header.substr(dash + 1)));
  const bool open = Trimmed(header.substr(dash + 1)).empty();
  if (!first) {
    if (!Trimmed(header.substr(0, dash)).empty() || !last) return {};
    if (*last == 0 || size == 0) return {RangeKind::kUnsatisfiable, {}};
    return {RangeKind::kPart, {size - std::min(size, *last), size - 1}};
  }
  if (!open && (!last || *last < *first)) return {};
  if (*first >= size) return {RangeKind::kUnsatisfiable, {}};
  return {RangeKind::kPart, {*first, open ? size - 1 : std::min(*last, size - 1)}};
}

bool MatchesTag(std::string_view if_none_match, std::string_view etag) {
  if (etag.empty()) return false;
  return AnyItem(if_none_match, [&](std::string_view item) {
    if (item == "*") return true;
    if (item.starts_with("W/")) item.remove_prefix(2);
    return item.size() == etag.size() + 2 && item.front() == '"' && item.back() == '"' &&
           item.substr(1, etag.size()) == etag;
  });
}

void Finish(const Request& request, Answer& answer) {
  const bool good = answer.status == 200;
  if (good && answer.etag.empty() && !answer.file) answer.etag = Sha256Hex(answer.body).substr(0, 24);
  const bool compress = !answer.file && answer.content_encoding.empty() && answer.body.size() > kCompressFrom &&
                        Compressible(answer.content_type) && Accepts(request.accept_encoding, "gzip");
  // a strong tag names bytes, and compressed ones are others
  if (compress && !answer.etag.empty()) answer.etag += "-gz";
  if (good && MatchesTag(request.if_none_match, answer.etag)) {
    answer.status = 304;
    answer.body.clear();
    answer.file.reset();
    answer.content_encoding.clear();
    return;
  }
  if (!compress) return;
  answer.body = Gzip(answer.body);
  answer.content_encoding = "gzip";
}

}  // namespace etude::http
