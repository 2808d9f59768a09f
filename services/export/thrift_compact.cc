// SPDX-License-Identifier: Apache-2.0
#include "services/export/thrift_compact.h"

namespace etude::exports::internal {
namespace {

// numbers of the types in headers
constexpr int kI32 = 5, kI64 = 6, kBinary = 8, kList = 9, kStruct = 12;
constexpr std::size_t kShortList = 15;  // from so many elements on the count follows its header

}  // namespace

void ThriftWriter::Varint(std::uint64_t value) {
  for (; value >= 0x80; value >>= 7) bytes_.push_back(static_cast<char>((value & 0x7F) | 0x80));
  bytes_.push_back(static_cast<char>(value));
}

void ThriftWriter::Zigzag(std::int64_t value) {
  Varint((static_cast<std::uint64_t>(value) << 1) ^ static_cast<std::uint64_t>(value >> 63));
}

void ThriftWriter::Raw(std::string_view value) {
  Varint(value.size());
  bytes_.append(value);
}

void ThriftWriter::Header(int field, int type) {
  const int step = field - last_.back();
  last_.back() = field;
  if (step >= 1 && step <= 15) {
    bytes_.push_back(static_cast<char>(step << 4 | type));
    return;
  }
  bytes_.push_back(static_cast<char>(type));
  Zigzag(field);
}

void ThriftWriter::ListHeader(int field, std::size_t count, int type) {
  Header(field, kList);
  if (count < kShortList) {
    bytes_.push_back(static_cast<char>(static_cast<int>(count) << 4 | type));
    return;
  }
  bytes_.push_back(static_cast<char>(0xF0 | type));
  Varint(count);
}

void ThriftWriter::Integer(int field, std::int32_t value) {
  Header(field, kI32);
  Zigzag(value);
}

void ThriftWriter::Long(int field, std::int64_t value) {
  Header(field, kI64);
  Zigzag(value);
}

void ThriftWriter::Text(int field, std::string_view value) {
  Header(field, kBinary);
  Raw(value);
}

void ThriftWriter::BeginStruct(int field) {
  Header(field, kStruct);
  BeginElement();
}

void ThriftWriter::BeginElement() { last_.push_back(0); }

void ThriftWriter::EndStruct() {
  bytes_.push_back(0);
  last_.pop_back();
}

void ThriftWriter::BeginStructs(int field, std::size_t count) { ListHeader(field, count, kStruct); }

void ThriftWriter::Integers(int field, const std::vector<std::int32_t>& values) {
  ListHeader(field, values.size(), kI32);
  for (const auto value : values) Zigzag(value);
}

void ThriftWriter::Texts(int field, const std::vector<std::string>& values) {
  ListHeader(field, values.size(), kBinary);
  for (const auto& value : values) Raw(value);
}

}  // namespace etude::exports::internal
