// SPDX-License-Identifier: Apache-2.0
// Rows that are JSON maps -> columns of a Parquet file: for metadata, of which there is little.
#pragma once

#include <vector>

#include "services/core/config.h"
#include "services/core/result.h"
#include "services/export/parquet_writer.h"

namespace etude::exports::internal {

/// A column a key of `row`, in its order: truth values, whole numbers, other numbers (kDouble), texts, and lists of one
/// of them, whose first elements say of what.
std::vector<ParquetColumn> ColumnsOf(const OrderedJson& row);

/// @error kInvalidArgument: a row lacks a column's key, or has another type there
Result<std::vector<ParquetCells>> CellsOf(const std::vector<OrderedJson>& rows,
                                          const std::vector<ParquetColumn>& columns);

}  // namespace etude::exports::internal
