// SPDX-License-Identifier: Apache-2.0
// Reads back what services/export writes, by the format's description and with nothing of the writer's: any thrift
// struct in the compact protocol, plain pages of version 1, levels in runs.
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <cstring>
#include <map>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "services/core/config.h"
#include "services/core/file.h"

namespace etude::exports {

/// A thrift value: what it is follows from which member is filled.
struct Thrift {
  std::int64_t number = 0;
  std::string text;
  std::vector<Thrift> list;
  std::map<int, Thrift> fields;

  const Thrift& at(int field) const { return fields.at(field); }
  bool has(int field) const { return fields.contains(field); }
};

class ThriftReader {
 public:
  explicit ThriftReader(std::string_view bytes) : bytes_(bytes) {}

  Thrift Struct() {
    Thrift value;
    for (int last = 0;;) {
      const auto header = Byte();
      if (header == 0) return value;
      const int step = header >> 4, type = header & 15;
      last = step != 0 ? last + step : static_cast<int>(Zigzag());
      value.fields[last] = Value(type);
    }
  }
  std::size_t position() const { return at_; }

 private:
  std::uint8_t Byte() { return static_cast<std::uint8_t>(bytes_.at(at_++)); }
  std::uint64_t Varint() {
    std::uint64_t value = 0;
    for (int shift = 0;; shift += 7) {
      const std::uint8_t byte = Byte();
      value |= static_cast<std::uint64_t>(byte & 0x7F) << shift;
      if (byte < 0x80) return value;
    }
  }
  std::int64_t Zigzag() {
    const std::uint64_t value = Varint();
    return static_cast<std::int64_t>(value >> 1) ^ -static_cast<std::int64_t>(value & 1);
  }
  Thrift Value(int type) {
    Thrift value;
    if (type == 1 || type == 2) {
      value.number = type == 1 ? 1 : 0;
    } else if (type == 4 || type == 5 || type == 6) {
      value.number = Zigzag();
    } else if (type == 8) {
      const std::size_t size = Varint();
      value.text = bytes_.substr(at_, size);
      at_ += size;
    } else if (type == 9) {
      const auto header = Byte();
      const std::size_t size = (header >> 4) == 15 ? Varint() : static_cast<std::size_t>(header >> 4);
      for (std::size_t i = 0; i < size; ++i) value.list.push_back(Value(header & 15));
    } else if (type == 12) {
      value = Struct();
    } else {
      throw std::runtime_error("thrift type " + std::to_string(type));
    }
    return value;
  }

  std::string_view bytes_;
  std::size_t at_ = 0;
};

/// A whole file: rows as maps of JSON, as the columns' names say.
class ParquetFile {
 public:
  explicit ParquetFile(const Path& path) : bytes_(ReadTextFile(path).value_or("")) {
    if (bytes_.size() < 12 || !bytes_.starts_with("PAR1") || !bytes_.ends_with("PAR1"))
      throw std::runtime_error("not a Parquet file: " + path.string());
    std::uint32_t size = 0;
    std::memcpy(&size, &bytes_[bytes_.size() - 8], 4);
    footer_ = ThriftReader(std::string_view(bytes_).substr(bytes_.size() - 8 - size, size)).Struct();
    ReadSchema();
    for (const Thrift& group : footer_.at(4).list) ReadGroup(group);
  }

  const Thrift& footer() const { return footer_; }
  const std::vector<OrderedJson>& rows() const { return rows_; }
  std::vector<std::string> columns() const {
    std::vector<std::string> names;
    for (const auto& leaf : leaves_) names.push_back(leaf.name);
    return names;
  }
  std::map<std::string, std::string> metadata() const {
    std::map<std::string, std::string> texts;
    if (footer_.has(5))
      for (const Thrift& pair : footer_.at(5).list) texts[pair.at(1).text] = pair.at(2).text;
    return texts;
  }

 private:
  struct Leaf {
    std::string name;
    int type = 0, lists = 0;
  };

  // depth first; a column's way to its leaf goes through one child each
  void ReadSchema() {
    const auto& nodes = footer_.at(2).list;
    for (std::size_t i = 1; i < nodes.size(); ++i) {
      Leaf leaf{nodes[i].at(4).text, 0, 0};
      while (nodes[i].has(5)) {
        EXPECT_EQ(nodes[i].at(5).number, 1);
        EXPECT_EQ(nodes[i].at(6).number, 3) << "a list says that it is one";
        EXPECT_EQ(nodes[i + 1].at(3).number, 2) << "repeated";
        i += 2;
        ++leaf.lists;
      }
      leaf.type = static_cast<int>(nodes[i].at(1).number);
      leaves_.push_back(leaf);
    }
  }

