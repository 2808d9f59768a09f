// SPDX-License-Identifier: Apache-2.0
#include "services/export/parquet_page.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <type_traits>

#include "services/export/thrift_compact.h"

namespace etude::exports::internal {
namespace {

static_assert(std::endian::native == std::endian::little, "plain encoding is little-endian");

void AppendInteger(std::string& bytes, std::uint32_t value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof(value));
}

// Levels of one kind: runs of equal ones, as the hybrid encoding has them.
class LevelEncoder {
 public:
  explicit LevelEncoder(unsigned largest) : width_((static_cast<unsigned>(std::bit_width(largest)) + 7) / 8) {}

  void Add(unsigned level) {
    if (count_ > 0 && level != level_) Flush();
    level_ = level;
    ++count_;
  }

  // four bytes of size in front; nothing where there is only one level
  std::string Take() {
    if (width_ == 0) return {};
    Flush();
    std::string sized;
    AppendInteger(sized, static_cast<std::uint32_t>(bytes_.size()));
    return sized + bytes_;
  }

 private:
  void Flush() {
    if (count_ == 0) return;
    std::uint64_t header = count_ << 1;  // lowest bit 0: a run
    for (; header >= 0x80; header >>= 7) bytes_.push_back(static_cast<char>((header & 0x7F) | 0x80));
    bytes_.push_back(static_cast<char>(header));
    for (unsigned byte = 0; byte < width_; ++byte) bytes_.push_back(static_cast<char>(level_ >> (8 * byte)));
    count_ = 0;
  }

  unsigned width_;  // bytes of a level
  unsigned level_ = 0;
  std::uint64_t count_ = 0;
  std::string bytes_;
};

// Where lists begin (repetition) and how much of the way to a value is there (definition). Every list and every value
// is optional, as others write them: each list adds two to the definition, the value one.
class LevelWalk {
 public:
  LevelWalk(int lists, const ParquetCells& cells)
      : lists_(static_cast<unsigned>(lists)),
        cells_(cells),
        next_(cells.lengths.size(), 0),
        repetition_(lists_),
        definition_(2 * lists_ + 1) {}

  void Rows(std::size_t rows) {
    for (std::size_t row = 0; row < rows; ++row) Visit(0, 0);
  }
  std::uint64_t count() const { return count_; }
  std::string Take() { return repetition_.Take() + definition_.Take(); }

 private:
  void Visit(unsigned depth, unsigned repetition) {
    if (depth == lists_) return Put(repetition, 2 * lists_ + 1);
    const std::uint32_t length = cells_.lengths[depth][next_[depth]++];
    if (length == 0) return Put(repetition, 2 * depth + 1);
    for (std::uint32_t i = 0; i < length; ++i) Visit(depth + 1, i == 0 ? repetition : depth + 1);
  }
  void Put(unsigned repetition, unsigned definition) {
    repetition_.Add(repetition);
    definition_.Add(definition);
    ++count_;
  }

