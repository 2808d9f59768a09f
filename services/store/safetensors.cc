// SPDX-License-Identifier: Apache-2.0
#include "services/store/safetensors.h"

#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <optional>

#include "services/core/check.h"
#include "services/episode/bounded_json.h"

namespace etude::store {
namespace {

static_assert(std::endian::native == std::endian::little, "sizes are copied as they lie in memory");

constexpr std::size_t kMaxRank = 16;
constexpr std::size_t kHeaderDepth = 4;  // maps in maps
constexpr std::string_view kMetadata = "__metadata__";

struct DTypeInfo {
  DType dtype;
  std::string_view name;
  std::size_t size;
};
constexpr std::array<DTypeInfo, 8> kDTypes{{{DType::kF32, "F32", 4},
                                            {DType::kF16, "F16", 2},
                                            {DType::kBF16, "BF16", 2},
                                            {DType::kF64, "F64", 8},
                                            {DType::kI64, "I64", 8},
                                            {DType::kI32, "I32", 4},
                                            {DType::kU8, "U8", 1},
                                            {DType::kBool, "BOOL", 1}}};

tl::unexpected<Error> Corrupt(std::string message) {
  return Fail(Code::kCorrupt, "safetensors: " + std::move(message));
}

const DTypeInfo& InfoOf(DType dtype) {
  const auto it =
      std::find_if(kDTypes.begin(), kDTypes.end(), [&](const DTypeInfo& info) { return info.dtype == dtype; });
  ETUDE_CHECK(it != kDTypes.end());
  return *it;
}

// Bytes that a tensor of this shape takes; nothing when it is absurd.
std::optional<std::uint64_t> BytesOf(DType dtype, const std::vector<std::int64_t>& shape) {
  std::uint64_t bytes = SizeOf(dtype);
  for (const std::int64_t extent : shape)
    if (extent < 0 || __builtin_mul_overflow(bytes, static_cast<std::uint64_t>(extent), &bytes)) return std::nullopt;
  return bytes;
}

// A tensor as the header tells it; its data are bytes [begin, end) of the buffer.
struct Entry {
  std::string name;
  DType dtype = DType::kF32;
  std::vector<std::int64_t> shape;
  std::uint64_t begin = 0;
  std::uint64_t end = 0;
};

Result<Entry> ReadEntry(const std::string& name, const OrderedJson& json) {
  const auto bad = [&](std::string_view what) {
    return Corrupt(fmt::format("tensor '{}': {}", name.substr(0, 200), what));
  };
  if (!json.is_object() || json.size() != 3 || !json.contains("dtype") || !json.contains("shape") ||
      !json.contains("data_offsets"))
    return bad("not {dtype, shape, data_offsets}");
  const auto& dtype = json["dtype"];
  const auto known = std::find_if(kDTypes.begin(), kDTypes.end(), [&](const DTypeInfo& info) {
    return dtype.is_string() && dtype.get_ref<const std::string&>() == info.name;
  });
  if (known == kDTypes.end()) return bad("a dtype that is not known");
  const auto& shape = json["shape"];
  const auto& offsets = json["data_offsets"];
  const auto are_unsigned = [](const OrderedJson& list) {
    return list.is_array() && std::all_of(list.begin(), list.end(), [](const OrderedJson& item) {
             return item.is_number_unsigned() && item.get<std::uint64_t>() <= INT64_MAX;
           });
  };
  if (!are_unsigned(shape) || shape.size() > kMaxRank) return bad("shape");
  if (!are_unsigned(offsets) || offsets.size() != 2) return bad("data_offsets");
  Entry entry{name, known->dtype, shape.get<std::vector<std::int64_t>>(), offsets[0].get<std::uint64_t>(),
              offsets[1].get<std::uint64_t>()};
  const auto bytes = BytesOf(entry.dtype, entry.shape);
  if (!bytes || entry.begin > entry.end || entry.end - entry.begin != *bytes)
    return bad("data_offsets do not fit shape and dtype");
  return entry;
}

Result<OrderedJson> ParseHeader(std::span<const std::uint8_t> bytes) {
  const std::string_view header(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  if (!header.starts_with('{')) return Corrupt("the header does not start with '{'");
  auto json = ParseBoundedJson(header, kHeaderDepth);
  if (!json || !json->is_object()) return Corrupt("the header is not a JSON map without duplicates");
  return std::move(*json);
}

Status ReadMetadata(const OrderedJson& json, std::map<std::string, std::string>& metadata) {
  if (!json.is_object()) return Corrupt("__metadata__ is not a map");
  for (const auto& [key, value] : json.items()) {
    if (!value.is_string()) return Corrupt(fmt::format("__metadata__: '{}' is not text", key));
    metadata.emplace(key, value.get<std::string>());
  }
  return {};
}

// In the order of their data: from 0 to the end of the buffer, no holes, no overlaps.
Status CheckCover(std::vector<Entry>& entries, std::uint64_t buffer_size) {
  std::stable_sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) {
    return std::pair(a.begin, a.end) < std::pair(b.begin, b.end);
  });
  std::uint64_t cursor = 0;
  for (const auto& entry : entries) {
    if (entry.begin != cursor || entry.end > buffer_size)
      return Corrupt(fmt::format("tensor '{}': data at {}..{}, expected at {} of {}", entry.name.substr(0, 200),
                                 entry.begin, entry.end, cursor, buffer_size));
    cursor = entry.end;
  }
  if (cursor != buffer_size)
    return Corrupt(fmt::format("{} bytes of data, the header tells of {}", buffer_size, cursor));
  return {};
}

}  // namespace

