// SPDX-License-Identifier: Apache-2.0
#include "services/export/json_table.h"

#include <fmt/format.h>

namespace etude::exports::internal {
namespace {

ParquetType TypeOf(const OrderedJson& value) {
  if (value.is_boolean()) return ParquetType::kBool;
  if (value.is_number_integer()) return ParquetType::kInt64;
  return value.is_number() ? ParquetType::kDouble : ParquetType::kText;
}

// Collects the values below `value`, and how long its lists are. False: another type or depth than the column's.
template <class T>
bool Collect(const OrderedJson& value, std::size_t depth, std::vector<T>& values, ParquetCells& cells) {
  if (depth < cells.lengths.size()) {
    if (!value.is_array()) return false;
    cells.lengths[depth].push_back(static_cast<std::uint32_t>(value.size()));
    for (const auto& element : value)
      if (!Collect(element, depth + 1, values, cells)) return false;
    return true;
  }
  if constexpr (std::is_same_v<T, std::string>) {
    if (!value.is_string()) return false;
    values.push_back(value.get<std::string>());
  } else if constexpr (std::is_same_v<T, std::uint8_t>) {
    if (!value.is_boolean()) return false;
    values.push_back(value.get<bool>() ? 1 : 0);
  } else {
    if (!(std::is_same_v<T, double> ? value.is_number() : value.is_number_integer())) return false;
    values.push_back(value.get<T>());
  }
  return true;
}

template <class T>
Result<ParquetCells> Column(const std::vector<OrderedJson>& rows, const ParquetColumn& column) {
  ParquetCells cells;
  cells.lengths.resize(static_cast<std::size_t>(column.lists));
  std::vector<T> values;
  for (const auto& row : rows) {
    const auto found = row.find(column.name);
    if (found == row.end() || !Collect(*found, 0, values, cells))
      return Fail(Code::kInvalidArgument, fmt::format("column '{}': a row lacks it or has another type", column.name));
  }
  cells.values = std::move(values);
  return cells;
}

Result<ParquetCells> TypedColumn(const std::vector<OrderedJson>& rows, const ParquetColumn& column) {
  switch (column.type) {
    case ParquetType::kBool:
      return Column<std::uint8_t>(rows, column);
    case ParquetType::kInt64:
      return Column<std::int64_t>(rows, column);
    case ParquetType::kFloat:
      return Column<float>(rows, column);
    case ParquetType::kDouble:
      return Column<double>(rows, column);
    case ParquetType::kText:
      break;
  }
  return Column<std::string>(rows, column);
}

}  // namespace

std::vector<ParquetColumn> ColumnsOf(const OrderedJson& row) {
  std::vector<ParquetColumn> columns;
  for (const auto& [key, value] : row.items()) {
    const OrderedJson* leaf = &value;
    int lists = 0;
    for (; leaf->is_array() && !leaf->empty(); ++lists) leaf = &leaf->front();
    columns.push_back({key, TypeOf(*leaf), lists});
  }
  return columns;
}

Result<std::vector<ParquetCells>> CellsOf(const std::vector<OrderedJson>& rows,
                                          const std::vector<ParquetColumn>& columns) {
  std::vector<ParquetCells> cells;
  for (const auto& column : columns) {
    ETUDE_ASSIGN_OR_RETURN(auto made, TypedColumn(rows, column));
    cells.push_back(std::move(made));
  }
  return cells;
}

}  // namespace etude::exports::internal