  unsigned lists_;
  const ParquetCells& cells_;
  std::vector<std::size_t> next_;  // of each depth: the list that comes
  LevelEncoder repetition_, definition_;
  std::uint64_t count_ = 0;
};

template <class T>
std::string Raw(const T& value) {
  if constexpr (std::is_same_v<T, std::string>)
    return value;
  else
    return {reinterpret_cast<const char*>(&value), sizeof(value)};
}

template <class T>
std::string PlainValues(const std::vector<T>& values) {
  std::string bytes;
  if constexpr (std::is_same_v<T, std::uint8_t>) {  // bits, lowest first
    bytes.assign((values.size() + 7) / 8, '\0');
    for (std::size_t i = 0; i < values.size(); ++i)
      bytes[i / 8] = static_cast<char>(bytes[i / 8] | (values[i] != 0 ? 1 << (i % 8) : 0));
  } else if constexpr (std::is_same_v<T, std::string>) {
    for (const auto& value : values) {
      AppendInteger(bytes, static_cast<std::uint32_t>(value.size()));
      bytes += value;
    }
  } else {
    bytes.assign(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
  }
  return bytes;
}

// The format leaves out of statistics what has no order, and wants zeros to be -0 as a minimum, +0 as a maximum.
template <class T>
void FindRange(const std::vector<T>& values, Page& page) {
  constexpr bool kReal = std::is_floating_point_v<T>;
  if (values.empty()) return;
  if constexpr (kReal) {
    if (std::any_of(values.begin(), values.end(), [](T value) { return std::isnan(value); })) return;
  }
  const auto [least, most] = std::minmax_element(values.begin(), values.end());
  T low = *least, high = *most;
  if constexpr (kReal) {
    if (low == 0) low = -T{0};
    if (high == 0) high = T{0};
  }
  page.min = Raw(low);
  page.max = Raw(high);
}

bool FitsType(ParquetType type, const ParquetCells& cells) {
  const std::size_t expected[] = {0, 1, 2, 3, 4};  // kBool, kInt64, kFloat, kDouble, kText
  return cells.values.index() == expected[static_cast<std::size_t>(type)];
}

Status CheckCells(const ParquetColumn& column, std::size_t rows, const ParquetCells& cells, std::size_t values) {
  const auto bad = [&](const std::string& what) {
    return Fail(Code::kInvalidArgument, fmt::format("column '{}': {}", column.name, what));
  };
  if (!FitsType(column.type, cells)) return bad("its values are of another type");
  if (cells.lengths.size() != static_cast<std::size_t>(column.lists))
    return bad(fmt::format("lengths of {} levels of lists, it has {}", cells.lengths.size(), column.lists));
  std::uint64_t expected = rows;
  for (const auto& lengths : cells.lengths) {
    if (lengths.size() != expected) return bad(fmt::format("{} lengths of lists, not {}", lengths.size(), expected));
    expected = 0;
    for (const std::uint32_t length : lengths) expected += length;
  }
  if (values != expected) return bad(fmt::format("{} values, not {}", values, expected));
  return {};
}

std::string HeaderOf(std::size_t size, std::uint64_t levels) {
  constexpr std::int32_t kDataPage = 0;
  ThriftWriter header;
  header.Integer(1, kDataPage);
  header.Integer(2, static_cast<std::int32_t>(size));
  header.Integer(3, static_cast<std::int32_t>(size));
  header.BeginStruct(5);
  header.Integer(1, static_cast<std::int32_t>(levels));
  header.Integer(2, static_cast<std::int32_t>(Encoding::kPlain));
  header.Integer(3, static_cast<std::int32_t>(Encoding::kRle));
  header.Integer(4, static_cast<std::int32_t>(Encoding::kRle));
  header.EndStruct();
  header.EndStruct();
  return header.bytes();
}

}  // namespace

PhysicalType PhysicalTypeOf(ParquetType type) {
  switch (type) {
    case ParquetType::kBool:
      return PhysicalType::kBoolean;
    case ParquetType::kInt64:
      return PhysicalType::kInt64;
    case ParquetType::kFloat:
      return PhysicalType::kFloat;
    case ParquetType::kDouble:
      return PhysicalType::kDouble;
    case ParquetType::kText:
      break;
  }
  return PhysicalType::kByteArray;
}

Result<Page> MakePage(const ParquetColumn& column, std::size_t rows, const ParquetCells& cells) {
  const std::size_t values = std::visit([](const auto& list) { return list.size(); }, cells.values);
  ETUDE_RETURN_IF_ERROR(CheckCells(column, rows, cells, values));
  LevelWalk walk(column.lists, cells);
  walk.Rows(rows);
  Page page;
  page.levels = walk.count();
  std::string data = walk.Take();
  data += std::visit([](const auto& list) { return PlainValues(list); }, cells.values);
  std::visit([&](const auto& list) { FindRange(list, page); }, cells.values);
  if (data.size() > std::numeric_limits<std::int32_t>::max() || page.levels > std::numeric_limits<std::int32_t>::max())
    return Fail(Code::kInvalidArgument,
                fmt::format("column '{}': {} bytes of {} rows are more than a page holds; write smaller row groups",
                            column.name, data.size(), rows));
  page.bytes = HeaderOf(data.size(), page.levels) + data;
  return page;
}

}  // namespace etude::exports::internal
