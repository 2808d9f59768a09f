// SPDX-License-Identifier: Apache-2.0
// One column of one row group as the bytes of a data page, and what the footer says of it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "services/core/result.h"
#include "services/export/parquet_writer.h"

namespace etude::exports::internal {

// numbers of parquet.thrift
enum class PhysicalType : std::int32_t { kBoolean = 0, kInt64 = 2, kFloat = 4, kDouble = 5, kByteArray = 6 };
enum class Encoding : std::int32_t { kPlain = 0, kRle = 3 };

PhysicalType PhysicalTypeOf(ParquetType type);

struct Page {
  std::string bytes;                    ///< header and data
  std::uint64_t levels = 0;             ///< entries: values, and a place for each empty list
  std::optional<std::string> min, max;  ///< of the values, plain encoding; none: no value, or one that is not a number
};

/// @error kInvalidArgument: what of the cells does not fit column and rows
Result<Page> MakePage(const ParquetColumn& column, std::size_t rows, const ParquetCells& cells);

}  // namespace etude::exports::internal
