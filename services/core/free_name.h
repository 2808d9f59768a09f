// SPDX-License-Identifier: Apache-2.0
// A name for what is put beside others of its kind: set aside, or in quarantine.
#pragma once

#include <filesystem>
#include <functional>
#include <system_error>

#include "services/core/file.h"

namespace etude {

/// The first of `name(first)`, `name(first + 1)`, ... at which nothing is yet. Two processes may find the same one.
inline Path FirstFree(const std::function<Path(int)>& name, int first = 1) {
  std::error_code error;
  Path path = name(first);
  for (int i = first + 1; std::filesystem::exists(path, error); ++i) path = name(i);
  return path;
}

}  // namespace etude
