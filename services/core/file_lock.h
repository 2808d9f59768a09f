// SPDX-License-Identifier: Apache-2.0
// A folder that one process at a time may write to.
#pragma once

#include <string_view>
#include <utility>

#include "services/core/descriptor.h"
#include "services/core/file.h"
#include "services/core/result.h"

namespace etude {

/// Keeps everybody else out as long as it lives; ends with its process, however that ends.
class FileLock {
 public:
  /// @param file  made when it is not there; says who holds it, and stays
  /// @param what  for the error: "dataset 'data' is being written"
  /// @error kUnavailable when another one holds it (names the process), or the file cannot be written
  static Result<FileLock> Take(const Path& file, std::string_view what);

 private:
  explicit FileLock(Descriptor file) : file_(std::move(file)) {}
  Descriptor file_;
};

}  // namespace etude
