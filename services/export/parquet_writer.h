// SPDX-License-Identifier: Apache-2.0
// Apache Parquet files, as much of the format as columns of numbers, texts and lists of them need: data pages of
// version 1, plain encoding, no compression, a page a column and row group, statistics. Debian 12 has no library that
// writes them. Source: parquet-format (parquet.thrift, README.md, Encodings.md, LogicalTypes.md) of the Apache Software
// Foundation.
//
//   ETUDE_ASSIGN_OR_RETURN(auto file, ParquetWriter::Create("a.parquet", {{"t", kFloat}, {"q", kFloat, 1}}, {}));
//   ETUDE_RETURN_IF_ERROR(file.WriteRowGroup(2, {Cells(floats), Lists(floats, 2, {7})}));
//   ETUDE_RETURN_IF_ERROR(file.Finish());
#pragma once

#include <cstdint>
#include <cstdio>
#include <map>
#include <memory>
#include <string>
#include <variant>
#include <vector>

#include "services/core/file.h"
#include "services/core/result.h"

namespace etude::exports {

enum class ParquetType : std::uint8_t { kBool, kInt64, kFloat, kDouble, kText };

struct ParquetColumn {
  std::string name;
  ParquetType type = ParquetType::kFloat;
  int lists = 0;  ///< 0: a value a row; 1: a list of values a row; 2: lists of lists; ...

  bool operator==(const ParquetColumn&) const = default;
};

/// Values of a column, of all rows of a group one after the other.
struct ParquetCells {
  /// kBool: std::uint8_t, 0 or 1.
  std::variant<std::vector<std::uint8_t>, std::vector<std::int64_t>, std::vector<float>, std::vector<double>,
               std::vector<std::string>>
      values;
  /// Of columns of lists: lengths[0] has each row's, lengths[1] that of each list within them, and so on.
  std::vector<std::vector<std::uint32_t>> lengths;
};

/// A value a row.
template <class T>
ParquetCells Cells(std::vector<T> values) {
  return {std::move(values), {}};
}
/// Lists of the same extents in every row: {3, 1, 1} are 3 lists of 1 list of 1 value.
template <class T>
ParquetCells Lists(std::vector<T> values, std::size_t rows, const std::vector<std::uint32_t>& extents) {
  ParquetCells cells{std::move(values), {}};
  std::size_t count = rows;
  for (const std::uint32_t extent : extents) {
    cells.lengths.emplace_back(count, extent);
    count *= extent;
  }
  return cells;
}

/// One file; what it holds in memory is a row group and the footer (about 200 bytes a column and row group). Until
/// Finish has succeeded the file has no footer, and no reader takes it for one. Not thread-safe.
class ParquetWriter {
 public:
  /// @param metadata  texts for the footer, for readers that look for them
  /// @error kInvalidArgument: no columns, an empty name, a name twice; kUnavailable of the disk
  static Result<ParquetWriter> Create(const Path& path, std::vector<ParquetColumn> columns,
                                      std::map<std::string, std::string> metadata);
  ParquetWriter(ParquetWriter&&) noexcept;
  ParquetWriter& operator=(ParquetWriter&&) noexcept;
  ~ParquetWriter();

  /// @param cells  one a column, in the columns' order
  /// @error kInvalidArgument: types, lengths or rows do not fit, and nothing was written; kUnavailable of the disk
  Status WriteRowGroup(std::size_t rows, const std::vector<ParquetCells>& cells);
  /// Writes the footer; the file is durable when it returns. Nothing may be written after it.
  Status Finish();

  std::uint64_t bytes() const;  ///< of the file until now
  std::uint64_t rows() const;

 private:
  struct Impl;
  explicit ParquetWriter(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::exports
