// SPDX-License-Identifier: Apache-2.0
// Thrift's compact protocol, as much of it as a Parquet footer needs, written only.
// Source: thrift/doc/specs/thrift-compact-protocol.md of Apache Thrift.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace etude::exports::internal {

/// Fields must come in ascending order of their ids. Not thread-safe.
///
///   ThriftWriter thrift;
///   thrift.Integer(1, 7);
///   thrift.BeginStruct(2);
///   thrift.Text(1, "inside");
///   thrift.EndStruct();
///   thrift.EndStruct();  // of the outermost, which nothing begins
class ThriftWriter {
 public:
  void Integer(int field, std::int32_t value);  ///< i32, and enumerations
  void Long(int field, std::int64_t value);     ///< i64
  void Text(int field, std::string_view value);
  void BeginStruct(int field);
  void EndStruct();

  /// `count` structs follow, each begun with BeginElement and ended with EndStruct.
  void BeginStructs(int field, std::size_t count);
  void BeginElement();
  void Integers(int field, const std::vector<std::int32_t>& values);
  void Texts(int field, const std::vector<std::string>& values);

  const std::string& bytes() const { return bytes_; }

 private:
  void Header(int field, int type);
  void ListHeader(int field, std::size_t count, int type);
  void Varint(std::uint64_t value);
  void Zigzag(std::int64_t value);
  void Raw(std::string_view value);

  std::string bytes_;
  std::vector<int> last_{0};  // id of the last field, of each struct that is open
};

}  // namespace etude::exports::internal