std::size_t SizeOf(DType dtype) { return InfoOf(dtype).size; }
std::string_view ToString(DType dtype) { return InfoOf(dtype).name; }

std::vector<std::uint8_t> EncodeSafetensors(const Safetensors& content) {
  OrderedJson json = OrderedJson::object();
  if (!content.metadata.empty()) json[std::string(kMetadata)] = content.metadata;

  // wide types first, then by name, so that every tensor starts aligned to its own size
  std::vector<const std::pair<const std::string, Tensor>*> order;
  for (const auto& item : content.tensors) order.push_back(&item);
  std::stable_sort(order.begin(), order.end(),
                   [](const auto* a, const auto* b) { return SizeOf(a->second.dtype) > SizeOf(b->second.dtype); });
  std::uint64_t offset = 0;
  for (const auto* item : order) {
    const auto& [name, tensor] = *item;
    ETUDE_CHECK(name != kMetadata && BytesOf(tensor.dtype, tensor.shape) == tensor.data.size(),
                "tensor '{}' of {} bytes", name, tensor.data.size());
    json[name] = {{"dtype", ToString(tensor.dtype)},
                  {"shape", tensor.shape},
                  {"data_offsets", {offset, offset + tensor.data.size()}}};
    offset += tensor.data.size();
  }
  std::string header = JsonText(json);
  header.resize((header.size() + 7) / 8 * 8, ' ');

  const std::uint64_t header_size = header.size();
  std::vector<std::uint8_t> bytes(sizeof(header_size) + header.size() + offset);
  std::uint8_t* cursor = bytes.data();
  const auto append = [&](const void* data, std::size_t size) {
    if (size > 0) std::memcpy(cursor, data, size);
    cursor += size;
  };
  append(&header_size, sizeof(header_size));
  append(header.data(), header.size());
  for (const auto* item : order) append(item->second.data.data(), item->second.data.size());
  return bytes;
}

Result<Safetensors> DecodeSafetensors(std::span<const std::uint8_t> bytes,
                                      const std::function<bool(std::string_view)>& wanted) {
  std::uint64_t header_size = 0;
  if (bytes.size() < sizeof(header_size)) return Corrupt("shorter than 8 bytes");
  std::memcpy(&header_size, bytes.data(), sizeof(header_size));
  const auto rest = bytes.subspan(sizeof(header_size));
  if (header_size > kMaxSafetensorsHeader || header_size > rest.size())
    return Corrupt(fmt::format("a header of {} bytes in a file of {}", header_size, bytes.size()));
  ETUDE_ASSIGN_OR_RETURN(const OrderedJson json, ParseHeader(rest.first(header_size)));
  const auto buffer = rest.subspan(header_size);

  Safetensors content;
  std::vector<Entry> entries;
  for (const auto& [name, item] : json.items()) {
    if (name == kMetadata) {
      ETUDE_RETURN_IF_ERROR(ReadMetadata(item, content.metadata));
      continue;
    }
    ETUDE_ASSIGN_OR_RETURN(entries.emplace_back(), ReadEntry(name, item));
  }
  ETUDE_RETURN_IF_ERROR(CheckCover(entries, buffer.size()));
  for (auto& entry : entries) {
    if (wanted && !wanted(entry.name)) continue;
    const auto data = buffer.subspan(entry.begin, entry.end - entry.begin);
    content.tensors.emplace(std::move(entry.name),
                            Tensor{entry.dtype, std::move(entry.shape), {data.begin(), data.end()}});
  }
  return content;
}

Result<OrderedJson> ReadSafetensorsHeader(int fd, const Path& path, std::uint64_t most) {
  const auto corrupt = [&](std::string_view what) {
    return Fail(Code::kCorrupt, fmt::format("read the header of '{}': {}", path.string(), what));
  };
  std::uint64_t size = 0;
  std::array<std::uint8_t, sizeof size> prefix{};
  ETUDE_ASSIGN_OR_RETURN(const auto begun, ReadAt(fd, path, 0, prefix));
  if (begun != prefix.size()) return corrupt("shorter than 8 bytes");
  std::memcpy(&size, prefix.data(), sizeof size);  // little-endian, as this machine
  struct stat info {};
  const bool fits = ::fstat(fd, &info) == 0 && size <= most &&
                    size + sizeof size <= static_cast<std::uint64_t>(std::max<off_t>(0, info.st_size));
  if (!fits) return corrupt(fmt::format("it claims to be {} bytes long", size));
  std::vector<std::uint8_t> text(size);
  ETUDE_ASSIGN_OR_RETURN(const auto got, ReadAt(fd, path, sizeof size, text));
  if (got != size) return corrupt("it is cut");
  auto json = ParseHeader(text);
  if (!json) return corrupt(json.error().message);
  return json;
}

Status WriteSafetensors(const Path& path, const Safetensors& content) {
  return WriteFileAtomically(path, EncodeSafetensors(content));
}

Result<Safetensors> ReadSafetensors(const Path& path) {
  ETUDE_ASSIGN_OR_RETURN(const auto bytes, ReadBinaryFile(path));
  auto content = DecodeSafetensors(bytes);
  if (!content) return Fail(content.error().Wrap(fmt::format("read '{}'", path.string())));
  return content;
}

}  // namespace etude::store