  void ReadGroup(const Thrift& group) {
    const auto count = static_cast<std::size_t>(group.at(3).number);
    std::vector<OrderedJson> rows(count, OrderedJson::object());
    for (std::size_t c = 0; c < leaves_.size(); ++c) {
      const auto cells = ReadChunk(leaves_[c], group.at(1).list.at(c).at(3));
      ASSERT_EQ(cells.size(), count) << leaves_[c].name;
      for (std::size_t r = 0; r < count; ++r) rows[r][leaves_[c].name] = cells[r];
    }
    rows_.insert(rows_.end(), rows.begin(), rows.end());
  }

  std::vector<OrderedJson> ReadChunk(const Leaf& leaf, const Thrift& chunk) {
    const auto at = static_cast<std::size_t>(chunk.at(9).number);
    ThriftReader reader(std::string_view(bytes_).substr(at));
    const Thrift header = reader.Struct();
    const auto size = static_cast<std::size_t>(header.at(3).number);
    EXPECT_EQ(reader.position() + size, static_cast<std::size_t>(chunk.at(7).number));
    std::string_view data = std::string_view(bytes_).substr(at + reader.position(), size);
    const auto entries = static_cast<std::size_t>(header.at(5).at(1).number);
    const auto repetition = Levels(data, static_cast<unsigned>(leaf.lists), entries);
    const auto definition = Levels(data, static_cast<unsigned>(2 * leaf.lists + 1), entries);
    std::vector<OrderedJson> rows;
    for (std::size_t i = 0, value = 0; i < entries; ++i) {
      if (repetition[i] == 0) rows.push_back(leaf.lists > 0 ? OrderedJson::array() : OrderedJson());
      OrderedJson* place = &rows.back();
      const unsigned present = definition[i] / 2;  // lists that have an element here
      for (unsigned depth = 0; depth < present; ++depth) {
        if (depth >= repetition[i] || repetition[i] == depth + 1)
          place->push_back(static_cast<int>(depth) + 1 < leaf.lists ? OrderedJson::array() : OrderedJson());
        place = &place->back();
      }
      if (definition[i] == static_cast<unsigned>(2 * leaf.lists + 1)) *place = Value(leaf.type, data, value++);
    }
    return rows;
  }

  static std::vector<unsigned> Levels(std::string_view& data, unsigned largest, std::size_t entries) {
    if (largest == 0) return std::vector<unsigned>(entries, 0);
    std::uint32_t size = 0;
    std::memcpy(&size, data.data(), 4);
    std::string_view runs = data.substr(4, size);
    data.remove_prefix(4 + size);
    std::vector<unsigned> levels;
    while (!runs.empty()) {
      std::uint64_t header = 0;
      for (int shift = 0;; shift += 7) {
        const auto byte = static_cast<std::uint8_t>(runs.at(0));
        runs.remove_prefix(1);
        header |= static_cast<std::uint64_t>(byte & 0x7F) << shift;
        if (byte < 0x80) break;
      }
      EXPECT_EQ(header & 1, 0u) << "a run";
      levels.insert(levels.end(), header >> 1, static_cast<std::uint8_t>(runs.at(0)));
      runs.remove_prefix(1);
    }
    EXPECT_EQ(levels.size(), entries);
    return levels;
  }

  // `value` counts the values of the page; texts are taken off `data`
  static OrderedJson Value(int type, std::string_view& data, std::size_t value) {
    if (type == 0) return (data.at(value / 8) >> (value % 8) & 1) != 0;
    if (type == 6) {
      std::uint32_t size = 0;
      std::memcpy(&size, data.data(), 4);
      OrderedJson text = std::string(data.substr(4, size));
      data.remove_prefix(4 + size);
      return text;
    }
    if (type == 2) return Number<std::int64_t>(data, value);
    if (type == 4) return Number<float>(data, value);
    return Number<double>(data, value);
  }
  template <class T>
  static T Number(std::string_view data, std::size_t value) {
    T number{};
    const std::string_view bytes = data.substr(value * sizeof(T), sizeof(T));
    std::memcpy(&number, bytes.data(), bytes.size());
    return number;
  }

  std::string bytes_;
  Thrift footer_;
  std::vector<Leaf> leaves_;
  std::vector<OrderedJson> rows_;
};

}  // namespace etude::exports
